// Sends bytes to a serial line: a start bit (0), 8 bits, the lowest first, and a stop bit (1); no parity. A byte is taken when
// `valid` and `ready` are high; `ready` is high again when its stop bit has been sent.
module uart_tx #(
    parameter integer BIT = 104  // clocks per bit; top_uart.sv sets it, here for 115,200 bits per second at 12 MHz
) (
    input  logic       clk,
    input  logic       reset,
    input  logic       valid,
    output logic       ready,
    input  logic [7:0] data,
    output logic       tx
);
    localparam integer COUNT = $clog2(BIT);
    localparam logic [COUNT-1:0] WHOLE = COUNT'(BIT - 1);

    logic [9:0]       frame;  // bits to come, the next at bit 0
    logic [3:0]       bits;
    logic [COUNT-1:0] left;   // clocks to the end of this bit

    assign ready = bits == 0;
    assign tx = frame[0];
    always_ff @(posedge clk) begin
        if (ready) begin
            left <= WHOLE;
            if (valid) begin
                frame <= {1'b1, data, 1'b0};
                bits <= 10;
            end
        end else if (left != 0) left <= left - 1;
        else begin
            frame <= {1'b1, frame[9:1]};  // a line that is idle is 1
            bits <= bits - 1;
            left <= WHOLE;
        end
        if (reset) begin
            frame <= 10'h3ff;
            bits <= 0;
        end
    end
endmodule
