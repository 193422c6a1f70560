"""The arithmetic of ``loihi-sim``, a chip like Intel's Loihi, on one page. Read it from top to bottom.

This is the only definition of what a step does to a compartment: both engines, the open core's tests and the twin in
floats run or are compared with the code below.

REGISTERS of a compartment; all are 0 at rest. Bits are those of loihi-sim, and the sign comes on top.

    q         21 bits   charge that arrived in this step     wraps
    u         23 bits   current                              wraps, and so does u + bias
    v         23 bits   voltage                              is clipped to vmin..vmax
    blocked             refractory steps that are left

PARAMETERS: compartments with the same decays and refractory steps share them as a *profile*; each compartment has its
own threshold and bias, and a core has one vmin and vmax.

    decay_u, decay_v    0..4096               share lost per step, in 4096ths: 0 keeps all, 4096 nothing
    threshold           0..2^17 - 1           in units of 64
    bias                13 bits signed, times 2^(0..7)
    refractory          1..63                 least number of steps from a spike to the next
    vmin, vmax          -(2^23 - 1) or 1 - 2^k, and 2^23 - 1 or 2^(9 + 2k) - 1

SYNAPSES: a spike of row t, of an input or of a compartment, acts at step t + 1 + delay, delay 0..62. Its charge is
64 floor(mantissa 2^exponent), exponent -8..7; :func:`hw_model.arithmetic.fixed_point.weight_grid` lists the mantissas.
Charges of a step are added up without loss, and the sum wraps once, when it is read.

JOINED compartments have no threshold: they never spike, and their parent gets their v of the same step.

THE STEP, in the order of the code below:

    q       = wrap(sum of the charges that act now)
    u       = wrap(kept(u, decay_u) + q)
    v       = clip(kept(v, decay_v) + wrap(u + bias) + v of joined children, vmin, vmax)
    spike   where v > 64 threshold, unless blocked
    v       = 0 after a spike and while blocked
    blocked = refractory - 1 after a spike, else one less

    kept(x, decay) = x (4096 - decay) / 4096, truncated toward zero

EVENTS that are counted: q wrapped; u wrapped, or u + bias did; v was clipped. While a compartment is blocked, clips of
v and wraps of u + bias have no effect and are not counted.

The code below leaves open what a number is, and takes the operations on it from :class:`Operations`. With int64 arrays
it is the plain engine, with vectors of 16 compartments the fast one, and with floats, some of them truncated, the twin
that takes rounding errors apart.

Two pages follow from this one: :mod:`hw_model.arithmetic.loihi_inverse` finds the settings for a
trained network, and :mod:`hw_model.arithmetic.loihi_bounds` says how far registers can go.
"""

from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

import numpy as np

from hw_model.arithmetic.fixed_point import (
    DECAY_BITS,
    DECAY_ONE,
    WEIGHT_EXPONENTS,
    WEIGHT_SHIFT,
    effective_weight,
    half_range,
)
from hw_model.values import BoolArray, IntArray

if TYPE_CHECKING:
    from hw_model.description.chip import Registers

UNIT = 1 << WEIGHT_SHIFT
"""The smallest charge of a synapse that is not 0, in counts of a register. Charges are multiples of it."""

Value = Any
"""A number of one or many compartments: it adds, subtracts and compares by Python's operators."""
Truth = Any
"""The result of comparing values: it combines with ``&``, ``|`` and ``~``."""


class Operations(Protocol):
    """The operations of a step, besides sums, differences and comparisons."""

    def wrap_charge(self, q: Value) -> Value:
        """Return q as its register holds it: in two's complement."""

    def wrap_current(self, u: Value) -> Value:
        """Return u, or u + bias, as the register of u holds it."""

    def charged(self, q: Value) -> Value:
        """Return q in the unit of u. Engines may add up charges in units of 64, as they are multiples of it."""

    def kept(self, x: Value, keep: Value) -> Value:
        """Return x keep / 4096, truncated toward zero."""

    def clip(self, v: Value, low: Value, high: Value) -> Value:
        """Return the value nearest to v within low..high."""

    def select(self, condition: Truth, chosen: Value, otherwise: Value) -> Value:
        """Return ``chosen`` where the condition holds, else ``otherwise``."""


class Parameters(NamedTuple):
    """Parameters as the step uses them: see :func:`keep_of`, :func:`bias_of` and :func:`threshold_of`."""

    keep_u: Value
    keep_v: Value
    bias: Value
    threshold: Value
    """At or above vmax for a joined compartment, which therefore never spikes."""
    refractory: Value
    vmin: Value
    vmax: Value


AT_REST = 0
"""Every register before the first step, and v after a spike and while blocked."""


class State(NamedTuple):
    """Registers between two steps. ``blocked`` counts the refractory steps that are left."""

    u: Value
    v: Value
    blocked: Value


class Response(NamedTuple):
    """What charge does to a compartment before the threshold.

    ``..._sum`` is an exact sum, and the name without ``_sum`` is what a register holds of it: wrapped or clipped.
    ``drive`` is u + bias.
    """

    charge_sum: Value
    q: Value
    u_sum: Value
    u: Value
    drive_sum: Value
    drive: Value
    v_sum: Value
    v: Value


class Step(NamedTuple):
    """Everything that a step does: the registers after it, and what is recorded and counted.

    ``potential`` is v as it was compared with the threshold, and ``live`` says which compartments were not blocked.
    """

    state: State
    fired: Truth
    potential: Value
    live: Truth
    response: Response


def step(ops: Operations, p: Parameters, state: State, charge: Value, joined: Value) -> Step:
    """Run one step. ``charge`` is the charge that acts now, and ``joined`` the sum of the v of joined children."""
    response = respond(ops, p, state.u, state.v, charge, joined)
    live, potential, fired = threshold(ops, p, state.blocked, response.v)
    v = reset(ops, potential, fired)
    blocked = count_down(ops, p, state.blocked, fired)
    return Step(State(response.u, v, blocked), fired, potential, live, response)


def respond(
    ops: Operations, p: Parameters, u: Value, v: Value, charge: Value, joined: Value
) -> Response:
    """Let u and v decay and take up charge, bias and what children pass."""
    q = ops.wrap_charge(charge)
    u_sum = ops.kept(u, p.keep_u) + ops.charged(q)
    u = ops.wrap_current(u_sum)
    drive_sum = u + p.bias
    drive = ops.wrap_current(drive_sum)
    v_sum = ops.kept(v, p.keep_v) + drive + joined
    v = ops.clip(v_sum, p.vmin, p.vmax)
    return Response(charge, q, u_sum, u, drive_sum, drive, v_sum, v)


def threshold(
    ops: Operations, p: Parameters, blocked: Value, v: Value
) -> tuple[Truth, Value, Truth]:
    """Return which compartments are not blocked, v as it is compared with the threshold, and which spike."""
    live = blocked == 0
    potential = ops.select(live, v, AT_REST)
    fired = live & (potential > p.threshold)
    return live, potential, fired


def reset(ops: Operations, potential: Value, fired: Truth) -> Value:
    """Return v after the step: 0 where it spiked."""
    return ops.select(fired, AT_REST, potential)


def count_down(ops: Operations, p: Parameters, blocked: Value, fired: Truth) -> Value:
    """Return how many refractory steps are left after the step."""
    fewer = ops.select(blocked == 0, 0, blocked - 1)
    return ops.select(fired, blocked_by_spike(p.refractory), fewer)


def blocked_by_spike(refractory: Value) -> Value:
    """Return how many steps a spike blocks, not counting its own: with refractory 1, none."""
    return refractory - 1


EVENTS = ("charge_wraps", "current_wraps", "voltage_clips")
"""The names of the events that are counted."""


def events(response: Response, live: Truth) -> tuple[tuple[str, Truth], ...]:
    """Return which compartments met an event in a step. If u and u + bias both wrap, both count."""
    r = response
    return (
        ("charge_wraps", r.q != r.charge_sum),
        ("current_wraps", r.u != r.u_sum),
        ("current_wraps", live & (r.drive != r.drive_sum)),
        ("voltage_clips", live & (r.v != r.v_sum)),
    )


# Which values parameters and registers can hold; ``registers`` are the widths in a chip's YAML file.


class Domain(NamedTuple):
    """The integers that a parameter can be, from ``low`` to ``high`` inclusive."""

    low: int
    high: int

    def holds(self, values: IntArray | int) -> BoolArray:
        """Return which values lie in the domain."""
        array = np.asarray(values)
        return np.asarray((array >= self.low) & (array <= self.high))


DECAYS = Domain(0, DECAY_ONE)
KEEPS_ALL = DECAYS.low
"""The decay that loses nothing."""
FORGETS = DECAYS.high
"""The decay that keeps nothing."""
MANTISSAS = Domain(low=-256, high=255)
"""Mantissas of weights over all synapse formats."""
EXPONENTS = Domain(WEIGHT_EXPONENTS[0], WEIGHT_EXPONENTS[-1])


def domains(registers: "Registers") -> dict[str, Domain]:
    """Return the domain of every parameter of a compartment, and of a delay, by name."""
    bias = half_range(registers.bias_mantissa_bits)
    return {
        "decay_u": DECAYS,
        "decay_v": DECAYS,
        "threshold": Domain(0, registers.threshold_mantissa_max),
        "bias_mantissa": Domain(-bias, bias - 1),
        "bias_exponent": Domain(0, registers.bias_exponent_max),
        "refractory": Domain(1, registers.refractory_max),
        "delay": Domain(0, registers.delay_max),
    }


def voltage_minima(registers: "Registers") -> list[int]:
    """Return the values that vmin of a core can have: ``1 - 2^k``, the last of which is the register's own end."""
    return [1 - half_range(k) for k in range(registers.voltage_bits + 1)]


def held_minimum(vmin: IntArray, registers: "Registers") -> IntArray:
    """Return lower limits as cores hold them.

    The format allows ``1 - 2^k`` up to k = 31; a limit below the register's end is that end. Other values stay as they
    are, for a check to refuse.
    """
    forms = [1 - half_range(k) for k in range(32)]
    within_register = np.maximum(vmin, -registers.voltage_max)
    return np.where(np.isin(vmin, forms), within_register, vmin)


def voltage_maxima(registers: "Registers") -> list[int]:
    """Return the values that vmax of a core can have: ``2^(9 + 2k) - 1``, and the register's own end."""
    forms = [half_range(bits) - 1 for bits in range(9, registers.voltage_bits, 2)]
    return [*forms, registers.voltage_max]


def charge_span(charge_bits: int) -> int:
    """Return the span, in units of 64, of a register of q with ``charge_bits`` bits: q is within -span..span - 1."""
    return half_range(charge_bits - WEIGHT_SHIFT)


def largest_charge(charge_bits: int) -> int:
    """Return the largest charge of a step, in units of 64."""
    return charge_span(charge_bits) - 1


# Between numbers as a program stores them and numbers as the step uses them. A unit is the charge of a weight of 1, and
# 1 in a stored threshold: 64 counts of a register.


def acts_at(row: Value, delay: Value) -> Value:
    """Return the step at which a spike of step ``row`` acts, over a synapse with a delay."""
    return row + 1 + delay


def keep_of(decay: Value) -> Value:
    """Return the share that a step keeps, in 4096ths."""
    return DECAY_ONE - decay


def bias_of(mantissa: IntArray, exponent: IntArray) -> IntArray:
    """Return the bias, which a step adds to u before it drives v."""
    return mantissa << exponent


def in_registers(units: Value) -> Value:
    """Return units, whole or not, in counts of a register: times 64."""
    return units * UNIT


def in_units(value: Value) -> Value:
    """Return a register's value in units, with fractions."""
    return value / UNIT


def whole_units(charge: Value) -> Value:
    """Return a register's value in whole units, rounded down. For charges, which are multiples of 64, it is exact."""
    return charge >> WEIGHT_SHIFT


def threshold_of(mantissa: Value) -> Value:
    """Return the value that v must exceed to spike. The compiler, which searches for one, also passes fractions."""
    return in_registers(mantissa)


charge_of = effective_weight
BITS_OF_UNITS = {"decay_bits": DECAY_BITS, "weight_shift": WEIGHT_SHIFT}
"""For files of other tools, under their names: a decay counts 2^decay_bits parts, and a unit is 2^weight_shift counts
of a register."""
