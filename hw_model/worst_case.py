"""Bounds that hold for any recording with a stated rate of events, on any kind of target.

:mod:`hw_model.accounting.worst_case` says how they are found for a mesh of cores, and
:mod:`hw_model.rtl.worst_case` for the open core.
"""

from hw_model.accounting.worst_case import WorstCase
from hw_model.io.given import checked
from hw_model.program.chip_program import ChipProgram
from hw_model.targets import target_of


@checked
def worst_case(program: ChipProgram, rows: int, events_per_step: int) -> WorstCase:
    """Bound latency, queues and the transpose buffer, whatever the input.

    Recordings have ``rows`` rows, each with at most ``events_per_step`` events of all streams.
    """
    return target_of(program.chip).worst_case(program, rows, events_per_step)


@checked
def sustained_events(program: ChipProgram, rows: int, step_ns: float) -> int | None:
    """Return the most events of a row that are always done within a step of ``step_ns``.

    If every channel may have one, it is the number of channels; None if even silence may take too
    long, as inner spikes alone do.
    """
    channels = sum(program.streams.values())
    lowest = -1
    highest = channels
    while lowest < highest:
        middle = (lowest + highest + 1) // 2
        if worst_case(program, rows, middle).slowest_step_ns <= step_ns:
            lowest = middle
        else:
            highest = middle - 1
    return None if lowest < 0 else lowest
