"""The arithmetic of SpiNNaker 1 with sPyNNaker's ``IF_curr_exp``, on one page. Read it from top to bottom.

A core is an ARM processor without floating point. This page is what its machine code computes in
steps of 1 ms. ``tests/peers/spinnaker_machine.py`` runs that machine code in an emulator, next to this page.

FORMATS

    s16.15    32 bits with a sign, in units of 2^-15. Sums and differences keep their low 32 bits,
              without a warning: here they *wrap*
    u0.32     32 bits without a sign, in units of 2^-32
    x >> n    shift of a product of 64 bits: rounded down, never to nearest

REGISTERS of a neuron, with two receptors r: 0 excites, 1 inhibits

    V               membrane potential, s16.15 mV; v_init at first
    I_r             current of a receptor, s16.15 nA; 0 at first
    refr            refractory steps that are left, in which V does not move; 0 at first
    ring[slot, r]   weights that arrive in later steps; 16 bits without a sign, saturates

PARAMETERS of a neuron, s16.15

    tau_m, c_m      above 0: ms, nF        tau_syn_r         above 0: ms
    tau_refrac      0 or more: ms          i_offset          nA
    v_rest, v_reset, v_thresh, v_init      mV

A core computes CONSTANTS from them when it starts, where a / b is (a << 15) div b:

    R       = tau_m / c_m                                s16.15, MOhm; wraps
    e       = expk(-1 ms / tau_m)                        s16.15, share of its distance to the goal
                                                         that V keeps in a step
    d_r     = expulr(-1 ms / tau_syn_r)                  u0.32, what I_r keeps;
                                                         0 for more than 32,768 ms, so that I_r
                                                         lasts for one step
    init_r  = tau_syn_r (2^32 - 1 - d_r) >> 15           u0.32, keeps its low 32 bits
    T       = tau_refrac, rounded up to whole steps

SYNAPSES hold weights of 16 bits without a sign; the receptor gives it. A population has a shift P_r
for each receptor: a stored weight counts 2^(P_r - 15) nA. Delays are 1..slots steps, where a ring
buffer has a power of two of slots.

THE STEP t, in the order of the code below; what is in brackets wraps:

    I_r   = [I_r + (init_r [ring[t mod slots, r] << P_r] >> 32)],  and the slot is emptied
    if refr > 0:  refr = refr - 1
    else:         drive = [I_0 - I_1 + i_offset]
                  goal  = [(drive R >> 15) + v_rest]
                  V     = [goal - ([goal - V] e >> 15)]
    if V >= v_thresh, in refractory steps as well: a spike, V = v_reset, refr = T
    I_r   = I_r d_r >> 32

WHEN: a spike of step t and a synapse of delay D act in step t + D. A core that is behind processes
it ``lateness`` steps later, 0..15. The synapse still acts in t + D if its delay is longer than
that; otherwise it is dropped. A delay of all slots is stored as 0, and is never found late.

EVENTS that are counted: wraps of shifted ring buffers, of currents, and of drives, goals, distances
and potentials together; weights that saturated a ring buffer; synapses that came too late.
"""

from collections.abc import Callable
from decimal import Decimal, localcontext
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from hw_model.values import BoolArray, IntArray

ONE = 1 << 15
"""1 in s16.15; as a time, the step of 1 ms."""
HALF_SPAN = 1 << 31
"""s16.15 holds integers from minus this to below it."""
SPAN = 1 << 32
"""1 in u0.32; integers that a word of 32 bits distinguishes."""
RING_MAX = (1 << 16) - 1
"""The largest entry of a ring buffer; more saturates."""
WEIGHT_MAX = (1 << 16) - 1
"""The largest weight as stored."""
RECEPTOR_COUNT = 2
"""Receptors of a neuron: 0 excites, 1 inhibits."""
EXCITATORY, INHIBITORY = range(RECEPTOR_COUNT)
SHIFT_MAX = 16
"""The largest P_r for which the machine code was run and compared with this page."""
DELAY_MIN = 1
"""Steps: a spike acts in the next step at the earliest."""
LATENESS_MAX = 15
"""Steps: the key of a spike carries its step modulo 16, so a greater lateness could not be recognised."""
EVENTS = (
    "ring_wraps",
    "current_wraps",
    "potential_wraps",
    "saturated_weights",
    "late_synapses",
)
"""The names of the events that are counted."""


class Parameters(NamedTuple):
    """The parameters of n neurons, in s16.15: tau_syn (n, receptors), all others (n,)."""

    tau_m: IntArray
    c_m: IntArray
    tau_syn: IntArray
    v_rest: IntArray
    v_reset: IntArray
    v_thresh: IntArray
    v_init: IntArray
    i_offset: IntArray
    tau_refrac: IntArray


class Constants(NamedTuple):
    """What a core computes from the parameters of n neurons when it starts.

    ``synapse_decay`` (d_r) and ``synapse_init`` (init_r) are (n, receptors) in u0.32, all others (n,).
    """

    resistance: IntArray
    membrane_decay: IntArray
    synapse_decay: IntArray
    synapse_init: IntArray
    refractory_steps: IntArray


class State(NamedTuple):
    """Registers of n neurons between two steps: current (n, receptors), v and refractory (n,)."""

    v: IntArray
    current: IntArray
    refractory: IntArray


class Step(NamedTuple):
    """What a step of n neurons does.

    ``state`` are the registers after it, ``potential`` (n,) is V, s16.15, as it was compared with
    the threshold, ``fired`` (n,) says who spiked, and ``wraps`` counts wraps by names of :data:`EVENTS`.
    """

    state: State
    potential: IntArray
    fired: BoolArray
    wraps: dict[str, int]


def wrap(x: IntArray) -> IntArray:
    """Return the low 32 bits of x, of which the highest is the sign."""
    return ((x + HALF_SPAN) & (SPAN - 1)) - HALF_SPAN


# Constants, as a core computes them when it starts.


def constants(p: Parameters) -> Constants:
    """Return what a core computes from the parameters of its neurons."""
    decay = of_each(expulr, -quotient(ONE, p.tau_syn))
    return Constants(
        resistance=quotient(p.tau_m, p.c_m),
        membrane_decay=of_each(expk, -quotient(ONE, p.tau_m)),
        synapse_decay=decay,
        synapse_init=initial_share(p.tau_syn, decay),
        refractory_steps=-(-p.tau_refrac // ONE),
    )


def quotient(numerator: IntArray | int, denominator: IntArray) -> IntArray:
    """Return a / b in s16.15; a is 0 or more and b above 0, both s16.15."""
    return wrap((numerator << 15) // denominator)


def initial_share(tau_syn: IntArray, synapse_decay: IntArray) -> IntArray:
    """Return the share of a weight that reaches a current at once, u0.32.

    With it, the currents of all later steps add up to tau_syn times the weight.
    """
    return (tau_syn * (SPAN - 1 - synapse_decay) >> 15) % SPAN


EXPONENT_MIN = -340695
"""-15 ln 2 in s16.15: below it, e^x is less than 2^-15, the least that s16.15 holds."""
EXPONENT_MAX = 363408
"""16 ln 2 in s16.15: above it, e^x is more than s16.15 holds."""
SIXTEENTH = ONE >> 4
"""1/16 in s16.15."""


# `expk` and `expulr` have the names of the functions of the machine code: exp to an `accum`, of s16.15, and to an
# `unsigned long fract`, of u0.32.


def expk(x: int) -> int:
    """Return e^x in s16.15, of x in s16.15."""
    if x < EXPONENT_MIN:
        return 0
    if x > EXPONENT_MAX:
        return HALF_SPAN - 1
    return _exponential(x) >> 17


def expulr(x: int) -> int:
    """Return e^x in u0.32, of x in s16.15; e^0 is 0, as 1 does not fit.

    It is cut where :func:`expk` is, and to the same values, as in the machine code.
    """
    if x < EXPONENT_MIN:
        return 0
    if x > EXPONENT_MAX:
        return HALF_SPAN - 1
    return _exponential(x) % SPAN


def _exponential(x: int) -> int:
    """Return 2^32 e^x of x in s16.15.

    With x = whole - sixteenths / 16 - rest, where whole is an integer and 0 <= rest < 1/16,
    e^x = e^whole e^(-sixteenths / 16) e^-rest. To multiply by a factor f below 1, the machine code
    subtracts the share 1 - f of the product.
    """
    whole = -(-x // ONE)  # rounded up
    below = whole * ONE - x
    product = _power(whole)
    if below == 0:
        return product
    sixteenths, rest = divmod(below, SIXTEENTH)
    product -= _share(product, _lost_by_sixteenths(sixteenths))
    product -= _share(product, _lost_by_rest(rest << 17))  # from s16.15 to u0.32
    return product


@lru_cache
def _power(exponent: int) -> int:
    """Return 2^32 e^exponent, to nearest."""
    with localcontext(prec=50):
        return round(SPAN * Decimal(exponent).exp())


@lru_cache
def _lost_by_sixteenths(sixteenths: int) -> int:
    """Return 2^32 (1 - e^(-sixteenths / 16)), to nearest."""
    with localcontext(prec=50):
        return round(SPAN * (1 - (-Decimal(sixteenths) / 16).exp()))


def _lost_by_rest(y: int) -> int:
    """Return 1 - e^-y, all in u0.32, for y below 1/16.

    This is a polynomial of the second degree, c0 + y (c1 - y c2), with the coefficients of the
    machine code. It is off by 5,295 at the most, so that it gives 5,294 and not 0 for y = 0.
    """
    slope = 4293434720 - (y * 2081624032 >> 32)
    return 5294 + (y * slope >> 32)


def _share(wide: int, factor: int) -> int:
    """Return the share ``factor``, u0.32, of a number of 64 bits.

    The machine multiplies the high and the low word of the number separately, and rounds only the
    product of the low word, to nearest.
    """
    high, low = divmod(wide, SPAN)
    return high * factor + (low * factor + HALF_SPAN >> 32)


def of_each(function: Callable[[int], int], values: IntArray) -> IntArray:
    """Apply a function to every integer of an array, once per value: neurons mostly share parameters."""
    distinct, index_of_distinct = np.unique(values, return_inverse=True)
    results = [function(value) for value in distinct.tolist()]
    return np.array(results, dtype=np.int64)[index_of_distinct].reshape(values.shape)


# The step. The formulas take arrays or single numbers, so that loops can compile them, and do not wrap: callers do.


def charged(current: IntArray, init: IntArray, shifted_ring: IntArray) -> IntArray:
    """Return a current, s16.15, plus the share ``init``, u0.32, of the weights of a slot."""
    return current + (init * shifted_ring >> 32)


def drive_of(excitation: IntArray, inhibition: IntArray, i_offset: IntArray) -> IntArray:
    """Return the current that drives a membrane, s16.15 nA."""
    return excitation - inhibition + i_offset


def goal_of(drive: IntArray, resistance: IntArray, v_rest: IntArray) -> IntArray:
    """Return where V would come to rest under a constant drive, s16.15 mV."""
    return (drive * resistance >> 15) + v_rest


def approached(goal: IntArray, distance: IntArray, membrane_decay: IntArray) -> IntArray:
    """Return V, s16.15 mV, after a step towards its goal; before it, V was ``distance`` below the goal."""
    return goal - (distance * membrane_decay >> 15)


def faded(current: IntArray, synapse_decay: IntArray) -> IntArray:
    """Return a current, s16.15 nA, after the decay of a step."""
    return current * synapse_decay >> 32


def step(p: Parameters, c: Constants, shifts: IntArray, state: State, ring: IntArray) -> Step:
    """Run one step of n neurons.

    ``ring`` (n, receptors) holds the sums of stored weights that act in this step; ``shifts``
    (receptors,) are P_r. The caller empties the slot. A name with ``_sum`` is exact, and the same name
    without it has wrapped.
    """
    shifted_sum = ring << shifts
    shifted = wrap(shifted_sum)
    current_sum = charged(state.current, c.synapse_init, shifted)
    current = wrap(current_sum)

    drive_sum = drive_of(current[:, EXCITATORY], current[:, INHIBITORY], p.i_offset)
    drive = wrap(drive_sum)
    goal_sum = goal_of(drive, c.resistance, p.v_rest)
    goal = wrap(goal_sum)
    distance_sum = goal - state.v
    distance = wrap(distance_sum)
    v_sum = approached(goal, distance, c.membrane_decay)
    moves = state.refractory == 0
    potential = np.where(moves, wrap(v_sum), state.v)

    fired = potential >= p.v_thresh  # a neuron that is refractory fires as well
    refractory_left = np.maximum(state.refractory - 1, 0)
    after = State(
        v=np.where(fired, p.v_reset, potential),
        current=faded(current, c.synapse_decay),
        refractory=np.where(fired, c.refractory_steps, refractory_left),
    )
    # A refractory neuron does not compute these sums, so they cannot wrap.
    potential_sums = np.stack([drive_sum, goal_sum, distance_sum, v_sum])[:, moves]
    wraps = {
        "ring_wraps": wraps_of(shifted_sum),
        "current_wraps": wraps_of(current_sum),
        "potential_wraps": wraps_of(potential_sums),
    }
    return Step(after, potential, fired, wraps)


def wraps_of(exact: IntArray) -> int:
    """Return how many exact sums do not fit a word of 32 bits."""
    return int(np.count_nonzero(wrap(exact) != exact))


# How weights arrive, synapse by synapse.


def slot_of(sent: int, delay: int, slots: int) -> int:
    """Return the slot of the ring buffer to which a spike of step ``sent`` adds its weight."""
    return (sent + delay) % slots


def comes_too_late(lateness: int, delay: int, slots: int) -> bool:
    """Return whether a synapse is processed only after the step in which it should act has begun.

    A delay of all slots is stored as 0, which the machine code never finds late.
    """
    return delay < slots and lateness >= delay


def collected(entry: int, weight: int) -> int:
    """Return an entry of a ring buffer after adding a weight; it saturates."""
    return min(entry + weight, RING_MAX)
