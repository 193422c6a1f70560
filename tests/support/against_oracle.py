"""Check an engine against ``loihi_oracle``, an independent simulator of the same graph.

Compared are every register in every step, wraps and clips, the count of active updates, and the scores.
"""

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
    """Check an engine's play of recordings against the oracle's, which plays the graph of the same program."""
    check_played(program, spikes, steps, engine, play_all(graph, program.chip, spikes, steps))


def check_played(
    program: hw.ChipProgram,
    spikes: Recordings,
    steps: int | None,
    engine: str,
    expected: Sequence[oracle.Played],
) -> None:
    """Check an engine's play of recordings; ``expected`` holds what the oracle played, one item per recording."""
    result = hw.simulate(program, spikes, steps, engine=engine, probe=oracle.KINDS)
    assert len(result.per_recording) == len(expected)
    events: dict[str, dict[str, int]] = {}
    for b, (counts, expected_play) in enumerate(zip(result.per_recording, expected, strict=True)):
        for kind in oracle.KINDS:
            for name, array in getattr(result, kind).items():
                assert np.array_equal(array[b], expected_play.arrays[kind][name]), (kind, name, b)
        for event in oracle.EVENTS:
            total = sum(occurred[event] for occurred in expected_play.events.values())
            assert counts[event] == total, (event, b)
        assert counts.neuron_updates_active == expected_play.active, b
        # The result's own table counts each population's events over all recordings.
        for name, occurred in expected_play.events.items():
            sums = events.setdefault(name, dict.fromkeys(oracle.EVENTS, 0))
            for event in oracle.EVENTS:
                sums[event] += occurred[event]
        if expected_play.scores is not None:
            assert np.array_equal(result.scores[b], expected_play.scores, equal_nan=True), b
    assert {name: dict(occurred) for name, occurred in result.events.items()} == events
