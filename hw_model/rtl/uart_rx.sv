// Receives bytes from a serial line: a start bit (0), 8 bits, the lowest first, and a stop bit (1); no parity. `valid` is high
// for one cycle when a byte is complete.
//
// Every bit is sampled once, in its middle, counted in clocks from the falling edge of the start bit. The stop bit is sampled
// 9.5 bits after that edge, and must not be missed by more than half a bit, which is 5 % of 9.5 bits. The edge is seen up to one
// clock late, which is a part of this half: nothing where BIT is large, and a quarter of it at the least BIT, 8. So the
// sender's bits may be 4 % longer or shorter than BIT clocks at any BIT, and 5 % where BIT is large.
module uart_rx #(
    // Clocks per bit, at least 8, as the edge takes too large a part of shorter bits. top_uart.sv sets it; the default is that of
    // 115,200 bits per second at 12 MHz.
    parameter integer BIT = 104
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

    logic [2:0]       line;    // the last three values of `rx`, the newest at bit 0; the first register may be metastable
    logic [COUNT-1:0] left;    // clocks to the middle of the next bit
    logic [3:0]       bits;    // bits of this byte still to come, start and stop included; 0: wait for the edge of a start bit

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
            if (bits == 10 && line[1]) bits <= 0;  // a glitch on the line, not a start bit
            if (bits == 1) begin
                data <= data;  // the stop bit is not one of the byte
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
