// The core on a ULX3S: 25 MHz in, 25 * PLL_UP / PLL_DOWN for the core, the serial line of the USB plug, four lights, button
// "fire 1". The board's .mk defines the two; 25 * PLL_UP is the frequency inside the PLL, 400 to 800 MHz.
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

    wire clk, same, locked;
    (* ICP_CURRENT="12", LPF_RESISTOR="8", MFG_ENABLE_FILTEROPAMP="1", MFG_GMCREF_SEL="2" *)
    EHXPLLL #(
        .PLLRST_ENA("DISABLED"), .INTFB_WAKE("DISABLED"), .STDBY_ENABLE("DISABLED"), .DPHASE_SOURCE("DISABLED"),
        .OUTDIVIDER_MUXA("DIVA"), .OUTDIVIDER_MUXB("DIVB"), .OUTDIVIDER_MUXC("DIVC"), .OUTDIVIDER_MUXD("DIVD"),
        .FEEDBK_PATH("CLKOP"), .CLKI_DIV(1), .CLKFB_DIV(1),
        .CLKOP_ENABLE("ENABLED"), .CLKOP_DIV(`PLL_UP), .CLKOP_CPHASE(`PLL_UP / 2 - 1), .CLKOP_FPHASE(0),
        .CLKOS_ENABLE("ENABLED"), .CLKOS_DIV(`PLL_DOWN), .CLKOS_CPHASE(`PLL_DOWN / 2 - 1), .CLKOS_FPHASE(0)
    ) pll (
        .RST(1'b0), .STDBY(1'b0), .CLKI(clk25), .CLKOP(same), .CLKFB(same), .CLKOS(clk), .CLKINTFB(), .PHASESEL0(1'b0), .PHASESEL1(1'b0),
        .PHASEDIR(1'b1), .PHASESTEP(1'b1), .PHASELOADREG(1'b1), .PLLWAKESYNC(1'b0), .ENCLKOP(1'b0), .LOCK(locked)
    );
    // Until the PLL has locked, its clock may be faster than the core is timed for.
    top_uart #(.CLOCK(25000000 * `PLL_UP / `PLL_DOWN), `PARAMETERS) board (.clk, .button(button || !locked), .rx, .tx, .leds);
endmodule
