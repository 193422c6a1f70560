"""Programs that the open core cannot run are refused with a message of one line, which names the reason."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import hw_model as hw
from hw_model.mapping.graph import Phase, Readout
from hw_model.rtl.images import CoreProgram
from tests.support import benches, hybrids
from tests.support.register_units import KEEPS_ALL

CHANNELS = 3
"""Of all recordings here. A function for each reason makes a program that the core cannot run."""


def branch(name: str, phase: Phase, lines: int = CHANNELS, *visits: dict):
    """Return the graph of a small random branch in a phase; ``visits`` are the fields of its inputs."""
    r = np.random.default_rng(1)
    return hybrids.moved(hybrids.random_branch(r, name, lines, 2, benches.CHIP), phase, *visits)


def other_widths() -> hw.ChipProgram:
    """A chip whose currents have 20 bits; those of the core have 23."""
    chip = replace(benches.CHIP, registers=replace(benches.CHIP.registers, current_bits=20))
    b = hw.ProgramBuilder(chip, name="program")
    b.connect(
        b.add_input("x", 1),
        b.add_compartments("y", 1, decay_u=KEEPS_ALL, decay_v=KEEPS_ALL, threshold=1),
        [[2]],
    )
    return b.build()


def heavy_weights() -> hw.ChipProgram:
    """A readout with the weight 0.1, which as a binary fraction has 53 bits."""
    return hybrids.program_of_graphs(
        benches.CHIP, Readout(("a/y",), (0.1,)), branch("a", Phase("a", "time", steps=5))
    )


def two_starts() -> hw.ChipProgram:
    """Two phases that begin with the first row of one event, and of two; the core finds only one such row."""
    return benches.together(
        branch("a", Phase("a", "time", steps=5, align_events=1)),
        branch("b", Phase("b", "time", steps=5, align_events=2)),
    )


def late_potentials() -> hw.ChipProgram:
    """Potentials are read out of a phase that begins at the first event, not with the recording."""
    return hybrids.program_of_graphs(
        benches.CHIP,
        Readout(("a/y",), (1.0,), potentials_from=2),
        branch("a", Phase("a", "time", steps=5, align_events=1)),
    )


def a_stream_of_two() -> hw.ChipProgram:
    """A phase begins at an event of one stream, and another phase hears a second stream."""
    other = branch("b", Phase("b", "time", steps=5))
    other = replace(other, inputs=tuple(replace(item, stream="other") for item in other.inputs))
    return benches.together(branch("a", Phase("a", "time", steps=5, align_events=1)), other)


def different_lengths() -> hw.ChipProgram:
    """A phase reads four rows of each channel for one input, and five for another."""
    b = hw.ProgramBuilder(benches.CHIP)
    y = b.add_compartments("a/y", 2, decay_u=390, decay_v=300, threshold=60)
    for rows in (4, 5):
        b.connect(b.add_input(f"x{rows}", rows), y, np.full((2, rows), 20))
    at = {"positions": np.arange(CHANNELS)}
    return benches.together(hybrids.moved(b.graph(), Phase("a", "location", CHANNELS), at, at))


def two_first_steps() -> hw.ChipProgram:
    """Potentials of two groups of a phase are read out from steps 1 and 2 on."""
    b = hw.ProgramBuilder(benches.CHIP)
    x = b.add_input("x", 1)
    for name in ("y", "z"):
        b.connect(x, b.add_compartments(name, 1, decay_u=390, decay_v=300, threshold=60), [[20]])
    return hybrids.program_of_graphs(
        benches.CHIP, Readout(("y", "z"), (1.0, 1.0), potentials_from=(1, 2)), b.graph()
    )


def a_long_phase() -> hw.ChipProgram:
    """A later phase of 2^16 steps; the core stores the step of a visit in 16 bits."""
    visit = {"positions": np.arange(CHANNELS)}
    return benches.together(branch("a", Phase("a", "location", 1 << 16), CHANNELS, visit))


# What the core does not have, as the message says it, by the program that asks for it.
CASES = {
    other_widths: "current_bits other than 23 (20)",
    heavy_weights: "weight of a readout of more than 32 bits as a whole number (3602879701896397)",
    two_starts: "phases that start at different numbers of events ([1, 2])",
    late_potentials: "readout of potentials of a phase that starts late ('a')",
    a_stream_of_two: "start by some of several streams (touch)",
    different_lengths: "phase of transposed inputs of different lengths ([4, 5])",
    a_long_phase: "phase of more than 65535 steps after the first (65536)",
    two_first_steps: "readout of potentials from several steps of a phase ([1, 2])",
}


def load_words(program: hw.ChipProgram) -> np.ndarray:
    """Return the words of a program for recordings of 8 steps, in a core of just the sizes that it needs."""
    core = CoreProgram(program, rows=8)
    return core.load_words(core.needs)


@pytest.mark.parametrize(
    ("program_of", "reason"), CASES.items(), ids=[program_of.__name__ for program_of in CASES]
)
def test_what_the_core_does_not_have_is_named(program_of, reason):
    program = program_of()
    with pytest.raises(hw.TargetError) as caught:
        load_words(program)
    assert str(caught.value) == (
        f"program {program.name!r}: the open core has no {reason}. Simulate it instead."
    )
