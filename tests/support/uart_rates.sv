// Every byte from a sender of bits of HOST_BIT clocks to a receiver of bits of BIT clocks, one after the other without a
// pause, then a pulse that is too short for a start bit; prints what comes, and `broken` for a byte without its stop bit.
module uart_rates #(
    parameter integer BIT = 100,
    parameter integer HOST_BIT = 100
) ();
    logic       clk = 0, reset = 1;
    wire        ready, line, valid, broken;
    wire  [7:0] data;
    integer     next = 0, silent = 0;
    uart_tx #(.BIT(HOST_BIT)) sender (.clk, .reset, .valid(next < 256), .ready, .data(next[7:0]), .tx(line));
    uart_rx #(.BIT(BIT)) receiver (.clk, .reset, .rx(line && !pulse), .valid, .data, .broken);
    wire        pulse = silent > 12 * HOST_BIT && silent <= 12 * HOST_BIT + BIT / 4;
    always #5 clk = !clk;
    always @(posedge clk) begin
        reset <= 0;
        if (!reset && ready && next < 256) next <= next + 1;
        if (valid) $display("%0d", data);
        if (broken) $display("broken");
        silent <= next == 256 ? silent + 1 : 0;
        if (silent == 30 * HOST_BIT) $finish;
    end
endmodule
