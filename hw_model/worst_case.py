"""Bounds of time and memory that hold for every recording with at most some rate of events, on any kind of target.

:mod:`hw_model.accounting.worst_case` says how they are found for a mesh of cores, and
:mod:`hw_model.rtl.worst_case` for the open core.
"""

from hw_model.accounting.worst_case import WorstCase
from hw_model.io.arguments import checked
from hw_model.program.chip_program import ChipProgram
from hw_model.targets import target_of


@checked
def worst_case(program: ChipProgram, rows: int, events_per_step: int) -> WorstCase:
    """Return bounds of latency, queues and the transpose buffer that no input exceeds.

    Recordings have ``rows`` rows, each with at most ``events_per_step`` events of all streams.
    """
    return target_of(program.chip).worst_case(program, rows, events_per_step)


@checked
def sustained_events(program: ChipProgram, rows: int, step_ns: float) -> int | None:
    """Return the largest number of events of a row whose step always ends within ``step_ns``.

    It is the number of channels if a row with an event on every channel is in time. It is None if
    even a row without events may take too long, because of spikes inside the network.
    """
    channels = sum(program.streams.values())
    # Bisection: the time only grows with the events. -1 stands for "not even 0 events".
    lowest = -1
    highest = channels
    while lowest < highest:
        middle = (lowest + highest + 1) // 2
        if worst_case(program, rows, middle).slowest_step_ns <= step_ns:
            lowest = middle
        else:
            highest = middle - 1
    return None if lowest < 0 else lowest
