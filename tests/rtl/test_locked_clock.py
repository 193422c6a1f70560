"""The top module of a board holds the core in reset until the PLL that makes its clock has locked.

Icarus Verilog plays the generated top with stand-ins for the PLL and the core.
"""

import shutil
import subprocess
from pathlib import Path

import pytest

from hw_model.description.board import board as read_board
from hw_model.rtl.board_sources import board_sources

STAND_INS = r"""
`timescale 1ns/1ns
// The PLLs of both families, which lock 1,000 ns after the start, and a core that shows its reset.
module EHXPLLL #(parameter PLLRST_ENA="", INTFB_WAKE="", STDBY_ENABLE="", DPHASE_SOURCE="",
    OUTDIVIDER_MUXA="", OUTDIVIDER_MUXB="", OUTDIVIDER_MUXC="", OUTDIVIDER_MUXD="", FEEDBK_PATH="",
    CLKI_DIV=1, CLKFB_DIV=1, CLKOP_ENABLE="", CLKOP_DIV=1, CLKOP_CPHASE=0, CLKOP_FPHASE=0,
    CLKOS_ENABLE="", CLKOS_DIV=1, CLKOS_CPHASE=0, CLKOS_FPHASE=0) (
    input RST, STDBY, CLKI, CLKFB, PHASESEL0, PHASESEL1, PHASEDIR, PHASESTEP, PHASELOADREG,
    PLLWAKESYNC, ENCLKOP, output CLKOP, CLKOS, CLKINTFB, output reg LOCK);
    assign CLKOP = CLKI; assign CLKOS = CLKI;
    initial begin LOCK = 0; #1000 LOCK = 1; end
endmodule
module SB_PLL40_PAD #(parameter FEEDBACK_PATH="", DIVR=0, DIVF=0, DIVQ=0, FILTER_RANGE=0) (
    input PACKAGEPIN, RESETB, BYPASS, output PLLOUTGLOBAL, output reg LOCK);
    assign PLLOUTGLOBAL = PACKAGEPIN;
    initial begin LOCK = 0; #1000 LOCK = 1; end
endmodule
module top_uart #(parameter CLOCK = 0) (input clk, button, rx, output tx, output [3:0] leds);
    assign tx = rx; assign leds = {3'b0, button};
endmodule
module bench;
    reg clock = 0, pressed = 0;
    always #10 clock = !clock;
    `ifdef ULX3S
    wire [3:0] leds;
    top board (.clk25(clock), .rx(1'b1), .button(pressed), .tx(), .leds(leds), .esp32_gpio0());
    wire resets = leds[0];
    `else
    wire [1:0] leds_n;
    top board (.clk12(clock), .rx(1'b1), .button_n(!pressed), .tx(), .leds(leds_n));
    wire resets = !leds_n[0];
    `endif
    initial begin
        #900 $display("before the lock %b", resets);
        #200 $display("locked %b", resets);
        pressed = 1;
        #100 $display("pressed %b", resets);
        $finish;
    end
endmodule
"""


@pytest.mark.skipif(shutil.which("iverilog") is None, reason="no Icarus Verilog on this machine")
@pytest.mark.parametrize("board", ["ulx3s-25f", "icebreaker"])
def test_the_core_is_reset_until_its_clock_has_locked(board: str, tmp_path: Path) -> None:
    (tmp_path / "parameters.vh").write_text("")
    (tmp_path / "bench.sv").write_text(STAND_INS)
    files = board_sources(read_board(board), "ecp5-25f")
    top = files[f"{board}.top.sv"].replace(", `PARAMETERS)", ")")
    (tmp_path / "top.sv").write_text(top)
    defined = ["-DULX3S"] if board == "ulx3s-25f" else []
    options = ["-g2012", "-s", "bench", *defined]
    build = ["iverilog", *options, "-o", "bench.vvp", "bench.sv", "top.sv"]
    subprocess.run(build, cwd=tmp_path, check=True)
    played = subprocess.run(
        ["vvp", "-n", "bench.vvp"], cwd=tmp_path, check=True, capture_output=True, text=True
    )
    assert played.stdout.splitlines()[:3] == ["before the lock 1", "locked 0", "pressed 1"]
