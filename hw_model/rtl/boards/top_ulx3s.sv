// The core on a ULX3S: 25 MHz in, CLOCK_MHZ for the core, the serial line of the USB plug, four lights, button "fire 1".
// The board's .mk defines CLOCK_MHZ = 25 * PLL_FEEDBACK / PLL_INPUT, and PLL_OUTPUT, which keeps the PLL at 400 to 800 MHz.
`include "parameters.vh"
module top (
    input  logic       clk25,
    input  logic       rx,
    input  logic       button,
    output logic       tx,
    output logic [3:0] leds,
    output logic       esp32_gpio0
);
    // High, or the ESP32 on the board resets it.
    assign esp32_gpio0 = 1;

    wire clk;
    (* ICP_CURRENT="12", LPF_RESISTOR="8", MFG_ENABLE_FILTEROPAMP="1", MFG_GMCREF_SEL="2" *)
    EHXPLLL #(
        .PLLRST_ENA("DISABLED"), .INTFB_WAKE("DISABLED"), .STDBY_ENABLE("DISABLED"), .DPHASE_SOURCE("DISABLED"),
        .OUTDIVIDER_MUXA("DIVA"), .OUTDIVIDER_MUXB("DIVB"), .OUTDIVIDER_MUXC("DIVC"), .OUTDIVIDER_MUXD("DIVD"),
        .CLKI_DIV(`PLL_INPUT), .CLKOP_ENABLE("ENABLED"), .CLKOP_DIV(`PLL_OUTPUT), .CLKOP_CPHASE(`PLL_OUTPUT / 2 - 1),
        .CLKOP_FPHASE(0), .FEEDBK_PATH("CLKOP"), .CLKFB_DIV(`PLL_FEEDBACK)
    ) pll (
        .RST(1'b0), .STDBY(1'b0), .CLKI(clk25), .CLKOP(clk), .CLKFB(clk), .CLKINTFB(), .PHASESEL0(1'b0), .PHASESEL1(1'b0),
        .PHASEDIR(1'b1), .PHASESTEP(1'b1), .PHASELOADREG(1'b1), .PLLWAKESYNC(1'b0), .ENCLKOP(1'b0), .LOCK()
    );
    top_uart #(.CLOCK(`CLOCK_MHZ * 1000000), `PARAMETERS) board (.clk, .button, .rx, .tx, .leds);
endmodule
