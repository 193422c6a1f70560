"""An engine against the oracle: every register of every step, every event, the busy updates and the scores."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import oracle

import hw_model as hw
from hw_model.mapping.graph import CompartmentGraph


def check_oracle(
    program: hw.ChipProgram,
    graph: CompartmentGraph,
    spikes: Mapping[str, np.ndarray],
    steps: int | None,
    engine: str,
) -> None:
    """Play recordings (batch, rows, channels) by stream to a program, and to the graph that it was made of."""
    result = hw.simulate(program, spikes, steps, engine=engine, probe=oracle.KINDS)
    events: dict[str, dict[str, int]] = {}
    for b, counts in enumerate(result.per_recording):
        recording = {name: array[b] for name, array in spikes.items()}
        wanted = oracle.play(graph, program.chip, recording, steps)
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
