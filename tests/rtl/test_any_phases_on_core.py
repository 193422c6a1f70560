"""Programs of several phases on the open core: every value and every cycle, and refused by name where it cannot."""

from __future__ import annotations

import shutil
from collections import Counter

import pytest

import hw_model as hw
from hw_model.rtl.comparison import compare
from hw_model.rtl.refused import refuse_unplayable
from hw_model.rtl.simulators import Simulator, sources
from tests.support import any_phases, benches
from tests.support.any_phases import FEW_ON_CORE

icarus = pytest.mark.skipif(
    shutil.which("iverilog") is None, reason="Icarus Verilog is not installed"
)
MANY = range(40, 340)


def check(seed: int, simulator: Simulator, texts: dict[str, str], *given) -> Counter[str]:
    """Return what was met; what the core refuses is not simulated. ``given``: sizes and patience."""
    case = any_phases.case(seed, plain=True)
    if not case.rows:
        return Counter()
    try:
        refuse_unplayable(case.program)
        comparison = compare(case.program, case.spikes, texts, simulator, *given)
    except hw.TargetError as refused:
        return Counter({str(refused).split(": ", 1)[1].split(" (")[0]: 1})
    assert (comparison["mismatches"], comparison["cycle_mismatches"]) == (0, 0), comparison
    begins = any(phase.align_events is not None for phase in case.program.phases)
    return Counter({
        "programs": 1, "of several phases": len(case.program.phases) > 1, "that begin at a touch": begins,
        "values": comparison["compared_values"],
    })  # fmt: skip


def play_few(texts: dict[str, str]) -> Counter[str]:
    return sum(
        (check(seed, "icarus", texts, benches.SIZES, 20_000) for seed in FEW_ON_CORE), Counter()
    )


@pytest.mark.slow
@icarus
def test_the_core_plays_any_phases(cores_of_this_run):
    met = play_few(sources())
    assert met["programs"] == len(FEW_ON_CORE)
    assert min(met["of several phases"], met["that begin at a touch"]) > 3, met


@icarus
def test_a_core_with_a_fault_does_not(cores_of_this_run):
    with pytest.raises(AssertionError):
        play_few(benches.with_fault(sources()))


@pytest.mark.minutes
@pytest.mark.skipif(shutil.which("verilator") is None, reason="Verilator is not installed")
def test_the_core_plays_many():
    met = sum((check(seed, "verilator", sources()) for seed in MANY), Counter())
    assert met["programs"] >= len(MANY) / 3
    assert min(met["of several phases"], met["that begin at a touch"]) > 30, met
