"""What a recording counts, by sums over its events and spikes, from the graph and from where compartments lie.

Shares no code with what counts: loops over events, spikes and synapses one by one.
"""

from __future__ import annotations

from collections import Counter

import numpy as np

import hw_model as hw
from hw_model.program.chip_program import Core
from tests.support.any_phases import Case
from tests.support.played_events import extent, played

COUNTED = (
    "input_events", "transpose_events", "events_dropped", "synaptic_ops", "synaptic_ops_after_end", "neuron_updates",
    "spikes", "axon_packets", "packets_within_tile", "input_packets", "hops_x", "hops_y", "aligned_steps",
)  # fmt: skip
"""Counts that follow from events and spikes; the others are of registers."""


def counts_of(case: Case, spikes: dict[str, np.ndarray], recording: int) -> Counter[str]:
    """Return the counts of one recording with the ``spikes`` (batch, steps, n) of its populations."""
    program = case.program
    found = Counter[str]()
    core_of = {
        (piece.group, i): core
        for core in program.cores
        for piece in core.slices
        for i in range(piece.start, piece.stop)
    }
    heard = {name: array[recording] for name, array in case.spikes.items()}
    for phase in program.phases:
        touch, begin, end = extent(case.graph, phase, heard, case.steps)
        sent: list[tuple[str, int, int]] = []
        for item in program.inputs_of(phase.name):
            events = played(case.graph, item, phase, heard, case.steps)
            found["transpose_events" if item.positions is not None else "input_events"] += len(
                events
            )
            found["events_dropped"] += int(case.spikes[item.stream][recording].sum()) - len(events)
            sent += [(item.name, line, step) for step, line in events]
        for name in program.columns_of(phase.name).keys() & program.spiking:
            fired = [(name, i, step) for step, i in np.argwhere(spikes[name][recording]).tolist()]
            found["spikes"] += len(fired)
            sent += fired
        found["neuron_updates"] += (end - begin) * sum(
            program.populations[n] for n in program.columns_of(phase.name)
        )
        found["aligned_steps"] += touch
        for source, i, step in sent:
            reached_cores: set[int] = set()
            for synapses in case.graph.synapses:
                if synapses.source == source:
                    reached = np.flatnonzero(synapses.source_index == i)
                    found["synaptic_ops"] += len(reached)
                    found["synaptic_ops_after_end"] += int(
                        (step + 1 + synapses.delay[reached] >= end).sum()
                    )
                    reached_cores |= {
                        core_of[synapses.target, j].number
                        for j in synapses.target_index[reached].tolist()
                    }
            _send(program, core_of.get((source, i)), sorted(reached_cores), found)
    return found


def _send(
    program: hw.ChipProgram, sender: Core | None, targets: list[int], found: Counter[str]
) -> None:
    """Count packets to cores by number, and their hops; a spike of no sender comes from outside."""
    if sender is None:
        found["input_packets"] += len(targets)
        return
    for number in targets:
        x, y = program.chip.hops(sender.slot, program.cores[number].slot)
        found += Counter(
            {"axon_packets": 1, "packets_within_tile": x + y == 0, "hops_x": x, "hops_y": y}
        )
