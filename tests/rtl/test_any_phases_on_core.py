"""Random programs of several phases on the open core: it does what the simulator does, in as many cycles as predicted.

Programs that the core cannot run are refused, and counted by the reason.
"""

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
"""Seeds of programs for the long run; FEW_ON_CORE are those of the short run."""
PATIENCE = 20_000
"""Cycles of silence after which a faulty core is given up; none of these recordings takes as many."""


def check(seed: int, simulator: Simulator, texts: dict[str, str], **options) -> Counter[str]:
    """Play the program of a seed on the core and in the simulator; return what kind of program it was.

    A program that the core refuses is counted by the reason. ``options`` are the sizes and the patience of `compare`.
    """
    case = any_phases.case(seed, plain=True)
    if not case.rows:
        return Counter()  # a recording of no steps cannot be streamed
    try:
        refuse_unplayable(case.program)
        comparison = compare(case.program, case.spikes, texts, simulator, **options)
    except hw.TargetError as error:
        # Without the name of the program in front, and the measured value behind.
        reason = str(error).split(": ", 1)[1].split(" (")[0]
        return Counter({reason: 1})
    assert (comparison["mismatches"], comparison["cycle_mismatches"]) == (0, 0), comparison
    is_aligned = any(phase.align_events is not None for phase in case.program.phases)
    return Counter({
        "programs": 1, "of several phases": len(case.program.phases) > 1, "that begin at a touch": is_aligned,
        "values": comparison["compared_values"],
    })  # fmt: skip


def play_few(texts: dict[str, str]) -> Counter[str]:
    """Check the programs of the short run; return how many of each kind there were."""
    kinds: Counter[str] = Counter()
    for seed in FEW_ON_CORE:
        kinds += check(seed, "icarus", texts, sizes=benches.SIZES, patience=PATIENCE)
    return kinds


@pytest.mark.slow
@icarus
def test_the_core_plays_any_phases(cores_of_this_run):
    kinds = play_few(sources())
    assert kinds["programs"] == len(FEW_ON_CORE)
    assert min(kinds["of several phases"], kinds["that begin at a touch"]) > 3, kinds


@icarus
def test_a_core_with_a_fault_does_not_play_them(cores_of_this_run):
    with pytest.raises(AssertionError):
        play_few(benches.with_fault(sources()))


@pytest.mark.minutes
@pytest.mark.skipif(shutil.which("verilator") is None, reason="Verilator is not installed")
def test_the_core_plays_many():
    kinds = sum((check(seed, "verilator", sources()) for seed in MANY), Counter())
    # The core refuses the others.
    assert kinds["programs"] >= len(MANY) / 3
    assert min(kinds["of several phases"], kinds["that begin at a touch"]) > 30, kinds
