"""Prove from a program alone which registers can never wrap or clip, whatever the input.

Every source spikes at most once a step, so the charge q of one step lies between the sum of a compartment's negative
weights and that of its positive ones. From there, upwards (downwards alike, with signs turned):

    q  <=  Q       = sum of positive weights
    u  <=  U       = where u settles, the smallest integer that loses Q in a step, which no step can pass
    v  <=  V       = likewise, with decay_v, from U + bias + what joined children can pass

A reset or a refractory period only brings v back to 0. A decay of 0 under any drive has no bound. A feed-forward
compartment whose inputs all spike in every step reaches its bounds; for sources that rest in between they are cautious.

For the others there is a rate. If every source spikes at most once in any p steps, positive charge arrives at worst all
at once, every p steps. Truncation toward zero only shrinks what the filters keep, so their real-valued answer to that
train is a bound: Q * sum over k of a^(kp) for u, and Q * max over m of the sum over k of h(m + kp) for v, where a is
what decay_u keeps in a step and h is the answer of both decays in a row.
"""

from functools import lru_cache

import numpy as np

from hw_model.arithmetic import loihi_bounds
from hw_model.description.chip import Registers
from hw_model.io.given import checked
from hw_model.program.chip_program import ChipProgram, Core
from hw_model.values import BoolArray, FloatArray, IntArray, Shown, Sums

PERIODS = (1, 2, 3, 4, 6, 8, 12, 16, 24, 32, 48, 64, 96, 128, 192, 256, 512, 1024, 2048, 4096)
"""Steps between spikes of a source that are tried, shortest first."""
GUARD = 1e-9
"""Share that is added to a filter's answer: a thousand times what float64 rounds off in it."""


class Bounds(Sums, eq=False):
    """Lowest and highest value that a register could reach before it wraps or is clipped; arrays (compartments,)."""

    low: FloatArray
    high: FloatArray

    def within(self, low: float, high: float) -> BoolArray:
        """Mark the compartments whose bounds lie in a range."""
        return (self.low >= low) & (self.high <= high)


class CoreRange(Shown):
    """What is proven of the compartments of one core; arrays (compartments,).

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


def _prove_core(core: Core, registers: Registers) -> CoreRange:
    charge = charges(core)
    wrap_q = charge.within(-registers.half_charge, registers.half_charge - 1)
    half = registers.half_current
    u = _settled(charge, core.setting("decay_u"))
    bias = core.bias.astype(np.float64)
    driven = u + Bounds(bias, bias)
    cannot_wrap = wrap_q & u.within(-half, half - 1) & driven.within(-half, half - 1)
    # A register that may wrap can hold anything.
    low, high = (
        np.where(cannot_wrap, driven.low, -half),
        np.where(cannot_wrap, driven.high, half - 1),
    )
    v = _voltage(core, Bounds(low, high), filtered=False)
    cannot_clip = v.within(core.vmin, core.vmax)

    safe_period = np.where(cannot_wrap & cannot_clip, 1, 0)
    for period in PERIODS[1:]:
        undecided = safe_period == 0
        if not undecided.any():
            break
        safe_period[undecided & _safe_at(core, charge, wrap_q, period, half)] = period
    return CoreRange(core.number, charge, u, v, cannot_wrap, cannot_clip, safe_period)


def charges(core: Core) -> Bounds:
    """Bound q of every compartment before it wraps: every source of one sign spikes, and none of the other."""
    weight = core.effective_weights.astype(np.float64)
    n = core.compartments
    low, high = (
        np.bincount(core.axons.target, part, minlength=n).astype(np.float64)
        for part in (np.minimum(weight, 0), np.maximum(weight, 0))
    )
    return Bounds(low, high)


def _settled(drive: Bounds, decays: IntArray) -> Bounds:
    """Bound ``x = rz(x, decay) + d`` from x = 0, for d within the drive's bounds in every step."""
    return Bounds(
        -loihi_bounds.settles_at(-drive.low, decays), loihi_bounds.settles_at(drive.high, decays)
    )


def _voltage(core: Core, drive: Bounds, *, filtered: bool) -> Bounds:
    """Bound v of every compartment, children first; with ``filtered`` the drive is v's own answer already.

    What a joined child adds, it may add in every step.
    """
    decays = core.setting("decay_v")
    low, high = drive.low.copy(), drive.high.copy()
    passed_low, passed_high = np.zeros_like(low), np.zeros_like(high)
    for here in core.turns:
        own, passed = Bounds(low[here], high[here]), Bounds(passed_low[here], passed_high[here])
        if filtered:
            found = own + Bounds(
                loihi_bounds.settles_untruncated(passed.low, decays[here]),
                loihi_bounds.settles_untruncated(passed.high, decays[here]),
            )
        else:
            found = _settled(own + passed, decays[here])
        low[here], high[here] = found.low, found.high
        joined = here[core.parent[here] >= 0]
        np.add.at(passed_low, core.parent[joined], np.maximum(low[joined], core.vmin))
        np.add.at(passed_high, core.parent[joined], np.minimum(high[joined], core.vmax))
    return Bounds(low, high)


def _safe_at(core: Core, charge: Bounds, wrap_q: BoolArray, period: int, half: int) -> BoolArray:
    """Mark compartments that neither wrap nor clip while every source spikes at most once in ``period`` steps."""
    bias = core.bias.astype(np.float64)
    u_gain, v_gain = (np.empty(core.compartments) for _ in range(2))
    for index, profile in enumerate(core.profiles):
        mine = core.profile == index
        answers = loihi_bounds.largest_answers(profile.decay_u, profile.decay_v, period)
        u_gain[mine], v_gain[mine] = (answer * (1 + GUARD) for answer in answers)
    with np.errstate(invalid="ignore"):
        u = Bounds(charge.low * u_gain, charge.high * u_gain)
        steady = loihi_bounds.settles_untruncated(bias, core.setting("decay_v"))
        own = Bounds(
            np.where(charge.low < 0, charge.low * v_gain, 0.0) + np.minimum(steady, 0.0),
            np.where(charge.high > 0, charge.high * v_gain, 0.0) + np.maximum(steady, 0.0),
        )
    driven = u + Bounds(np.minimum(bias, 0), np.maximum(bias, 0))
    v = _voltage(core, own, filtered=True)
    safe: BoolArray = wrap_q & driven.within(-half, half - 1) & v.within(core.vmin, core.vmax)
    # A child that may wrap could pass anything on.
    for i in range(core.compartments):
        if core.parent[i] >= 0 and not safe[i]:
            safe[core.parent[i]] = False
    return safe
