// Bytes from a serial line: a start bit, 8 bits, the lowest first, and a stop bit; no parity.
//
// Every bit is read once, in its middle, counted from the falling edge of the start bit. So the sender's bits may be 4 %
// longer or shorter than BIT clocks, and 5 % where BIT is large.
module uart_rx #(
    parameter integer BIT = 104  // clocks per bit, at least 8
) (
    input  logic       clk,
    input  logic       reset,
    input  logic       rx,
    output logic       valid,
    output logic [7:0] data,
    output logic       broken  // a byte without its stop bit
);
    localparam integer COUNT = $clog2(BIT);
    localparam logic [COUNT-1:0] WHOLE = COUNT'(BIT - 1), HALF = COUNT'(BIT / 2 - 1);

    logic [2:0]       line;    // `rx`, synchronised; the newest at bit 0
    logic [COUNT-1:0] left;    // clocks to the middle of the next bit
    logic [3:0]       bits;    // bits to come; 0: none, wait for the edge of a start bit

    always_ff @(posedge clk) begin
        line <= {line[1:0], rx};
        {valid, broken} <= 0;
        left <= left == 0 ? WHOLE : left - 1;
        if (bits == 0) begin
            if (line[2] && !line[1]) bits <= 10;
            left <= HALF;
        end else if (left == 0) begin
            bits <= bits - 1;
            data <= {line[1], data[7:1]};
            if (bits == 10 && line[1]) bits <= 0;  // a spike on the line, not a start bit
            if (bits == 1) begin
                data <= data;
                valid <= line[1];
                broken <= !line[1];
            end
        end
        if (reset) begin
            line <= 3'b111;
            bits <= 0;
            {valid, broken} <= 0;
        end
    end
endmodule
