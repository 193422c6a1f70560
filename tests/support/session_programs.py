"""Check what a session reports after every step against whole runs, and a program for recordings of any length.

A session (``hw_model/streaming``) takes a recording row by row, and reports scores after each row.
"""

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
    """Return copies of a recording, number t cut to silence after step t: (steps, steps, channels)."""
    up_to_step = np.tri(len(recording), dtype=np.uint8)
    return up_to_step[:, :, None] * recording


def largest_potential_so_far(potential: np.ndarray, first: int) -> np.ndarray:
    """Return the largest potential of each neuron from step ``first`` to every step (steps, n), and 0 before that."""
    largest = np.zeros_like(potential)
    largest[first:] = np.maximum.accumulate(potential[first:], axis=0)
    return largest


def check_session_after_every_step(
    program: hw.ChipProgram, recording: np.ndarray, session_scores
) -> None:
    """Check what a session reported after every step (:class:`hw.StepScores`) against whole runs of the reference.

    Populations of a time phase have their spikes up to the step. Populations of a location phase have the spikes of a
    run of the recording up to the step, with silence after it. Where potentials predict, the largest potential counts
    instead of the spikes.
    """
    whole = hw.simulate(program, recording, probe=("spikes", "potential"))
    cut = hw.simulate(program, cut_after_every_step(recording), probe=("spikes", "potential"))
    expected = np.zeros_like(session_scores.scores)
    axis = {name: phase.axis for phase in program.phases for name in program.columns_of(phase.name)}
    for name, weight in program.readout.terms:
        first = program.readout.from_step.get(name)
        if first is not None:
            counts = largest_potential_so_far(whole.potential[name][: len(recording)], first)
            if axis[name] == "location":
                largest = [largest_potential_so_far(run, first)[-1] for run in cut.potential[name]]
                counts = np.stack(largest)
        elif axis[name] == "time":
            counts = whole.spikes[name].cumsum(axis=0, dtype=np.int64)[: len(recording)]
        else:
            counts = cut.spikes[name].sum(axis=1, dtype=np.int64)
        reported = session_scores.spikes if first is None else session_scores.potential
        assert np.array_equal(reported[name], counts), name
        expected += weight * counts
    assert np.array_equal(session_scores.scores, expected)
    assert np.array_equal(session_scores.scores[-1], whole.scores)
    assert np.array_equal(session_scores.prediction, expected.argmax(axis=1))
    ordered = np.sort(expected, axis=1)
    second_best = ordered[:, -2] if expected.shape[1] > 1 else 0
    assert np.array_equal(session_scores.lead, ordered[:, -1] - second_best)


def live_program() -> hw.ChipProgram:
    """Return a program of one time phase without a fixed length, with recurrence, a delay and a bias."""
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
