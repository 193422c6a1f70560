"""An engine against the oracle: every register of every step, every event, the busy updates and the scores."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

import hw_model as hw
from hw_model.mapping.graph import CompartmentGraph
from tests.support import loihi_oracle as oracle

Recordings = Mapping[str, np.ndarray]
"""Recordings (batch, rows, channels) by stream."""


def play_all(
    graph: CompartmentGraph, chip: hw.Chip, spikes: Recordings, steps: int | None
) -> list[oracle.Played]:
    """Let the oracle play each recording."""
    batch = len(next(iter(spikes.values())))
    recordings = [{name: array[b] for name, array in spikes.items()} for b in range(batch)]
    return [oracle.play(graph, chip, recording, steps) for recording in recordings]


def check_oracle(
    program: hw.ChipProgram,
    graph: CompartmentGraph,
    spikes: Recordings,
    steps: int | None,
    engine: str,
) -> None:
    """Play recordings to a program, and to the graph that it was made of."""
    check_played(program, spikes, steps, engine, play_all(graph, program.chip, spikes, steps))


def check_played(
    program: hw.ChipProgram,
    spikes: Recordings,
    steps: int | None,
    engine: str,
    expected: Sequence[oracle.Played],
) -> None:
    """Play recordings to a program, of which the oracle has played the graph."""
    result = hw.simulate(program, spikes, steps, engine=engine, probe=oracle.KINDS)
    assert len(result.per_recording) == len(expected)
    events: dict[str, dict[str, int]] = {}
    for b, (counts, wanted) in enumerate(zip(result.per_recording, expected, strict=True)):
        for kind in oracle.KINDS:
            for name, array in getattr(result, kind).items():
                assert np.array_equal(array[b], wanted.arrays[kind][name]), (kind, name, b)
        for event in oracle.EVENTS:
            total = sum(met[event] for met in wanted.events.values())
            assert counts[event] == total, (event, b)
        assert counts.neuron_updates_active == wanted.active, b
        for name, met in wanted.events.items():
            sums = events.setdefault(name, dict.fromkeys(oracle.EVENTS, 0))
            for event in oracle.EVENTS:
                sums[event] += met[event]
        if wanted.scores is not None:
            assert np.array_equal(result.scores[b], wanted.scores, equal_nan=True), b
    assert {name: dict(met) for name, met in result.events.items()} == events
