"""What an engine is asked for and hands back: a batch of recordings in one phase.

Columns are the compartments of the phase, group by group, as :meth:`hw_model.program.ChipProgram.columns_of` says.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal, get_args

import numpy as np
import numpy.typing as npt

from hw_model.fixed_point import IntArray

ByteArray = npt.NDArray[np.uint8]

Register = Literal["u", "v", "potential"]
REGISTERS: tuple[Register, ...] = get_args(Register)
"""``u`` and ``v`` are registers after the step (v is 0 on a spike row); ``potential`` is v as the threshold saw it."""

EVENTS = ("charge_wraps", "current_wraps", "voltage_clips")


@dataclass(frozen=True, eq=False)
class Window:
    """What to keep of a register: ``columns``, in rows ``start..stop``."""

    columns: IntArray
    start: int
    stop: int

    def empty(self, batch: int) -> IntArray:
        """Return room for it, (batch, rows, columns)."""
        return np.zeros((batch, self.stop - self.start, len(self.columns)), dtype=np.int64)


NOTHING = Window(np.empty(0, dtype=np.int64), 0, 0)


@dataclass(frozen=True, eq=False)
class PhaseInput:
    """Spikes of a phase's input lines, (batch, steps, lines), inputs one after the other, as the buffer leaves them.

    ``input_events``, ``transpose_events`` and ``events_dropped`` (batch,) count what was played as it came, what went
    through the transpose buffer, and what lay in rows after the last step.
    """

    lines: ByteArray
    input_events: IntArray
    transpose_events: IntArray
    events_dropped: IntArray

    @property
    def steps(self) -> int:
        """Steps of the phase."""
        return int(self.lines.shape[1])


@dataclass(frozen=True, eq=False)
class PhaseTrace:
    """What a batch did in a phase of n columns.

    ``spikes`` (batch, steps, n); ``sent`` (batch, lines + n): spikes of every source over all steps, input lines first;
    ``active`` (batch, steps, cores): compartments with anything to work on; ``events`` (batch, 3, n): how often each
    compartment met each of :data:`EVENTS`; ``skipped`` (batch,): steps in which no compartment had to be updated;
    ``registers``: the windows asked for.
    """

    spikes: ByteArray
    sent: IntArray
    active: IntArray
    events: IntArray
    skipped: IntArray
    registers: dict[Register, IntArray] = field(default_factory=dict)
