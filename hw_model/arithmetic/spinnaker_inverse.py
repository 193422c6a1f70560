"""Convert neurons of :mod:`hw_model.arithmetic.loihi` to parameters of ``IF_curr_exp`` of SpiNNaker.

Both are leaky neurons with a current. ``loihi`` keeps shares of u and v in 4096ths, and measures
potentials in units of a weight of 1. SpiNNaker takes time constants, capacities, nA and mV, and
computes from them, in integers, the shares that its registers keep (the letters are those of
:mod:`hw_model.arithmetic.spinnaker`). That cannot be inverted by a formula, so settings are searched:

    tau_m     the longest with e = 8 (4096 - decay_v), which exists for every decay_v from 1 on
    tau_syn   the longest with d nearest to 2^20 (4096 - decay_u)
    W         nA for a weight of 1: the largest power of two up to 1 at which no current, and no
              shifted ring buffer, can wrap
    S         mV for a potential of 1: likewise, at which no goal, and no distance to it, can wrap
    c_m       such that a weight of 1 lifts V by S at once: tau_m (2^15 - e) init W / (S 2^47)
    G         by how much it then lifts V, as c_m and R are rounded: R (2^15 - e) init W / 2^62 mV
    v_thresh  the least V above G threshold, so that the rounded c_m costs nothing
    i_offset  the bias times the current that a weight of 1 gives at once

The bounds below are exact: if every source spikes at most once per step, nothing wraps. The goal
towards which V moves is 1 / (1 - e) times a drive, so it leaves s16.15 long before V does; S is
chosen small enough to prevent that.
"""

import math
from collections.abc import Callable
from fractions import Fraction
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from hw_model.arithmetic import loihi
from hw_model.arithmetic.spinnaker import (
    DELAY_MIN,
    HALF_SPAN,
    ONE,
    SPAN,
    WEIGHT_MAX,
    expk,
    expulr,
    initial_share,
)
from hw_model.values import FloatArray, IntArray

DECAY_U_MIN = 6
"""Below, the initial share of a current leaves its 32 bits."""
DECAY_V_MIN = 1
"""With 0, e is 1: no current moves V."""
TAU_MAX = 1 << 30
"""32,768 ms in s16.15. For longer times, -1 ms / tau rounds to 0."""
SUM_MAX = (1 << 15) - 1
"""The largest sum of weights of a step, nA: shifted into s16.15, it stays below 2^31."""
SPREAD_MAX = (1 << 16) - 1
"""The largest currents, nA, and the widest range of goals, mV, that cannot wrap."""
UNREACHABLE = HALF_SPAN - 1
"""The highest threshold, for neurons whose potentials are read out and that should not spike."""


class LeakyNeuron(NamedTuple):
    """The parameters of a neuron of ``loihi``, as defined there; ``bias`` is in counts of u."""

    decay_u: int
    decay_v: int
    threshold: int
    bias: int
    refractory: int


class Scales(NamedTuple):
    """W and S as exponents: W = 2^-weight nA and S = 2^-potential mV."""

    weight: int
    potential: int

    @property
    def weight_unit(self) -> float:
        """The current, nA, of a weight of 1."""
        return 2.0**-self.weight

    @property
    def potential_unit(self) -> float:
        """The potential, mV, of a potential of 1."""
        return 2.0**-self.potential


class Membrane(NamedTuple):
    """Time constants, s16.15, and what a core computes from them: e, d and init."""

    tau_m: int
    tau_syn: int
    membrane_decay: int
    synapse_decay: int
    synapse_init: int

    @property
    def moved(self) -> int:
        """The share of its distance to the goal that V moves in a step, s16.15."""
        return ONE - self.membrane_decay

    def settled(self, charge: float) -> float:
        """Return the current that is never exceeded if the charge arrives in every step."""
        return charge * self.synapse_init / (SPAN - self.synapse_decay)

    def goal(self, drive: float) -> float:
        """Return the potential, in potentials of 1, that V approaches under a drive in weights of 1."""
        return drive * 2.0**47 / (self.moved * self.synapse_init)

    def drive_of(self, bias: int) -> float:
        """Return the drive, in weights of 1, that corresponds to a bias of ``loihi``."""
        return float(loihi.in_units(bias)) * self.synapse_init / SPAN


class Sums(NamedTuple):
    """The largest sum of the weights of each sign that a neuron can receive in a step, in weights of 1."""

    excitatory: int
    inhibitory: int


class IfCurrExp(NamedTuple):
    """The parameters of a neuron, s16.15, that depend on its :class:`Scales`."""

    c_m: int
    v_thresh: int
    i_offset: int


# Time constants.


@lru_cache(maxsize=4096)
def membrane_of(decay_u: int, decay_v: int) -> Membrane:
    """Return the time constants for decays of at least :data:`DECAY_U_MIN` and :data:`DECAY_V_MIN`."""
    tau_m = longest_tau_m(decay_v)
    tau_syn = nearest_tau_syn(decay_u)
    synapse_decay = _kept_of_current(tau_syn)
    init = initial_share(np.array([tau_syn]), np.array([synapse_decay]))
    return Membrane(tau_m, tau_syn, _kept_of_potential(tau_m), synapse_decay, int(init[0]))


def longest_tau_m(decay_v: int) -> int:
    """Return the longest time constant with which V keeps the same share as v of ``loihi``."""
    # From 4096ths to s16.15.
    return _longest(_kept_of_potential, loihi.keep_of(decay_v) << 3)


def nearest_tau_syn(decay_u: int) -> int:
    """Return the longest of the time constants whose decay is nearest to that of u."""
    target = loihi.keep_of(decay_u) << 20  # from 4096ths to u0.32
    # The nearest below the target or at it, and the nearest above it.
    shorter = _longest(_kept_of_current, target)
    if shorter == TAU_MAX:
        return shorter
    longer = _longest(_kept_of_current, _kept_of_current(shorter + 1))
    return min(shorter, longer, key=lambda tau: abs(_kept_of_current(tau) - target))


def current_decay_error(decay_u: int) -> float:
    """Return the error of the share that a current keeps in a step: how far it is from that of u."""
    kept = membrane_of(decay_u, DECAY_V_MIN).synapse_decay  # decay_v does not matter here
    target: int = loihi.keep_of(decay_u) << 20
    return abs(kept - target) / SPAN


def _kept_of_potential(tau: int) -> int:
    """Return e, s16.15, as a core computes it from tau_m, s16.15."""
    return expk(-((ONE << 15) // tau))


def _kept_of_current(tau: int) -> int:
    """Return d, u0.32, as a core computes it from tau_syn, s16.15."""
    return expulr(-((ONE << 15) // tau))


def _longest(kept: Callable[[int], int], most: int) -> int:
    """Return the longest time constant for which ``kept`` is at most ``most``.

    It is found by bisection, as a longer time constant never keeps less.
    """
    low = 1
    high = TAU_MAX
    while low < high:
        middle = (low + high + 1) // 2
        if kept(middle) <= most:
            low = middle
        else:
            high = middle - 1
    return low


# Scales.


def weight_scale(membrane: Membrane, sums: Sums) -> int:
    """Return n such that W = 2^-n nA is the largest W with which this neuron cannot wrap."""
    largest = max(sums)
    current = membrane.settled(largest)
    return _halvings(max(largest / SUM_MAX, current / SPREAD_MAX))


def potential_scale(neuron: LeakyNeuron, sums: Sums, weight: int) -> int:
    """Return n such that S = 2^-n mV is the largest S with which this neuron cannot wrap; W is 2^-weight.

    The goal depends on R, which is rounded: a small c_m has few bits, and R may exceed its exact
    value so far that S must be halved once more.
    """
    membrane = membrane_of(neuron.decay_u, neuron.decay_v)
    drive = spread_of_drive(neuron, sums)
    potential = _halvings(membrane.goal(drive) / SPREAD_MAX)
    scales = Scales(weight, potential)
    reached = drive * scales.weight_unit * resistance_of(capacity_of(membrane, scales), membrane)
    return potential + 1 if reached > SPREAD_MAX * ONE else potential


def spread_of_drive(neuron: LeakyNeuron, sums: Sums) -> float:
    """Return the distance between the lowest and the highest drive of a neuron, in weights of 1."""
    membrane = membrane_of(neuron.decay_u, neuron.decay_v)
    currents = membrane.settled(sums.excitatory) + membrane.settled(sums.inhibitory)
    return currents + abs(membrane.drive_of(neuron.bias))


def _halvings(excess: float) -> int:
    """Return how often 1 must be halved so that ``excess`` times it is at most 1."""
    halvings = 0
    while excess > 1:
        excess /= 2
        halvings += 1
    return halvings


# Parameters.


def capacity_of(membrane: Membrane, scales: Scales) -> int:
    """Return c_m, s16.15, to nearest.

    With the scales of :func:`weight_scale` and :func:`potential_scale` it is at least 64 for all
    decays and weights, so that R fits s16.15 as well.
    """
    scaled = membrane.tau_m * membrane.moved * membrane.synapse_init
    exponent = scales.potential - scales.weight - 47
    return round(Fraction(scaled) * Fraction(2) ** exponent)


def resistance_of(c_m: int, membrane: Membrane) -> int:
    """Return R, s16.15, as a core computes it."""
    return (membrane.tau_m << 15) // c_m


def fitted(neuron: LeakyNeuron, scales: Scales) -> IfCurrExp:
    """Return the parameters of a neuron.

    A threshold above the range of s16.15 becomes :data:`UNREACHABLE`, which no V reaches either.
    """
    membrane = membrane_of(neuron.decay_u, neuron.decay_v)
    c_m = capacity_of(membrane, scales)
    gain = gain_of(c_m, membrane, scales)
    # `loihi` spikes above its threshold, SpiNNaker at it: hence the next V, passed + 1.
    passed = math.floor(gain * neuron.threshold * ONE)
    offset = Fraction(neuron.bias * membrane.synapse_init, loihi.UNIT << 17 + scales.weight)
    return IfCurrExp(c_m, min(passed + 1, UNREACHABLE), round(offset))


def gain_of(c_m: int, membrane: Membrane, scales: Scales) -> Fraction:
    """Return G, by how many mV a weight of 1 lifts V at once."""
    lifted = resistance_of(c_m, membrane) * membrane.moved * membrane.synapse_init
    return Fraction(lifted, 1 << 62 + scales.weight)


def refractory_time(refractory: IntArray) -> IntArray:
    """Return tau_refrac, s16.15, of refractory steps of ``loihi``."""
    steps: IntArray = loihi.blocked_by_spike(refractory)
    return steps * ONE


# Synapses.


def weights_in_units(mantissa: IntArray, exponent: int) -> IntArray:
    """Return the weights of ``loihi``, mantissa times 2^exponent, in weights of 1."""
    units: IntArray = loihi.whole_units(loihi.charge_of(mantissa, exponent))
    return units


def delays_of(delay: IntArray) -> IntArray:
    """Return the delays with which spikes act in the same step as in ``loihi``, where 0 means the next step."""
    return np.asarray(delay, dtype=np.int64) + DELAY_MIN


def shift_for(largest_sum: float) -> int:
    """Return P_r for the largest sum of a step, nA: the least with sum < 2^P, as in sPyNNaker."""
    shift = 0
    while 2.0**shift <= largest_sum:
        shift += 1
    return shift


def sum_with(shift: int) -> float:
    """Return a largest sum, nA, for which :func:`shift_for` gives this shift: three quarters of its range."""
    return 0.75 * 2.0**shift


def stored_weights(weights: FloatArray, shift: int) -> IntArray:
    """Return magnitudes of weights, nA, as a core stores them.

    They are rounded to nearest, half to even, and taken modulo 2^16.
    """
    scaled = np.rint(np.asarray(weights) * 2.0 ** (15 - shift)).astype(np.int64)
    return scaled % (WEIGHT_MAX + 1)


def currents_of(stored: IntArray, shift: int) -> FloatArray:
    """Return stored weights in nA."""
    return np.asarray(stored, dtype=np.float64) * 2.0 ** (shift - 15)


def loses_bits(weights: FloatArray, shift: int) -> int:
    """Return how many magnitudes of weights, nA, change when they are stored."""
    scaled = np.asarray(weights) * 2.0 ** (15 - shift)
    return int(np.count_nonzero(scaled != np.rint(scaled)))
