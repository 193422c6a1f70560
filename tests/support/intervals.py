"""Run the chip's step (:mod:`hw_model.arithmetic.loihi`) on intervals of numbers.

An interval holds every value that a register may have, whatever spikes arrive. Tests compare it with the bounds that
the range proof states and with what the simulator reaches.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hw_model.arithmetic import loihi
from hw_model.arithmetic.fixed_point import kept
from hw_model.description.chip import Registers
from hw_model.program.chip_program import Core
from hw_model.range_proof import charges


@dataclass(frozen=True)
class Interval:
    """Numbers from low to high, both arrays (compartments,)."""

    low: np.ndarray
    high: np.ndarray

    def __add__(self, other: Interval | np.ndarray) -> Interval:
        if isinstance(other, Interval):
            return Interval(self.low + other.low, self.high + other.high)
        return Interval(self.low + other, self.high + other)

    def with_zero(self) -> Interval:
        """Return the smallest interval that also holds 0, the value after a reset."""
        return Interval(np.minimum(self.low, 0), np.maximum(self.high, 0))

    def holds(self, values: np.ndarray) -> bool:
        return bool(((self.low <= values) & (values <= self.high)).all())


class OnIntervals:
    """The operations of a step before the threshold, on intervals.

    A value that may wrap becomes the whole range of its register, which is larger than necessary but holds every result.
    """

    def __init__(self, registers: Registers) -> None:
        self._registers = registers

    def wrap_charge(self, q: Interval) -> Interval:
        return _wrapped(q, self._registers.charge_bits)

    def wrap_current(self, u: Interval) -> Interval:
        return _wrapped(u, self._registers.current_bits)

    def charged(self, q: Interval) -> Interval:
        return q

    def kept(self, x: Interval, keep: np.ndarray) -> Interval:
        return Interval(kept(x.low, keep), kept(x.high, keep))

    def clip(self, v: Interval, low: np.ndarray, high: np.ndarray) -> Interval:
        return Interval(np.clip(v.low, low, high), np.clip(v.high, low, high))


def _wrapped(x: Interval, bits: int) -> Interval:
    """Return the interval, or the whole range of a register of ``bits`` and a sign where x leaves that range."""
    half = 1 << bits
    inside = (x.low >= -half) & (x.high < half)
    return Interval(np.where(inside, x.low, -half), np.where(inside, x.high, half - 1))


class CoreIntervals:
    """What the registers of a core may hold after each step, starting from 0."""

    def __init__(self, core: Core, registers: Registers) -> None:
        zeros = np.zeros(core.compartments, dtype=np.int64)
        bounds = charges(core)
        self.core = core
        self.arithmetic = OnIntervals(registers)
        self.charge = Interval(bounds.low.astype(np.int64), bounds.high.astype(np.int64))
        self.u = Interval(zeros, zeros)
        self.v = Interval(zeros, zeros)

    def step(self) -> None:
        """Take a step in which any sources may spike, and any compartment that can spike may be reset."""
        joined = Interval(np.zeros_like(self.u.low), np.zeros_like(self.u.low))
        # Compartments take turns, children before their parents, and a turn needs the voltages of the turns before it.
        # Each turn computes the whole core for simplicity; the last one is the result.
        for members in self.core.turns:
            response = loihi.respond(
                self.arithmetic, self.core.step_parameters, self.u, self.v, self.charge, joined
            )
            spiking = self.core.setting("joined") == 0
            v = response.v
            both = v.with_zero()
            v = Interval(np.where(spiking, both.low, v.low), np.where(spiking, both.high, v.high))
            children = members[self.core.parent[members] >= 0]
            np.add.at(joined.low, self.core.parent[children], v.low[children])
            np.add.at(joined.high, self.core.parent[children], v.high[children])
        self.u = response.u
        self.v = v
