"""The kernels over the lanes of a chunk in one step: :mod:`hw_model.arithmetic.loihi` over vectors.

A kernel is compiled into the loops that call it (:mod:`hw_model.engine.lanes`). Its decorator names what a loop calls
it with: for each place an array and the indices of its first element, then plain numbers; names only have to differ.

Registers ``c`` and charges are of one type, 32 or 64 bits: :func:`hw_model.engine.lay_out.fast_layout` knows which one
holds every sum. Charges are in units of the page, 64 of the registers each; ``widths`` are
:class:`hw_model.engine.layout.Widths`. Kernels return spikes as bits, how many lanes were busy, and as bits which of
them do not rest.
"""

from functools import reduce
from operator import or_

from hw_model.arithmetic import loihi
from hw_model.arithmetic.fixed_point import kept_by_parts
from hw_model.arithmetic.loihi import EVENTS, Parameters, Response, State, Step
from hw_model.engine.lanes import (
    Lanes,
    LlvmValue,
    LlvmValues,
    Place,
    WrapHalves,
    as_factor,
    bits,
    count,
    each_row,
    first_bits,
    halves_of_ranges,
    mask_of,
    put_lane_numbers,
    put_side_by_side,
    seldom,
    select,
    variable,
    where,
)
from hw_model.engine.layout import (
    BIAS,
    BLOCKED,
    CHARGE_WRAPS,
    CURRENT_WRAPS,
    FIELDS,
    JOINED,
    KEEP_U,
    KEEP_V,
    KEPT_FIELDS,
    POTENTIAL,
    REFRACTORY,
    THRESHOLD,
    VMAX,
    VMIN,
    VOLTAGE_CLIPS,
    U,
    V,
)
from hw_model.engine.private_numba import kernel

NO_JOINED = 0
"""What children pass to a compartment that has none."""
FIELD_OF_EVENT = dict(zip(EVENTS, (CHARGE_WRAPS, CURRENT_WRAPS, VOLTAGE_CLIPS), strict=True))


class OnLanes:
    """The operations of a step on vectors; without ``ends`` nothing can wrap."""

    def __init__(self, ends: WrapHalves = (None, None)) -> None:
        self._half_charge, self._half_current = ends

    def wrap_charge(self, q: Lanes) -> Lanes:
        """Return q within its register, in units."""
        return _wrap(q, self._half_charge)

    def wrap_current(self, u: Lanes) -> Lanes:
        """Return u, or u + bias, within the register of u."""
        return _wrap(u, self._half_current)

    def charged(self, q: Lanes) -> Lanes:
        """Return q in the unit of u."""
        charge: Lanes = loihi.in_registers(q)
        return charge

    def kept(self, x: Lanes, keep: Lanes) -> Lanes:
        """Return what is left of x; no product is wider than x, or than 24 bits."""
        left: Lanes = kept_by_parts(x, keep, first_bits, as_factor)
        return left

    def clip(self, v: Lanes, low: Lanes, high: Lanes) -> Lanes:
        """Return v within low..high."""
        v = where(v < low, low, v)
        return where(v > high, high, v)

    def select(self, condition: Lanes, chosen: Lanes | int, otherwise: Lanes | int) -> Lanes:
        """Return ``chosen`` where the condition holds, and ``otherwise`` where not."""
        return select(condition, chosen, otherwise)


PLAINLY = OnLanes()


def _wrap(x: Lanes, half: Lanes | int | None) -> Lanes:
    """Return x in two's complement: its low bits, of which the highest, worth half, counts as negative."""
    return x if half is None else ((x & (half * 2 - 1)) ^ half) - half


def _parameters(c: Place) -> Parameters:
    """Return the parameters of a chunk; what a kernel does not use, it does not read."""
    return Parameters(c[KEEP_U], c[KEEP_V], c[BIAS], c[THRESHOLD], c[REFRACTORY], c[VMIN], c[VMAX])


def _plain(p: Parameters) -> Parameters:
    """Return the parameters of a chunk that has no bias, as is known beforehand."""
    return p._replace(bias=0)


def _count(c: Place, *events: tuple[str, Lanes]) -> None:
    """Count which lanes met an event. Few do: to look for any takes less time than to count none."""
    with seldom(reduce(or_, (met for _, met in events))):
        for event, met in events:
            c[FIELD_OF_EVENT[event]] += met


def _finish(c: Place, step: Step) -> Lanes:
    """Write the registers after a step but u; return which lanes do not rest, apart from u and bias."""
    _, v, blocked = step.state
    c[V], c[BLOCKED] = v, blocked
    c[POTENTIAL] = step.potential
    not_at_rest: Lanes = v | blocked
    return not_at_rest


@kernel("registers, at, charge, row, slot, widths", returns=3)
def update(c: Place, charge: Place, widths: LlvmValue) -> LlvmValues:
    """Update a chunk. Its charges are taken and set to 0."""
    arrived = charge[0]
    joined = c[JOINED]
    p = _parameters(c)
    before = State(c[U], c[V], c[BLOCKED])
    charge[0] = 0
    c[JOINED] = 0
    busy = (arrived | before.u | before.v | p.bias | joined) != 0
    step = loihi.step(OnLanes(halves_of_ranges(c, widths)), p, before, arrived, joined)
    c[U] = step.state.u
    state = _finish(c, step)
    _count(c, *loihi.events(step.response, step.live))
    return bits(step.fired), count(busy), bits((step.state.u | state | p.bias) != 0)


def _respond_plainly(c: Place, charge: Place) -> tuple[Lanes, Response]:
    """Take charge into u and v, where nothing can wrap; return which lanes were busy, and what they did."""
    arrived = charge[0]
    u = c[U]
    v = c[V]
    charge[0] = 0
    busy = (arrived | u | v) != 0
    response = loihi.respond(PLAINLY, _plain(_parameters(c)), u, v, arrived, NO_JOINED)
    c[U] = response.u
    _count(c, ("voltage_clips", response.v != response.v_sum))
    return busy, response


@kernel("registers, at, charge, row, slot", returns=3)
def update_plain(c: Place, charge: Place) -> LlvmValues:
    """Do the same for a chunk without bias, refractory steps and children, in which nothing can wrap."""
    busy, response = _respond_plainly(c, charge)
    fired = response.v > c[THRESHOLD]
    v = loihi.reset(PLAINLY, response.v, fired)
    c[V], c[POTENTIAL] = v, response.v
    return bits(fired), count(busy), bits((response.u | v) != 0)


@kernel(
    "registers, at, same, other_at, also, soma_at, charge, row, slot, charges, other_row, other_slot",
    returns=7,
)
def update_pair(
    c: Place, other: Place, soma: Place, charge: Place, other_charge: Place
) -> LlvmValues:
    """Do the same for two plain chunks of dendrites, and a third that is only their sum and is never refractory.

    Return its spikes, how many lanes of each were busy, and which of each do not rest. Potentials are not kept.
    """
    busy, response = _respond_plainly(c, charge)
    other_busy, other_response = _respond_plainly(other, other_charge)
    c[V], other[V] = response.v, other_response.v
    total = response.v + other_response.v
    potential = PLAINLY.clip(total, soma[VMIN], soma[VMAX])
    fired = potential > soma[THRESHOLD]
    v = loihi.reset(PLAINLY, potential, fired)
    soma_busy = (soma[V] | total) != 0
    soma[V] = v
    _count(soma, ("voltage_clips", potential != total))
    rests = (
        bits((response.u | response.v) != 0),
        bits((other_response.u | other_response.v) != 0),
        bits(v != 0),
    )
    return bits(fired), count(busy), count(other_busy), count(soma_busy), *rests


@kernel("registers, at, charge, row, slot, widths", returns=1)
def advance(c: Place, charge: Place, widths: LlvmValue) -> LlvmValues:
    """Do what :func:`update` does, but count nothing and leave the charge.

    What no one will ask for need not be counted, in steps that are run only for their spikes.
    """
    joined = c[JOINED]
    p = _parameters(c)
    before = State(c[U], c[V], c[BLOCKED])
    c[JOINED] = 0
    ends = halves_of_ranges(c, widths)
    if ends[1] is None:
        p = _plain(p)
    step = loihi.step(OnLanes(ends), p, before, charge[0], joined)
    c[U] = step.state.u
    _finish(c, step)
    return (bits(step.fired),)


@kernel(
    "registers, at, before, step, member, after, next, same, charge, row, slot, e, f, g, echo, h, i, j, masks, k, l,"
    "flips, m, n, numbers, o, spikes, many, widths",
    returns=0,
)
def advance_pair(  # noqa: PLR0913 - registers and parameters of a step, by name
    c: Place, before: Place, after: Place, charge: Place, other_charge: Place, echo: Place, other_echo: Place,
    masks: Place, flips: Place, numbers: Place, spikes: LlvmValue, many: LlvmValue, widths: LlvmValue,
) -> None:  # fmt: skip
    """Do the same in so ``many`` rows for two dendrites, whose registers follow each other, and a third, their sum.

    This is how a spike response neuron is lowered: its alpha dendrite, its refractory dendrite, and its soma. Their
    states are read from one place and written to another; ``spikes`` are those of the row before, as bits, and
    ``echo`` is what a spike adds to the charges of the next row. Spikes are written as bits, and counted. Without
    ``widths``, an empty tuple, both dendrites are plain.
    """
    ends = halves_of_ranges(c, widths)
    second = KEPT_FIELDS  # where the state of the second dendrite begins, behind that of the first
    ops = OnLanes(ends)
    alpha, refractory, soma = (_parameters(c.after(n * FIELDS)) for n in range(3))
    if ends[1] is None:
        alpha = _plain(alpha)
        refractory = _plain(refractory)
    u, v, u_other, v_other = (variable(before[field]) for field in (0, 1, second, second + 1))
    fired = variable(mask_of(c, spikes))
    counted = variable(numbers[0])
    echoes = (echo[0], other_echo[0])
    # The sum is not kept, so it need not be clipped: where clipped ones never exceed the threshold, no sum exceeds
    # another. None is raised above it, for vmin is 0 at most and the threshold 0 at least.
    threshold = where(soma.vmax > soma.threshold, soma.threshold, alpha.vmax + refractory.vmax)
    for row in each_row(c, many):
        arrived, also = (where(fired[0], weights, weights & 0) for weights in echoes)
        response = loihi.respond(ops, alpha, u[0], v[0], charge.row(row)[0] + arrived, NO_JOINED)
        other_response = loihi.respond(
            ops, refractory, u_other[0], v_other[0], other_charge.row(row)[0] + also, NO_JOINED
        )
        u[0], v[0] = response.u, response.v
        u_other[0], v_other[0] = other_response.u, other_response.v
        state_after = after.row(row)
        fired_before = masks.row(row).bits()
        state_after[0] = u[0]
        state_after[1] = v[0]
        state_after[second] = u_other[0]
        state_after[second + 1] = v_other[0]
        fired[0] = v[0] + v_other[0] > threshold
        flips.row(row).put_bits(fired[0] != fired_before)
        masks.row(row).put_bits(fired[0])
        counted[0] = counted[0] + fired[0] - fired_before
    numbers[0] = counted[0]


@kernel("charge, row, slot, weights, at, times", returns=0)
def add_multiple(charge: Place, weights: Place, times: LlvmValue) -> None:
    """Add the weights of a spike to a chunk's charges, ``times`` times: -1 takes them back."""
    charge[0] += charge.each(times) * weights[0]


@kernel("charge, row, slot, weights, at", returns=0)
def add_weights(charge: Place, weights: Place) -> None:
    """Add the weights of a spike to a chunk's charges."""
    charge[0] += weights[0]


@kernel("charge, row, slot, echo, at, came, went", returns=0)
def change_echo(charge: Place, echo: Place, came: LlvmValue, went: LlvmValue) -> None:
    """Add what the spikes that came pass on, and take back what those that went have."""
    nothing = echo[0] & 0
    added = where(mask_of(charge, came), echo[0], nothing)
    charge[0] += added - where(mask_of(charge, went), echo[0], nothing)


@kernel("numbers, at, came, went", returns=0)
def count_changes(numbers: Place, came: LlvmValue, went: LlvmValue) -> None:
    """Count spikes that came, given as bits, and no longer those that went."""
    numbers[0] = numbers[0] + mask_of(numbers, came) - mask_of(numbers, went)


@kernel("numbers, at, number", returns=0)
def fill(numbers: Place, number: LlvmValue) -> None:
    """Put one number into all lanes."""
    numbers[0] = numbers.each(number)


@kernel("event, at, first, spikes", returns=1)
def list_lanes(event: Place, first: LlvmValue, spikes: LlvmValue) -> LlvmValues:
    """List a chunk's spikes, given as bits, counted from ``first``; return how many there are."""
    return (put_lane_numbers(event, mask_of(event, spikes), first),)


@kernel("event, at, rows, same, row, first, flips, spikes", returns=1)
def list_flips(
    event: Place, rows: Place, row: LlvmValue, first: LlvmValue, flips: LlvmValue, spikes: LlvmValue
) -> LlvmValues:
    """List with their row the spikes that came or went; those that went, not among ``spikes``, as ``~number``."""
    numbers, rows[0] = event.each(first) + event.numbers(), rows.each(row)
    return (
        put_side_by_side(
            event, mask_of(event, flips), where(mask_of(event, spikes), numbers, numbers ^ -1)
        ),
    )


@kernel("spikes, row, column, fired", returns=0)
def note(spikes: Place, fired: LlvmValue) -> None:
    """Write a chunk's spikes, given as bits, as 0 and 1."""
    spikes[0] |= mask_of(spikes, fired)


@kernel("to, given, one, two, three", returns=0)
def copy_state(to: Place, given: Place) -> None:
    """Copy the state of a chunk: u, v, potential and blocked, which lie side by side."""
    for field in range(KEPT_FIELDS):
        to[field] = given[field]


@kernel("registers, child, same, parent", returns=0)
def pass_on(child: Place, parent: Place) -> None:
    """Add the voltages of a chunk to its parent's."""
    parent[JOINED] += child[V]
