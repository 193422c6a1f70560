"""Count events, spikes, synaptic operations and packets of a recording by plain loops.

This is the independent answer for the counts of ``hw_model/accounting``, with which it shares no code: it goes through
events, spikes and synapses one by one, in the graph, and looks up the cores of compartments in the program.
"""

from __future__ import annotations

from collections import Counter

import numpy as np

import hw_model as hw
from hw_model.program.chip_program import Core
from tests.support.any_phases import Case
from tests.support.played_events import extent, played

COUNTED = (
    "input_events",
    "transpose_events",
    "events_dropped",
    "synaptic_ops",
    "synaptic_ops_after_end",
    "neuron_updates",
    "spikes",
    "axon_packets",
    "packets_within_tile",
    "input_packets",
    "hops_x",
    "hops_y",
    "aligned_steps",
)
"""Counts that follow from events and spikes; the other counts are of registers, see ``loihi_oracle``."""


def counts_of(case: Case, spikes: dict[str, np.ndarray], recording: int) -> Counter[str]:
    """Return the counts of one recording with the ``spikes`` (batch, steps, n) of its populations."""
    program = case.program
    counts = Counter[str]()
    core_of = {}
    for core in program.cores:
        for piece in core.slices:  # neighbouring compartments of one population
            for i in range(piece.start, piece.stop):
                core_of[piece.group, i] = core
    rows_by_stream = {name: array[recording] for name, array in case.spikes.items()}
    for phase in program.phases:
        touch, begin, end = extent(case.graph, phase, rows_by_stream, case.steps)
        sent: list[tuple[str, int, int]] = []  # (source, index, step) of input events and spikes
        for item in program.inputs_of(phase.name):
            events = played(case.graph, item, phase, rows_by_stream, case.steps)
            kind = "input_events" if item.positions is None else "transpose_events"
            counts[kind] += len(events)
            counts["events_dropped"] += int(rows_by_stream[item.stream].sum()) - len(events)
            sent += [(item.name, line, step) for step, line in events]
        for name in program.columns_of(phase.name).keys() & program.spiking:
            fired = [(name, i, step) for step, i in np.argwhere(spikes[name][recording]).tolist()]
            counts["spikes"] += len(fired)
            sent += fired
        compartments = sum(program.populations[name] for name in program.columns_of(phase.name))
        counts["neuron_updates"] += (end - begin) * compartments
        counts["aligned_steps"] += touch
        for source, i, step in sent:
            target_cores: set[int] = set()
            for synapses in case.graph.synapses:
                if synapses.source != source:
                    continue
                of_source = np.flatnonzero(synapses.source_index == i)
                acts_in_step = step + 1 + synapses.delay[of_source]
                counts["synaptic_ops"] += len(of_source)
                counts["synaptic_ops_after_end"] += int((acts_in_step >= end).sum())
                for target in synapses.target_index[of_source].tolist():
                    target_cores.add(core_of[synapses.target, target].number)
            _count_packets(program, core_of.get((source, i)), sorted(target_cores), counts)
    return counts


def _count_packets(
    program: hw.ChipProgram, sender: Core | None, target_cores: list[int], counts: Counter[str]
) -> None:
    """Add the packets of one spike, one per target core, and their hops; input events have no sending core."""
    if sender is None:
        counts["input_packets"] += len(target_cores)
        return
    for number in target_cores:
        hops_x, hops_y = program.chip.hops(sender.slot, program.cores[number].slot)
        counts["axon_packets"] += 1
        counts["packets_within_tile"] += hops_x + hops_y == 0
        counts["hops_x"] += hops_x
        counts["hops_y"] += hops_y
