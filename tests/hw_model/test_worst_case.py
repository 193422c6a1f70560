"""Bounds on time, queues and the buffer: against numbers by hand, and against hostile recordings of random programs."""

from __future__ import annotations

import numpy as np
import pytest

import hw_model as hw
from hw_model.accounting.usage import measure
from hw_model.mapping.graph import Readout
from tests.support import any_phases, cost_programs
from tests.support.hostile_recordings import hostile
from tests.support.hybrids import CHIP, graph_in_phase, program_of_graphs
from tests.support.register_units import FORGETS_AT_ONCE, KEEPS_ALL

# Nanoseconds of the profile davies2018: two active updates, a packet within a tile, a synaptic operation, a barrier.
UPDATES = 2 * 8.4
WITHIN_TILE = 2.1
SYNAPSE = 3.5
BARRIER = 113.0


@pytest.mark.parametrize(
    ("events", "step_ns"),
    [
        pytest.param(0, UPDATES + WITHIN_TILE + SYNAPSE + BARRIER, id="inner spikes alone"),
        pytest.param(1, UPDATES + WITHIN_TILE + 2 * SYNAPSE + BARRIER, id="and an event"),
        pytest.param(9, UPDATES + WITHIN_TILE + 2 * SYNAPSE + BARRIER, id="no more than channels"),
    ],
)
def test_the_bound_of_a_chain_equals_the_one_worked_out_by_hand(
    events: int, step_ns: float
) -> None:
    """x -> a -> b on one core: both are active and spike, a sends a packet within the tile."""
    bound = hw.worst_case(cost_programs.chain().program, 4, events)
    assert bound.slowest_step_ns == pytest.approx(step_ns)
    assert bound.answer_ns == pytest.approx(step_ns)
    assert bound.recording_ns == pytest.approx(4 * step_ns)
    assert (bound.queued_packets, bound.buffered_events) == (0, 0)


def test_a_compartment_that_cannot_reach_its_threshold_sends_nothing() -> None:
    builder = hw.ProgramBuilder(CHIP)
    touch = builder.add_input("touch", 1)
    forgets = {"decay_u": FORGETS_AT_ONCE, "decay_v": FORGETS_AT_ONCE}
    first = builder.add_compartments("first", 1, threshold=20, **forgets)
    second = builder.add_compartments("second", 1, threshold=10, **forgets)
    builder.connect(touch, first, [[20]])
    builder.connect(first, second, [[20]])
    bound = hw.worst_case(builder.build(), 4, 1)
    # A charge of 20 units does not exceed a threshold of 20.
    assert bound.slowest_step_ns == pytest.approx(UPDATES + SYNAPSE + BARRIER)


def test_the_sustained_rate_is_the_largest_that_fits_the_step() -> None:
    program = rows_of_many(7)
    steps_ns = [hw.worst_case(program, 5, events).slowest_step_ns for events in range(8)]
    assert all(np.diff(steps_ns) > 0)
    for events, step_ns in enumerate(steps_ns):
        assert hw.sustained_events(program, 5, step_ns) == events
        assert hw.sustained_events(program, 5, step_ns + 0.01) == events
    assert hw.sustained_events(program, 5, steps_ns[0] - 0.01) is None
    assert hw.sustained_events(program, 5, 1e9) == 7


def rows_of_many(channels: int) -> hw.ChipProgram:
    """Return a program whose channel k has k + 1 synapses."""
    builder = hw.ProgramBuilder(CHIP)
    touch = builder.add_input("touch", channels)
    neuron = builder.add_compartments(
        "neuron", channels, decay_u=KEEPS_ALL, decay_v=KEEPS_ALL, threshold=10
    )
    builder.connect(touch, neuron, np.triu(np.full((channels, channels), 2)))
    return builder.build()


def test_the_dearest_events_are_those_of_the_bound() -> None:
    program = rows_of_many(7)
    slowest_ns = [hw.worst_case(program, 5, events).slowest_step_ns for events in range(8)]
    synapses = [7, 6, 5, 4, 3, 2, 1]
    assert np.diff(slowest_ns) == pytest.approx(np.array(synapses) * SYNAPSE)


def test_an_event_that_two_inputs_read_in_one_step_counts_twice() -> None:
    """Both inputs read the channel from the transpose buffer: each event of two rows costs a read and a synapse twice."""
    builder = hw.ProgramBuilder(CHIP)
    neuron = builder.add_compartments("neuron", 1, threshold=1000)
    for name in ("left", "right"):
        builder.connect(builder.add_input(name, 2), neuron, [[20, 20]])
    graph = graph_in_phase(builder.graph(), "location", 1, np.array([0]))
    program = program_of_graphs(CHIP, Readout(("neuron",), (1.0,)), graph)
    silent = hw.worst_case(program, 2, 0)
    touched = hw.worst_case(program, 2, 1)
    read_ns = 1.0
    assert touched.answer_ns - silent.answer_ns == pytest.approx(2 * 2 * (read_ns + SYNAPSE))


def check_mesh(seed: int) -> int:
    """Check the bounds of a program at the rate of each of its recordings; return how many recordings there were."""
    case = any_phases.case(seed)
    program = case.program
    if not case.rows or case.steps is not None:
        return 0
    recordings = hostile(program, case.rows, case.spikes, seed)
    events_of_row = sum(array.sum(axis=2, dtype=np.int64) for array in recordings.values())
    activity = hw.simulate(program, recordings, probe=("activity",)).activity
    for i, most_events in enumerate(events_of_row.max(axis=1).tolist()):
        of_recording = {phase: [items[i]] for phase, items in activity.items()}
        (latency,), usage = measure(program, of_recording, program.chip.costs)
        bound = hw.worst_case(program, case.rows, most_events)
        slack = 1 + 1e-9  # for sums of floats in another order
        assert latency.slowest_step_ns <= bound.slowest_step_ns * slack
        assert latency.after_last_row_ns <= bound.answer_ns * slack
        assert latency.total_ns <= bound.recording_ns * slack
        for used in usage.values():
            assert used.link_most.max(initial=0) <= bound.queued_packets
    return len(events_of_row)


def test_bounds_hold_on_programs_of_any_phases() -> None:
    assert sum(check_mesh(seed) for seed in range(24)) > 80


@pytest.mark.minutes
def test_bounds_hold_on_many_programs_of_any_phases() -> None:
    assert sum(check_mesh(seed) for seed in range(24, 700)) > 2_500
