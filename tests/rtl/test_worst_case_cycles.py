"""Bounds on the cycles of the open core hold for programs of any phases and recordings made to take long.

The cycles of a recording are those that `predicted_cycles` gives, which simulations of the core confirm.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import hw_model as hw
from hw_model.accounting.worst_case import buffered_events
from hw_model.rtl.cycles import predicted_cycles
from hw_model.rtl.images import SIMULATED, CoreProgram
from hw_model.rtl.worst_case import core_costs
from tests.support import any_phases
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
            core = CoreProgram(program, case.rows, None, sizes)
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
