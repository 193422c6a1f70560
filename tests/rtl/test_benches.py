"""Faults planted in the core's SystemVerilog: the benches must find each."""

from __future__ import annotations

import shutil
from functools import cache
from pathlib import Path

import pytest
import yaml
from benches import SIZES, all_benches

import hw_model as hw
from hw_model.rtl.comparison import compare
from hw_model.rtl.simulators import sources

pytestmark = pytest.mark.skipif(shutil.which("iverilog") is None, reason="Icarus Verilog is not installed")
MUTANTS = yaml.safe_load((Path(__file__).parent / "mutants.yaml").read_text())
benches = cache(all_benches)


@pytest.fixture(autouse=True)
def _cache_of_its_own(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))


STOPPING = """module clock_gate (input logic clk, input logic enable, output logic gated);
    logic open;
    always_latch if (!clk) open = enable;
    assign gated = clk && open;
endmodule
"""
"""What a chip puts in place of `clock_gate.sv`."""


def differ(texts) -> bool:
    """Whether a bench tells these files from the core; a core that hangs is given up soon."""
    for program, spikes in benches():
        found = compare(program, spikes, texts, "icarus", sizes=SIZES, patience=20000)
        if found["mismatches"] or found["cycle_mismatches"]:
            return True
    return False


def test_the_benches_wrap_and_clip():
    met = sum((hw.simulate(program, spikes, probe=()).counts for program, spikes in benches()), hw.Counts())
    assert min(met.charge_wraps, met.current_wraps, met.voltage_clips) > 10


def test_the_core_passes_every_bench():
    assert not differ(sources())


def test_clocks_that_stop_change_nothing():
    assert not differ({**sources(), "clock_gate.sv": STOPPING})


def test_there_are_enough_mutants():
    assert len(MUTANTS) >= 20
    for mutant in MUTANTS:
        assert sources()[mutant["file"]].count(mutant["old"]) == 1, mutant["id"]


@pytest.mark.slow
@pytest.mark.parametrize("mutant", MUTANTS, ids=lambda mutant: mutant["id"])
def test_every_mutant_is_found(mutant):
    text = sources()[mutant["file"]].replace(mutant["old"], mutant["new"])
    assert differ({**sources(), "clock_gate.sv": STOPPING, mutant["file"]: text})
