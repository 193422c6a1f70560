"""The arithmetic of ``loihi-sim``, on one page: hold it next to the data sheet and read from top to bottom.

REGISTERS of a compartment; all are 0 at rest. Bits are those of loihi-sim, and the sign comes on top.

    q         21 bits   charge that arrived in this step     wraps
    u         23 bits   current                              wraps, and so does u + bias
    v         23 bits   voltage                              is clipped to vmin..vmax
    blocked             refractory steps that are left

PARAMETERS: a profile of compartments holds decays and refractory, each compartment its threshold and bias, and the
core vmin and vmax.

    decay_u, decay_v    0..4096               4096 parts lose so many in a step: 0 keeps all, 4096 nothing
    threshold           0..2^17 - 1           in units of 64
    bias                13 bits signed, times 2^(0..7)
    refractory          1..63                 steps from a spike until the next at the least
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

EVENTS that are counted: q wrapped; u wrapped, or u + bias did; v was clipped. Those of v, and of u + bias, not while
blocked.

Nothing below says what a number is: :class:`Operations` does. Integers of 64 bits make it the plain engine, vectors of
a chunk of compartments the fast one, and floats of which some are truncated the twin that takes errors apart.

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
"""The least charge that a weight can be."""

Value = Any
"""A number of one or many compartments: it adds, subtracts and compares by Python's operators."""
Truth = Any
"""What comparing values gives: it combines by ``&``, ``|`` and ``~``."""


class Operations(Protocol):
    """What the step is written over, next to sums, differences and comparisons."""

    def wrap_charge(self, q: Value) -> Value:
        """Return q as its register holds it: in two's complement."""

    def wrap_current(self, u: Value) -> Value:
        """Return u, or u + bias, as the register of u holds it."""

    def charged(self, q: Value) -> Value:
        """Return q in the unit of u: charges are multiples of 64, and may be collected as such."""

    def kept(self, x: Value, keep: Value) -> Value:
        """Return x keep / 4096, truncated toward zero."""

    def clip(self, v: Value, low: Value, high: Value) -> Value:
        """Return the value nearest to v within low..high."""

    def select(self, condition: Truth, chosen: Value, otherwise: Value) -> Value:
        """Return one value where the condition holds, and the other where not."""


class Parameters(NamedTuple):
    """Parameters as the step reads them: see :func:`keep_of`, :func:`bias_of` and :func:`threshold_of`."""

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
    """Registers between two steps."""

    u: Value
    v: Value
    blocked: Value


class Response(NamedTuple):
    """What charge does to a compartment before any threshold; ``..._sum`` is a number before its register holds it."""

    charge_sum: Value
    q: Value
    u_sum: Value
    u: Value
    drive_sum: Value
    drive: Value
    v_sum: Value
    v: Value


class Step(NamedTuple):
    """All that a step does: registers after it, whether it spikes, and v as the threshold saw it."""

    state: State
    fired: Truth
    potential: Value
    live: Truth
    response: Response


def step(ops: Operations, p: Parameters, state: State, charge: Value, joined: Value) -> Step:
    """Take the charge that acts now, and the sum of the v of joined children."""
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
    """Return which are not blocked, v as the threshold sees it, and which spike."""
    live = blocked == 0
    potential = ops.select(live, v, AT_REST)
    fired = live & (potential > p.threshold)
    return live, potential, fired


def reset(ops: Operations, potential: Value, fired: Truth) -> Value:
    """Return v after the spikes of a step."""
    return ops.select(fired, AT_REST, potential)


def count_down(ops: Operations, p: Parameters, blocked: Value, fired: Truth) -> Value:
    """Return how many steps are blocked after the spikes of a step."""
    fewer = ops.select(blocked == 0, 0, blocked - 1)
    return ops.select(fired, blocked_by_spike(p.refractory), fewer)


def blocked_by_spike(refractory: Value) -> Value:
    """Return how many steps a spike blocks, after its own."""
    return refractory - 1


EVENTS = ("charge_wraps", "current_wraps", "voltage_clips")
"""What is counted of every step, by name."""


def events(response: Response, live: Truth) -> tuple[tuple[str, Truth], ...]:
    """Return what wrapped or was clipped in a step: u and u + bias may both wrap, and then both count."""
    r = response
    return (
        ("charge_wraps", r.q != r.charge_sum),
        ("current_wraps", r.u != r.u_sum),
        ("current_wraps", live & (r.drive != r.drive_sum)),
        ("voltage_clips", live & (r.v != r.v_sum)),
    )


# What can be held. Registers are those of a chip file.


class Domain(NamedTuple):
    """Whole numbers that a parameter may have: both ends are among them."""

    low: int
    high: int

    def holds(self, values: IntArray | int) -> BoolArray:
        """Mark the values that lie within."""
        array = np.asarray(values)
        return np.asarray((array >= self.low) & (array <= self.high))


DECAYS = Domain(0, DECAY_ONE)
KEEPS_ALL = DECAYS.low
FORGETS = DECAYS.high
"""The decay that keeps nothing."""
MANTISSAS = Domain(-256, 255)
"""Those of weights, in formats of any width."""
EXPONENTS = Domain(WEIGHT_EXPONENTS[0], WEIGHT_EXPONENTS[-1])


def domains(registers: "Registers") -> dict[str, Domain]:
    """Return the domain of every parameter of compartments, and of delays, by name."""
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
    """Return what vmin of a core can be: ``1 - 2^k``, and the register's own end."""
    return [1 - half_range(k) for k in range(registers.voltage_bits + 1)]


def held_minimum(vmin: IntArray, registers: "Registers") -> IntArray:
    """Return lower limits as cores hold them: ``1 - 2^k`` is defined up to k = 31, and ends with the register."""
    forms = [1 - half_range(k) for k in range(32)]
    within_register = np.maximum(vmin, -registers.voltage_max)
    return np.where(np.isin(vmin, forms), within_register, vmin)


def voltage_maxima(registers: "Registers") -> list[int]:
    """Return what vmax of a core can be: ``2^(9 + 2k) - 1``, and the register's own end."""
    forms = [half_range(bits) - 1 for bits in range(9, registers.voltage_bits, 2)]
    return [*forms, registers.voltage_max]


def charge_span(charge_bits: int) -> int:
    """Return a span of units: q, of so many bits, lies within -span..span - 1."""
    return half_range(charge_bits - WEIGHT_SHIFT)


def largest_charge(charge_bits: int) -> int:
    """Return the largest charge of a step, in units."""
    return charge_span(charge_bits) - 1


# What a program holds, as the step reads it. A unit is the least charge that a weight can be, and 1 of a threshold.


def acts_at(row: Value, delay: Value) -> Value:
    """Return the step at which a spike of a row acts."""
    return row + 1 + delay


def keep_of(decay: Value) -> Value:
    """Return what a step keeps of 4096 parts."""
    return DECAY_ONE - decay


def bias_of(mantissa: IntArray, exponent: IntArray) -> IntArray:
    """Return what a step adds to u on its way to v."""
    return mantissa << exponent


def in_registers(units: Value) -> Value:
    """Return so many units, fractions too, as registers hold them: times 64."""
    return units * UNIT


def in_units(value: Value) -> Value:
    """Return a register's value in units, with fractions."""
    return value / UNIT


def whole_units(charge: Value) -> Value:
    """Return whole units of a register's value, rounded down; charges are."""
    return charge >> WEIGHT_SHIFT


def threshold_of(mantissa: Value) -> Value:
    """Return what v must exceed; the mantissa may be a fraction while one is looked for."""
    return in_registers(mantissa)


charge_of = effective_weight
BITS_OF_UNITS = {"decay_bits": DECAY_BITS, "weight_shift": WEIGHT_SHIFT}
"""By the names of files for other tools: 2^bits parts that a decay counts, and 2^shift of a register in a unit."""
