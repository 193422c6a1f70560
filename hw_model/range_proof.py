"""Prove from a program alone which registers can never wrap or clip, whatever the input.

Reports state the result, and the proofs behind early stops rest on it. The letters
are those of :mod:`hw_model.arithmetic.loihi`: q is the charge of a step, u the current, v the
voltage, and a *joined* child adds its v to its parent's in the same step.

Every source spikes at most once a step, so the charge q of one step lies between the sum of a compartment's negative
weights and that of its positive ones. From there, upwards (downwards alike, with signs turned):

    q  <=  Q       = sum of positive weights
    u  <=  U       = where u settles, the smallest integer that loses Q in a step, which no step can pass
    v  <=  V       = likewise, with decay_v, from U + bias + what joined children can pass

A reset or a refractory period only brings v back to 0. With a decay of 0, any drive moves a register without bound. A
feed-forward compartment whose inputs all spike in every step reaches these bounds; sources that rest in between stay
far below them.

For compartments that could wrap at full rate, a lower rate is proven safe. If every source spikes at most once in any p
steps, positive charge arrives at worst all at once, every p steps. Truncation toward zero only shrinks what the filters
keep, so their real-valued answer to that train is a bound: Q * sum over k of a^(kp) for u, and Q * max over m of the
sum over k of h(m + kp) for v, where a is the share of u that a step keeps, and h(m) is v, m steps after a charge of 1.
"""

from collections.abc import Callable
from functools import lru_cache

import numpy as np

from hw_model.arithmetic import loihi_bounds
from hw_model.description.chip import Registers
from hw_model.io.arguments import checked
from hw_model.program.chip_program import ChipProgram, Core
from hw_model.values import BoolArray, FloatArray, IntArray, Shown, Sums

PERIODS = (1, 2, 3, 4, 6, 8, 12, 16, 24, 32, 48, 64, 96, 128, 192, 256, 512, 1024, 2048, 4096)
"""Steps between two spikes of a source for which safety is proven, shortest first; chosen by hand, up to 4096."""
GUARD = 1e-9
"""Relative margin on top of a filter's answer: a thousand times the rounding error of its sum in float64."""


class Bounds(Sums, eq=False):
    """The lowest and highest value that a register could reach if it neither wrapped nor clipped, (compartments,)."""

    low: FloatArray
    high: FloatArray

    def within(self, low: float, high: float) -> BoolArray:
        """Return which compartments have both bounds within ``low..high``."""
        return (self.low >= low) & (self.high <= high)

    def of(self, compartments: IntArray) -> "Bounds":
        """Return the bounds of some compartments."""
        return Bounds(self.low[compartments], self.high[compartments])


class CoreRange(Shown):
    """What is proven about the compartments of one core; arrays (compartments,).

    ``cannot_wrap``: no input can make q, u or u + bias wrap; ``cannot_clip``: none can make v clip. ``safe_period``:
    the shortest of :data:`PERIODS` p such that neither happens while every source spikes at most once in any p steps; 1
    where the proof holds for any input, 0 where none of the periods is enough.
    """

    core: int
    q: Bounds
    u: Bounds
    v: Bounds
    cannot_wrap: BoolArray
    cannot_clip: BoolArray
    safe_period: IntArray


@checked
@lru_cache(maxsize=8)
def prove_range(program: ChipProgram) -> tuple[CoreRange, ...]:
    """Bound the registers of every compartment, core by core, from weights, decays, biases and joins alone."""
    return tuple(_prove_core(core, program.chip.registers) for core in program.cores)


def can_spike(program: ChipProgram, phase: str) -> BoolArray:
    """Return which compartments of a phase some input may bring above their threshold, (columns,)."""
    proven = prove_range(program)

    def of_core(core: Core) -> IntArray:
        highest = np.minimum(proven[core.number].v.high, core.vmax)
        is_free = core.setting("joined") == 0
        reaches: IntArray = (is_free & (highest > core.threshold_voltage)).astype(np.int64)
        return reaches

    return program.by_column(phase, of_core) > 0


def _prove_core(core: Core, registers: Registers) -> CoreRange:
    """Bound the registers of one core's compartments at full rate, then find their safe periods."""
    charge = charges(core)
    charge_fits = charge.within(-registers.half_charge, registers.half_charge - 1)
    u = _settled(charge, core.setting("decay_u"))
    bias = core.bias.astype(np.float64)
    u_and_bias = u + Bounds(bias, bias)
    half = registers.half_current
    cannot_wrap = charge_fits & u.within(-half, half - 1) & u_and_bias.within(-half, half - 1)
    # A register that may wrap can hold any value, so its full range drives v.
    drive = Bounds(
        np.where(cannot_wrap, u_and_bias.low, -half),
        np.where(cannot_wrap, u_and_bias.high, half - 1),
    )
    v = _voltage(core, drive, _settled_with_children)
    cannot_clip = v.within(core.vmin, core.vmax)

    # Periods ascend, so the first that is safe for a compartment is its shortest. 0 means undecided.
    safe_period = np.where(cannot_wrap & cannot_clip, 1, 0)
    for period in PERIODS[1:]:
        is_undecided = safe_period == 0
        if not is_undecided.any():
            break
        is_safe = charge_fits & _safe_at(core, charge, period, half)
        _mark_parents_unsafe(core, is_safe)
        safe_period[is_undecided & is_safe] = period
    return CoreRange(core.number, charge, u, v, cannot_wrap, cannot_clip, safe_period)


def charges(core: Core) -> Bounds:
    """Bound q of every compartment before it wraps.

    It is lowest if exactly the sources with negative weights spike, and highest with the positive ones.
    """
    weight = core.effective_weights.astype(np.float64)

    def sum_by_target(weights: FloatArray) -> FloatArray:
        sums = np.bincount(core.axons.target, weights, minlength=core.compartments)
        return sums.astype(np.float64)

    return Bounds(
        low=sum_by_target(np.minimum(weight, 0)), high=sum_by_target(np.maximum(weight, 0))
    )


def _settled(drive: Bounds, decays: IntArray) -> Bounds:
    """Bound ``x = rz(x, decay) + d`` from x = 0, for d within the drive's bounds in every step."""
    return Bounds(
        -loihi_bounds.settles_at(-drive.low, decays), loihi_bounds.settles_at(drive.high, decays)
    )


def _settled_with_children(own_drive: Bounds, passed: Bounds, decays: IntArray) -> Bounds:
    """Bound v, given the bounds of its drive and of what joined children pass in every step."""
    return _settled(own_drive + passed, decays)


def _answer_with_children(own_answer: Bounds, passed: Bounds, decays: IntArray) -> Bounds:
    """Bound v, given v's own answer to its drive and what joined children pass in every step.

    Both answers are real numbers that are added, so the one to the children must ignore truncation:
    truncating a sum may remove less than truncating its terms.
    """
    return own_answer + Bounds(
        loihi_bounds.settles_untruncated(passed.low, decays),
        loihi_bounds.settles_untruncated(passed.high, decays),
    )


def _voltage(
    core: Core, own: Bounds, bound_v: Callable[[Bounds, Bounds, IntArray], Bounds]
) -> Bounds:
    """Bound v of every compartment, assuming that its joined children add their extreme v in every step.

    ``own`` is the first argument of ``bound_v``; the others are the sum that joined children pass, and decay_v.
    ``core.turns`` lists the compartments of a core in groups, children before their parents.
    """
    decays = core.setting("decay_v")
    v = Bounds(own.low.copy(), own.high.copy())
    passed = Bounds(np.zeros_like(v.low), np.zeros_like(v.high))
    for members in core.turns:
        v_of_members = bound_v(own.of(members), passed.of(members), decays[members])
        v.low[members] = v_of_members.low
        v.high[members] = v_of_members.high
        # A child passes its v as its register holds it: clipped.
        children = members[core.parent[members] >= 0]
        parents = core.parent[children]
        np.add.at(passed.low, parents, np.maximum(v.low[children], core.vmin))
        np.add.at(passed.high, parents, np.minimum(v.high[children], core.vmax))
    return v


def _safe_at(core: Core, charge: Bounds, period: int, half_current: int) -> BoolArray:
    """Return in which compartments u + bias cannot wrap and v cannot clip, provided that q does not wrap.

    Every source spikes at most once in any ``period`` steps.
    """
    bias = core.bias.astype(np.float64)
    u_gain, v_gain = _largest_answers(core, period)
    # 0 * inf is nan, which compares as false: such a compartment is not marked safe.
    with np.errstate(invalid="ignore"):
        u = Bounds(charge.low * u_gain, charge.high * u_gain)
        v_to_low_charge = np.where(charge.low < 0, charge.low * v_gain, 0.0)
        v_to_high_charge = np.where(charge.high > 0, charge.high * v_gain, 0.0)
    v_to_bias = loihi_bounds.settles_untruncated(bias, core.setting("decay_v"))
    # The answer to the bias moves from 0 to where it settles; charges may meet any value in between.
    own_v = Bounds(
        v_to_low_charge + np.minimum(v_to_bias, 0.0),
        v_to_high_charge + np.maximum(v_to_bias, 0.0),
    )
    v = _voltage(core, own_v, _answer_with_children)
    u_and_bias = u + Bounds(np.minimum(bias, 0), np.maximum(bias, 0))
    cannot_wrap = u_and_bias.within(-half_current, half_current - 1)
    return cannot_wrap & v.within(core.vmin, core.vmax)


def _largest_answers(core: Core, period: int) -> tuple[FloatArray, FloatArray]:
    """Return the largest u and v that a charge of 1 every ``period`` steps gives, (compartments,)."""
    u_gain = np.empty(core.compartments)
    v_gain = np.empty(core.compartments)
    for index, profile in enumerate(core.profiles):
        has_profile = core.profile == index
        answer_u, answer_v = loihi_bounds.largest_answers(profile.decay_u, profile.decay_v, period)
        u_gain[has_profile] = answer_u * (1 + GUARD)
        v_gain[has_profile] = answer_v * (1 + GUARD)
    return u_gain, v_gain


def _mark_parents_unsafe(core: Core, is_safe: BoolArray) -> None:
    """Mark the parents of unsafe compartments unsafe: a child that may wrap could pass on any value.

    Children have lower numbers than their parents, so one pass in ascending order reaches all ancestors.
    """
    for child in range(core.compartments):
        parent = core.parent[child]
        if parent >= 0 and not is_safe[child]:
            is_safe[parent] = False
