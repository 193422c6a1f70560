"""What an engine is asked for and hands back, for one recording in one phase."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal, get_args

import numpy as np
import numpy.typing as npt

from hw_model.fixed_point import IntArray

ByteArray = npt.NDArray[np.uint8]

Kind = Literal["spikes", "u", "v", "potential"]
KINDS: tuple[Kind, ...] = get_args(Kind)
"""``u`` and ``v`` are registers after the step (v is 0 on a spike row); ``potential`` is v as the threshold saw it."""

EVENTS = ("charge_wraps", "current_wraps", "voltage_clips")


@dataclass(frozen=True, eq=False)
class Window:
    """What to keep of a register: compartments ``columns`` (indices in the phase), rows ``start..stop``."""

    columns: IntArray
    start: int
    stop: int

    def empty(self) -> IntArray:
        """Return room for it, (rows, columns)."""
        return np.zeros((self.stop - self.start, len(self.columns)), dtype=np.int64)


@dataclass(frozen=True, eq=False)
class PhaseTrace:
    """One recording in one phase; compartments in the order of the phase's cores, n of them in all.

    ``spikes`` (steps, n); ``active`` (steps, cores): compartments with anything to work on; ``events`` (3, n): how
    often each compartment met each of :data:`EVENTS`; ``registers[kind]``: the windows asked for.
    """

    spikes: ByteArray
    active: IntArray
    events: IntArray
    registers: dict[Kind, IntArray] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class PhaseInput:
    """Spikes of a phase's input lines: ``lines[name]`` (steps, size), as the transpose buffer leaves them."""

    steps: int
    lines: dict[str, ByteArray]
    input_events: int
    transpose_events: int
    events_dropped: int
