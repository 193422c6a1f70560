// The core on an iCEBreaker: 12 MHz in, 24 MHz for the core, the serial line of the USB plug, two lights, the user button.
// Green: a program is there. Red: an error since reset.
`include "parameters.vh"
module top (
    input  logic clk12,
    input  logic rx,
    input  logic button_n,
    output logic tx,
    output logic led_red_n,
    output logic led_green_n
);
    wire       clk, locked;
    wire [3:0] leds;
    SB_PLL40_PAD #(
        .FEEDBACK_PATH("SIMPLE"), .DIVR(4'd0), .DIVF(7'd63), .DIVQ(3'd5), .FILTER_RANGE(3'd1)
    ) pll (.PACKAGEPIN(clk12), .PLLOUTGLOBAL(clk), .RESETB(1'b1), .BYPASS(1'b0), .LOCK(locked));
    // Until the PLL has locked, its clock may be faster than the core is timed for.
    top_uart #(.CLOCK(24000000), `PARAMETERS) board (.clk, .button(!button_n || !locked), .rx, .tx, .leds);
    assign led_red_n = !leds[3];
    assign led_green_n = !leds[0];
endmodule
