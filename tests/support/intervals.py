"""The step of ``loihi`` on intervals: all that registers may hold, whatever arrives."""

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
        return Interval(np.minimum(self.low, 0), np.maximum(self.high, 0))

    def holds(self, values: np.ndarray) -> bool:
        return bool(((self.low <= values) & (values <= self.high)).all())


class OnIntervals:
    """The operations that come before a threshold; what may wrap may be anything that its register holds."""

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
    half = 1 << bits
    inside = (x.low >= -half) & (x.high < half)
    return Interval(np.where(inside, x.low, -half), np.where(inside, x.high, half - 1))


class CoreIntervals:
    """What the registers of a core may hold after each step, from rest on."""

    def __init__(self, core: Core, registers: Registers) -> None:
        zeros = np.zeros(core.compartments, dtype=np.int64)
        bounds = charges(core)
        self.core = core
        self.arithmetic = OnIntervals(registers)
        self.charge = Interval(bounds.low.astype(np.int64), bounds.high.astype(np.int64))
        self.u = Interval(zeros, zeros)
        self.v = Interval(zeros, zeros)

    def step(self) -> None:
        """Take a step in which any sources spike, and any compartment that can may be reset."""
        joined = Interval(np.zeros_like(self.u.low), np.zeros_like(self.u.low))
        # Each turn needs the children of those before; the others are computed once more than needed.
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
