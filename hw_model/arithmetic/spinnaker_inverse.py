"""From neurons of :mod:`hw_model.arithmetic.loihi` to parameters of ``IF_curr_exp``, on one page.

Both are leaky neurons with a current. ``loihi`` keeps of u and v shares in 4096ths, and counts
potentials in units of a weight of 1; SpiNNaker takes times, capacities, nA and mV, and computes
from them, in integers, what its registers keep. So a setting is searched for, not computed:

    tau_m     the longest with e = 8 (4096 - decay_v), which exists for every decay_v from 1 on
    tau_syn   the longest with d nearest to 2^20 (4096 - decay_u)
    W         nA for a weight of 1: the largest power of two up to 1 at which no current, and no
              shifted ring buffer, can wrap
    S         mV for a potential of 1: likewise, at which no goal, and no distance to it, can wrap
    c_m       so that a weight of 1 lifts V by S at once: tau_m (2^15 - e) init W / (S 2^47)
    G         by how much it then lifts V, as c_m and R are rounded: R (2^15 - e) init W / 2^62 mV
    v_thresh  the least V above G threshold, so that the rounded c_m costs nothing
    i_offset  what a weight of 1 leaves in a current at once, times the bias

No bound below is an estimate: if every source spikes at most once a step, nothing wraps. A goal is
1 / (1 - e) times a drive, and leaves s16.15 long before V does. That is what S is for.
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
"""32,768 ms in s16.15. Of longer times, -1 ms / tau is 0."""
SUM_MAX = (1 << 15) - 1
"""The largest sum of weights of a step, nA: shifted into s16.15, it stays below 2^31."""
SPREAD_MAX = (1 << 16) - 1
"""The largest currents, nA, and the widest range of goals, mV, that cannot wrap."""
UNREACHABLE = HALF_SPAN - 1
"""A threshold that no V below it passes: of neurons whose potentials are read out."""


class LeakyNeuron(NamedTuple):
    """A neuron of ``loihi``: its parameters as that page has them, ``bias`` in the unit of u."""

    decay_u: int
    decay_v: int
    threshold: int
    bias: int
    refractory: int


class Scales(NamedTuple):
    """W and S by the powers of two that they are: 2^-weight nA and 2^-potential mV."""

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
    """Time constants, s16.15, and what a core makes of them."""

    tau_m: int
    tau_syn: int
    membrane_decay: int
    synapse_decay: int
    synapse_init: int

    @property
    def moved(self) -> int:
        """The share of a distance that V goes in a step, s16.15."""
        return ONE - self.membrane_decay

    def settled(self, charge: float) -> float:
        """Return the current at which a charge in every step settles; no step passes it."""
        return charge * self.synapse_init / (SPAN - self.synapse_decay)

    def goal(self, drive: float) -> float:
        """Return how far a drive, in weights of 1, lets V go, in potentials of 1."""
        return drive * 2.0**47 / (self.moved * self.synapse_init)

    def drive_of(self, bias: int) -> float:
        """Return what drives V as a bias of ``loihi`` does, in weights of 1."""
        return float(loihi.in_units(bias)) * self.synapse_init / SPAN


class Sums(NamedTuple):
    """The most that weights of each sign can bring to a neuron in a step, in weights of 1."""

    excitatory: int
    inhibitory: int


class IfCurrExp(NamedTuple):
    """Parameters of a neuron, s16.15, that depend on its scales."""

    c_m: int
    v_thresh: int
    i_offset: int


# Time constants.


@lru_cache(maxsize=4096)
def membrane_of(decay_u: int, decay_v: int) -> Membrane:
    """Return the time constants of decays from :data:`DECAY_U_MIN` and :data:`DECAY_V_MIN` on."""
    tau_m = longest_tau_m(decay_v)
    tau_syn = nearest_tau_syn(decay_u)
    synapse_decay = _kept_of_current(tau_syn)
    init = initial_share(np.array([tau_syn]), np.array([synapse_decay]))
    return Membrane(tau_m, tau_syn, _kept_of_potential(tau_m), synapse_decay, int(init[0]))


def longest_tau_m(decay_v: int) -> int:
    """Return the longest time constant with which V keeps what v of ``loihi`` keeps."""
    return _longest(_kept_of_potential, loihi.keep_of(decay_v) << 3)


def nearest_tau_syn(decay_u: int) -> int:
    """Return the longest of the time constants whose decay is nearest to that of u."""
    wanted = loihi.keep_of(decay_u) << 20
    shorter = _longest(_kept_of_current, wanted)
    if shorter == TAU_MAX:
        return shorter
    longer = _longest(_kept_of_current, _kept_of_current(shorter + 1))
    return min(shorter, longer, key=lambda tau: abs(_kept_of_current(tau) - wanted))


def current_decay_error(decay_u: int) -> float:
    """Return by how much what a step keeps of a current is off, as a share of the current."""
    kept = membrane_of(decay_u, DECAY_V_MIN).synapse_decay
    wanted: int = loihi.keep_of(decay_u) << 20
    return abs(kept - wanted) / SPAN


def _kept_of_potential(tau: int) -> int:
    """Return e, s16.15, as a core computes it from tau_m, s16.15."""
    return expk(-((ONE << 15) // tau))


def _kept_of_current(tau: int) -> int:
    """Return d, u0.32, as a core computes it from tau_syn, s16.15."""
    return expulr(-((ONE << 15) // tau))


def _longest(kept: Callable[[int], int], most: int) -> int:
    """Return the longest time constant with which a step keeps ``most`` at the most.

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
    """Return which power of two W is, 2^-n, for a neuron."""
    largest = max(sums)
    current = membrane.settled(largest)
    return _halvings(max(largest / SUM_MAX, current / SPREAD_MAX))


def potential_scale(neuron: LeakyNeuron, sums: Sums, weight: int) -> int:
    """Return which power of two S is, 2^-n, for a neuron whose W is 2^-weight.

    The bound is that of the resistance as rounded: where few bits of c_m are left, S is halved
    once more.
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

    By the scales of :func:`weight_scale` and :func:`potential_scale` it is 64 or more, whatever the
    decays and weights, so that R fits as well.
    """
    scaled = membrane.tau_m * membrane.moved * membrane.synapse_init
    exponent = scales.potential - scales.weight - 47
    return round(Fraction(scaled) * Fraction(2) ** exponent)


def resistance_of(c_m: int, membrane: Membrane) -> int:
    """Return R, s16.15, as a core computes it."""
    return (membrane.tau_m << 15) // c_m


def fitted(neuron: LeakyNeuron, scales: Scales) -> IfCurrExp:
    """Return the parameters of a neuron.

    A threshold that s16.15 does not hold lies beyond every V, and so does :data:`UNREACHABLE`.
    """
    membrane = membrane_of(neuron.decay_u, neuron.decay_v)
    c_m = capacity_of(membrane, scales)
    gain = gain_of(c_m, membrane, scales)
    passed = math.floor(gain * neuron.threshold * ONE)
    offset = Fraction(neuron.bias * membrane.synapse_init, loihi.UNIT << 17 + scales.weight)
    return IfCurrExp(c_m, min(passed + 1, UNREACHABLE), round(offset))


def gain_of(c_m: int, membrane: Membrane, scales: Scales) -> Fraction:
    """Return G, how far a weight of 1 lifts V at once, in mV."""
    lifted = resistance_of(c_m, membrane) * membrane.moved * membrane.synapse_init
    return Fraction(lifted, 1 << 62 + scales.weight)


def refractory_time(refractory: IntArray) -> IntArray:
    """Return tau_refrac, s16.15, of refractory steps of ``loihi``."""
    steps: IntArray = loihi.blocked_by_spike(refractory)
    return steps * ONE


# Synapses.


def weights_in_units(mantissa: IntArray, exponent: int) -> IntArray:
    """Return weights of ``loihi`` in weights of 1."""
    units: IntArray = loihi.whole_units(loihi.charge_of(mantissa, exponent))
    return units


def delays_of(delay: IntArray) -> IntArray:
    """Return the delays with which spikes act in the same step as in ``loihi``."""
    return np.asarray(delay, dtype=np.int64) + DELAY_MIN


def shift_for(largest_sum: float) -> int:
    """Return P_r for the largest sum of a step, nA: the least with sum < 2^P, as in sPyNNaker."""
    shift = 0
    while 2.0**shift <= largest_sum:
        shift += 1
    return shift


def sum_with(shift: int) -> float:
    """Return a largest sum, nA, for which the shift is this one."""
    return 0.75 * 2.0**shift


def stored_weights(weights: FloatArray, shift: int) -> IntArray:
    """Return weights, nA without sign, as a core stores them.

    They are rounded to nearest, half to even, and kept modulo 2^16.
    """
    scaled = np.rint(np.asarray(weights) * 2.0 ** (15 - shift)).astype(np.int64)
    return scaled % (WEIGHT_MAX + 1)


def currents_of(stored: IntArray, shift: int) -> FloatArray:
    """Return what stored weights count, in nA."""
    return np.asarray(stored, dtype=np.float64) * 2.0 ** (shift - 15)


def loses_bits(weights: FloatArray, shift: int) -> int:
    """Return how many weights, nA without sign, are stored rounded."""
    scaled = np.asarray(weights) * 2.0 ** (15 - shift)
    return int(np.count_nonzero(scaled != np.rint(scaled)))
