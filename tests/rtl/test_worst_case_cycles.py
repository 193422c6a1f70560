"""Bounds on the cycles of the open core hold for programs of any phases and recordings made to take long.

The cycles of a recording are those that `predicted_cycles` gives, which simulations of the core confirm. The costs of two
small programs are worked out by hand.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import hw_model as hw
from hw_model.accounting.worst_case import buffered_events
from hw_model.mapping.graph import CompartmentGraph, Readout
from hw_model.rtl.cycles import predicted_cycles
from hw_model.rtl.images import SIMULATED, CoreProgram, Sizes
from hw_model.rtl.worst_case import core_costs, worst_case_on_core
from tests.support import any_phases, hybrids
from tests.support.hostile_recordings import hostile

SIZES = (
    SIMULATED,
    replace(SIMULATED, later=1, slots=16),
    replace(SIMULATED, groups=1),
    replace(SIMULATED, places=1024),
)
"""Sizes as the simulated core has them; with room for a second phase that hears events on arrival; with rows that share
sources; with places that phases share."""


def check_cores(seed: int) -> int:
    """Check the bounds for the program of a seed, on cores of all sizes; return how many recordings were checked.

    The bound for a recording is that for its largest number of events in a step.
    """
    case = any_phases.case(seed, plain=True)
    program = case.program
    if not case.rows or case.steps is not None:
        return 0
    recordings = hostile(program, case.rows, case.spikes, seed)
    spikes = hw.simulate(program, recordings).spikes
    all_streams = np.concatenate(list(recordings.values()), axis=2)
    largest_rates = all_streams.sum(axis=2, dtype=np.int64).max(axis=1)
    checked = 0
    for sizes in SIZES:
        try:
            core = CoreProgram(program, case.rows, steps=None, sizes=sizes)
        except hw.TargetError:
            continue  # the core cannot run the program
        costs = core_costs(core)
        cycles = predicted_cycles(core, all_streams, spikes)
        for cycles_taken, events_per_step in zip(cycles, largest_rates.tolist(), strict=True):
            assert cycles_taken <= costs.recording(events_per_step), sizes
        checked += len(cycles)
    return checked


@pytest.mark.slow
def test_bounds_hold_on_programs_of_any_phases() -> None:
    assert sum(check_cores(seed) for seed in range(24)) > 100


@pytest.mark.minutes
def test_bounds_hold_on_many_programs_of_any_phases() -> None:
    assert sum(check_cores(seed) for seed in range(24, 700)) > 2_500


@pytest.mark.slow
def test_the_buffer_holds_no_more_events_than_the_bound() -> None:
    for seed in range(60):
        case = any_phases.case(seed)
        if not case.rows:
            continue
        transposed = [item for item in case.program.inputs if item.positions is not None]
        buffered_rows: dict[str, int] = {}  # of each stream, what its longest visits read
        for item in transposed:
            buffered_rows[item.stream] = max(item.rows, buffered_rows.get(item.stream, 0))
        events = 0
        for stream, rows in buffered_rows.items():
            events += int(case.spikes[stream][0, :rows].sum())
        events_of_row = sum(array[0].sum(axis=1) for array in case.spikes.values())
        events_per_step = int(events_of_row.max())
        assert events <= buffered_events(case.program, case.rows, events_per_step)


# --- costs worked out by hand ---

VISITED_CHANNELS = [0, 1, 2]
"""The location phase visits one channel per step."""
LATER = replace(SIMULATED, later=1, slots=16)
"""The size of a core whose second phase hears events when they arrive."""


def time_graph() -> CompartmentGraph:
    """A time phase of 5 steps: 3 channels with lists of 4, 1 and 0 words, 9 hidden neurons and 2 classes.

    The last hidden neuron hears nothing, so it never spikes. The lists of the others have 2 words.
    """
    builder = hw.ProgramBuilder(hybrids.CHIP)
    x = builder.add_input("time/x", 3)
    hidden = builder.add_compartments("time/h", 9, threshold=5, refractory=np.arange(1, 10))
    y = builder.add_compartments("time/y", 2, threshold=5, refractory=3)
    weights = np.zeros((9, 3), dtype=np.int64)
    weights[:8, 0] = 10
    weights[0, 1] = 10
    builder.connect(x, hidden, weights)
    builder.connect(hidden, y, np.full((2, 9), 10))
    return hybrids.graph_in_phase(builder.graph(), "time", 5)


def location_graph() -> CompartmentGraph:
    """A location phase of 3 steps: rows with lists of 1, 0, 4 and 1 words, 7 hidden neurons and 2 classes."""
    builder = hw.ProgramBuilder(hybrids.CHIP)
    x = builder.add_input("location/x", 4)
    hidden = builder.add_compartments("location/h", 7, threshold=5, refractory=2)
    z = builder.add_compartments("location/z", 2, threshold=5)
    weights = np.zeros((7, 4), dtype=np.int64)
    weights[:, 2] = 10
    weights[0, [0, 3]] = 10
    builder.connect(x, hidden, weights)
    builder.connect(hidden, z, np.full((2, 7), 10))
    return hybrids.graph_in_phase(
        builder.graph(), "location", len(VISITED_CHANNELS), positions=VISITED_CHANNELS
    )


def hybrid_program() -> hw.ChipProgram:
    readout = Readout(("time/y", "location/z"), (1.0, 2.0))
    return hybrids.program_of_graphs(hybrids.CHIP, readout, time_graph(), location_graph())


def costs_of(program: hw.ChipProgram, rows: int, sizes: Sizes = SIMULATED) -> dict[str, object]:
    """Return all costs of a program on a core, with arrays as lists."""
    costs = vars(core_costs(CoreProgram(program, rows, steps=None, sizes=sizes)))
    return {
        name: value.tolist() if isinstance(value, np.ndarray) else value
        for name, value in costs.items()
    }


HYBRID_COSTS = {
    "rows": 5,
    # An event takes 1 cycle of waiting and its list, of at least 2 cycles: 1 + 4, 1 + 2 and 1 + 2.
    "row_events": [0, 5, 5 + 3, 5 + 3 + 3],
    "row_end": 1 + 11 + 16,  # 11 compartments
    "row_spikes": 10 * (1 + 2),  # of 8 hidden neurons and 2 classes
    # Refractory times 1 to 8 allow 5, 3, 2, 2, 1, 1, 1, 1 spikes in 5 steps, and 3 allows 2.
    "first_spikes": (16 + 2 * 2) * (1 + 2),
    "later": (
        (1 + 8)  # the ends of the stream and of the phase
        + 2 * (3 + 1 + 3 + 2 + 2)  # the readout: of each class, weights of 1 and 2 bits
        + 2  # to the answer
        + 15 + 3 * (2 + 1 + 2) + 3 * 2  # the scan: its start, 3 visits of 1 word, and 3 words that end a step or phase
        + 8  # the end of the phase
        + 3 * (9 + 16)  # 3 steps of 9 compartments
        + (7 * 2 + 2 * 3) * (1 + 2)  # spikes: 2 of each hidden neuron and 3 of each class
    ),
    # In each of 4 rows, an event of a channel is found in 1 cycle, and its list takes 2, 2, 4 and 2.
    "later_events": [0, 14, 28, 42],
    "queued": 10,
}  # fmt: skip


def test_the_costs_of_two_phases_worked_out_by_hand() -> None:
    assert costs_of(hybrid_program(), 5) == HYBRID_COSTS


def test_events_that_a_second_phase_hears_at_once_are_paid_as_they_arrive() -> None:
    """Each event also costs 2 cycles of waiting and the longest list of a row, 4; the buffer is not visited."""
    second = 2 + 4
    assert costs_of(hybrid_program(), 5, LATER) == HYBRID_COSTS | {
        "row_events": [0, 5 + second, 8 + 2 * second, 11 + 3 * second],
        "later": HYBRID_COSTS["later"] - 3 * (2 + 1 + 2),
        "later_events": [0, 0, 0, 0],
    }


def test_a_core_without_a_first_phase_only_stores_the_rows() -> None:
    readout = Readout(("location/z",), (1.0,))
    program = hybrids.program_of_graphs(hybrids.CHIP, readout, location_graph())
    costs = costs_of(program, 4)
    # Channels have empty lists: 1 cycle of waiting, and at least 2.
    assert costs["row_events"] == [0, 3, 6, 9]
    assert (costs["row_end"], costs["row_spikes"], costs["first_spikes"]) == (1 + 16, 0, 0)
    assert costs["queued"] == 9


def test_the_answer_comes_after_the_last_row_and_all_later_phases() -> None:
    chip = replace(hybrids.CHIP, open_core=SIMULATED)
    bound = worst_case_on_core(replace(hybrid_program(), chip=chip), 5, events_per_step=2)
    row_without_spikes = 8 + 28
    after_rows = HYBRID_COSTS["later"] + 28
    cycles = [row_without_spikes + 30, row_without_spikes + 30 + after_rows]
    cycles.append(5 * row_without_spikes + 60 + after_rows)
    bounds_ns = [bound.slowest_step_ns, bound.answer_ns, bound.recording_ns]
    assert bounds_ns == [n / chip.clock_ghz for n in cycles]
    assert (bound.queued_packets, bound.buffered_events) == (10, 4 * 2)
