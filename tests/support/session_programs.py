"""What a session has to say after every step, from whole runs; and a program for recordings of any length."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from hypothesis import strategies as st

import hw_model as hw
from tests.support.hybrids import CHIP
from tests.support.register_units import FORGETS_AT_ONCE

SEEDS = st.integers(0, 2**32 - 1)
TOGETHER = st.integers(1, 3)
"""Channels that the location phase visits at one step."""


def joined_scores(parts: Sequence[hw.StepScores]) -> hw.StepScores:
    """Return the scores of several pushes as one, as if all rows had been pushed at once."""
    spikes = {}
    for name in parts[0].spikes:
        spikes[name] = np.concatenate([part.spikes[name] for part in parts])
    potential = {}
    for name in parts[0].potential:
        potential[name] = np.concatenate([part.potential[name] for part in parts])
    return hw.StepScores(spikes, potential, np.concatenate([part.scores for part in parts]))


def cut_after_every_step(recording: np.ndarray) -> np.ndarray:
    """The recording up to every step, followed by silence: (steps, steps, channels)."""
    until = np.tri(len(recording), dtype=np.uint8)
    return until[:, :, None] * recording


def largest_potential_so_far(potential: np.ndarray, first: int) -> np.ndarray:
    """The largest of each column up to every step (steps, n), from step ``first`` on, and 0 before that."""
    return np.stack([potential[first : t + 1].max(axis=0, initial=-(2**40)) if t >= first else 0 * potential[t]
                     for t in range(len(potential))])  # fmt: skip


def check_session_after_every_step(
    program: hw.ChipProgram, recording: np.ndarray, session_scores
) -> None:
    """Check what a session said after every step (:class:`hw.StepScores`) against whole runs of the reference.

    Populations of a time phase have the spikes up to the step; those of a location phase have what a run gives of the
    recording up to the step, with silence after it. Where potentials predict, it is the largest of them.
    """
    whole = hw.simulate(program, recording, probe=("spikes", "potential"))
    again = hw.simulate(program, cut_after_every_step(recording), probe=("spikes", "potential"))
    expected = np.zeros_like(session_scores.scores)
    axis = {name: phase.axis for phase in program.phases for name in program.columns_of(phase.name)}
    for name, weight in program.readout.terms:
        first = program.readout.from_step.get(name)
        if first is not None:
            counts = largest_potential_so_far(whole.potential[name][: len(recording)], first)
            if axis[name] == "location":
                counts = np.stack(
                    [largest_potential_so_far(one, first)[-1] for one in again.potential[name]]
                )
        elif axis[name] == "time":
            counts = whole.spikes[name].cumsum(axis=0, dtype=np.int64)[: len(recording)]
        else:
            counts = again.spikes[name].sum(axis=1, dtype=np.int64)
        assert np.array_equal(
            (session_scores.spikes if first is None else session_scores.potential)[name], counts
        ), name
        expected += weight * counts
    assert np.array_equal(session_scores.scores, expected)
    assert np.array_equal(session_scores.scores[-1], whole.scores)
    assert np.array_equal(session_scores.prediction, expected.argmax(axis=1))
    ordered = np.sort(expected, axis=1)
    assert np.array_equal(
        session_scores.lead, ordered[:, -1] - (ordered[:, -2] if expected.shape[1] > 1 else 0)
    )


def live_program() -> hw.ChipProgram:
    """One live phase with recurrence, a delay and a bias, which a recording of any length can be played to."""
    builder = hw.ProgramBuilder(CHIP)
    x = builder.add_input("touch", 6)
    h = builder.add_compartments("h", 20, decay_u=1024, decay_v=128, threshold=1000, refractory=3)
    y = builder.add_compartments(
        "y", 3, decay_u=FORGETS_AT_ONCE, decay_v=400, threshold=600, bias=[0, 64, 640]
    )
    r = np.random.default_rng(4)
    builder.connect(x, h, 2 * r.integers(-60, 100, (20, 6)))
    builder.connect(h, h, 2 * r.integers(-60, 40, (20, 20)), delay=5)
    builder.connect(h, y, 2 * r.integers(-60, 100, (3, 20)))
    builder.read_out(y)
    return builder.build()
