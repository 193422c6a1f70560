"""The kernels of the fast engine: the step of :mod:`hw_model.arithmetic.loihi` on a chunk of 16 compartments at once.

A *kernel* is a Python function that runs once, when a loop is compiled: its operations on :class:`Lanes` become vector
instructions inside the loop (:mod:`hw_model.engine.lanes`). The decorator lists the parameters with which a loop calls
it. Each ``Place`` of the Python function takes an array and the indices of its first element there, all else a plain
number: ``update(registers, at, charge, row, slot, widths)`` in a loop runs ``update(c, charge, widths)`` below. The
names in the list do not matter, but numba wants them to differ.

Registers ``c`` and charges are of one type, 32 or 64 bits: :func:`hw_model.engine.lay_out.fast_layout` chooses the one
that holds every sum. Charges are in units of 64. ``widths`` are :class:`hw_model.engine.layout.Widths`. Where nothing
else is said, a kernel returns the spikes as bits, how many lanes were busy (had anything to work on), and as bits which
lanes are not at rest (would change without charges).
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
"""What a compartment without children gets from them."""
FIELD_OF_EVENT = dict(zip(EVENTS, (CHARGE_WRAPS, CURRENT_WRAPS, VOLTAGE_CLIPS), strict=True))


class OnLanes:
    """The operations of :mod:`hw_model.arithmetic.loihi` on vectors.

    ``ends`` are half the ranges of q and u, at which they wrap; without them nothing wraps.
    """

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
        """Return x keep / 4096, truncated; no product is wider than x, or than 24 bits."""
        left: Lanes = kept_by_parts(x, keep, first_bits, as_factor)
        return left

    def clip(self, v: Lanes, low: Lanes, high: Lanes) -> Lanes:
        """Return v within low..high."""
        v = where(v < low, low, v)
        return where(v > high, high, v)

    def select(self, condition: Lanes, chosen: Lanes | int, otherwise: Lanes | int) -> Lanes:
        """Return ``chosen`` where the condition holds, else ``otherwise``."""
        return select(condition, chosen, otherwise)


PLAINLY = OnLanes()
"""The operations where nothing can wrap."""


def _wrap(x: Lanes, half: Lanes | int | None) -> Lanes:
    """Return x wrapped to ``-half..half - 1``: its low bits in two's complement."""
    if half is None:
        return x
    low_bits = x & (half * 2 - 1)
    # This extends the sign: the highest of the low bits, worth half, counts as -half.
    return (low_bits ^ half) - half


def _parameters(c: Place) -> Parameters:
    """Return the parameters of a chunk. The compiler removes the loads of those that a kernel does not use."""
    return Parameters(
        keep_u=c[KEEP_U],
        keep_v=c[KEEP_V],
        bias=c[BIAS],
        threshold=c[THRESHOLD],
        refractory=c[REFRACTORY],
        vmin=c[VMIN],
        vmax=c[VMAX],
    )


def _plain(p: Parameters) -> Parameters:
    """Return the parameters of a chunk without bias, with a constant 0 in its place, which costs nothing to add."""
    return p._replace(bias=0)


def _count(c: Place, *events: tuple[str, Lanes]) -> None:
    """Count the lanes that met each event. Events are rare, so testing for any is faster than counting zeros."""
    with seldom(reduce(or_, (met for _, met in events))):
        for event, met in events:
            c[FIELD_OF_EVENT[event]] += met


def _finish(c: Place, step: Step) -> Lanes:
    """Write all registers after a step except u; return the lanes whose v or refractory count is not 0."""
    _, v, blocked = step.state
    c[V] = v
    c[BLOCKED] = blocked
    c[POTENTIAL] = step.potential
    not_at_rest: Lanes = v | blocked
    return not_at_rest


@kernel("registers, at, charge, row, slot, widths", returns=3)
def update(c: Place, charge: Place, widths: LlvmValue) -> LlvmValues:
    """Update a chunk in one row. Its charges are read and set to 0, and so is what its children passed."""
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
    """Read the charge and update u, where nothing can wrap; return which lanes were busy, and the response."""
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
    """Do what :func:`update` does for a plain chunk: no bias, refractory steps or children, and nothing can wrap."""
    busy, response = _respond_plainly(c, charge)
    fired = response.v > c[THRESHOLD]
    v = loihi.reset(PLAINLY, response.v, fired)
    c[V] = v
    c[POTENTIAL] = response.v
    return bits(fired), count(busy), bits((response.u | v) != 0)


@kernel(
    "registers, at, same, other_at, also, soma_at, charge, row, slot, charges, other_row, other_slot",
    returns=7,
)
def update_pair(
    c: Place, other: Place, soma: Place, charge: Place, other_charge: Place
) -> LlvmValues:
    """Update two plain chunks of dendrites, and a third chunk, the soma, that is only their sum and never refractory.

    Return the spikes of the soma; how many lanes of each chunk were busy; and which lanes of each are not at rest.
    Potentials are not written.
    """
    busy, response = _respond_plainly(c, charge)
    other_busy, other_response = _respond_plainly(other, other_charge)
    c[V] = response.v
    other[V] = other_response.v
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
    """Do what :func:`update` does, but count nothing and leave the charge as it is; return the spikes only.

    For steps that a session replays only for their spikes.
    """
    joined = c[JOINED]
    p = _parameters(c)
    before = State(c[U], c[V], c[BLOCKED])
    c[JOINED] = 0
    ends = halves_of_ranges(c, widths)
    if ends[1] is None:  # where nothing can wrap there is no bias either: the chunk is plain
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
    """Do what :func:`advance` does, in ``many`` rows, for two dendrites and their soma, which is only their sum.

    This is how a spike response neuron is lowered: its alpha dendrite, its refractory dendrite, and its soma. The
    registers of the three chunks ``c`` follow each other.

    - ``before``, ``after``: where the state is read, and where it is written in each row
    - ``spikes``: the spikes of the row before the first, as bits
    - ``echo``, ``other_echo``: what a spike adds to the charges of each dendrite in the next row
    - ``masks``: the spikes of each row as bits, those of an earlier play at first; overwritten
    - ``flips``: which spikes of each row differ from the earlier play
    - ``numbers``: the number of spikes of each lane over all rows, kept up to date
    - ``widths``: an empty tuple if both dendrites are plain
    """
    ends = halves_of_ranges(c, widths)
    second = KEPT_FIELDS  # the state of the second dendrite lies behind that of the first
    ops = OnLanes(ends)
    alpha = _parameters(c)
    refractory = _parameters(c.after(FIELDS))
    soma = _parameters(c.after(2 * FIELDS))
    if ends[1] is None:
        alpha = _plain(alpha)
        refractory = _plain(refractory)
    # A state begins with u and v.
    u = variable(before[0])
    v = variable(before[1])
    u_other = variable(before[second])
    v_other = variable(before[second + 1])
    fired = variable(mask_of(c, spikes))
    counted = variable(numbers[0])
    echoes = (echo[0], other_echo[0])
    # The soma's v is not written, so it need not be clipped, if spikes stay the same. Clipping to vmax prevents spikes
    # only if the threshold is vmax or more: then compare with a number that no sum exceeds. Clipping to vmin causes
    # none, as vmin is 0 at most and the threshold 0 at least.
    threshold = where(soma.vmax > soma.threshold, soma.threshold, alpha.vmax + refractory.vmax)
    for row in each_row(c, many):
        echoed, other_echoed = (where(fired[0], weights, weights & 0) for weights in echoes)
        response = loihi.respond(ops, alpha, u[0], v[0], charge.row(row)[0] + echoed, NO_JOINED)
        other_arrived = other_charge.row(row)[0] + other_echoed
        other_response = loihi.respond(
            ops, refractory, u_other[0], v_other[0], other_arrived, NO_JOINED
        )
        u[0] = response.u
        v[0] = response.v
        u_other[0] = other_response.u
        v_other[0] = other_response.v
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
    """Add the weights of a spike to a chunk's charges, ``times`` times; -1 removes an earlier spike."""
    charge[0] += charge.each(times) * weights[0]


@kernel("charge, row, slot, weights, at", returns=0)
def add_weights(charge: Place, weights: Place) -> None:
    """Add the weights of a spike to a chunk's charges."""
    charge[0] += weights[0]


@kernel("charge, row, slot, echo, at, came, went", returns=0)
def change_echo(charge: Place, echo: Place, came: LlvmValue, went: LlvmValue) -> None:
    """Add the echo of spikes that are new, given as bits, and subtract that of spikes that are gone."""
    nothing = echo[0] & 0
    added = where(mask_of(charge, came), echo[0], nothing)
    charge[0] += added - where(mask_of(charge, went), echo[0], nothing)


@kernel("numbers, at, came, went", returns=0)
def count_changes(numbers: Place, came: LlvmValue, went: LlvmValue) -> None:
    """Add spikes that are new, given as bits, to each lane's count, and subtract spikes that are gone."""
    numbers[0] = numbers[0] + mask_of(numbers, came) - mask_of(numbers, went)


@kernel("numbers, at, number", returns=0)
def fill(numbers: Place, number: LlvmValue) -> None:
    """Write one number to all lanes."""
    numbers[0] = numbers.each(number)


@kernel("event, at, first, spikes", returns=1)
def list_lanes(event: Place, first: LlvmValue, spikes: LlvmValue) -> LlvmValues:
    """List a chunk's spikes, given as bits, as lane numbers plus ``first``; return how many there are."""
    return (put_lane_numbers(event, mask_of(event, spikes), first),)


@kernel("event, at, rows, same, row, first, flips, spikes", returns=1)
def list_flips(
    event: Place, rows: Place, row: LlvmValue, first: LlvmValue, flips: LlvmValue, spikes: LlvmValue
) -> LlvmValues:
    """List the spikes that are new or gone, the bits ``flips``, with their row; return how many there are.

    A new spike, a bit of ``spikes`` too, is listed as its number, and one that is gone as ``~number``.
    """
    numbers = event.each(first) + event.numbers()
    rows[0] = rows.each(row)
    # `x ^ -1` is ~x.
    listed = where(mask_of(event, spikes), numbers, numbers ^ -1)
    return (put_side_by_side(event, mask_of(event, flips), listed),)


@kernel("spikes, row, column, fired", returns=0)
def note(spikes: Place, fired: LlvmValue) -> None:
    """Write a chunk's spikes, given as bits, as 0 and 1; entries that are 1 stay 1."""
    spikes[0] |= mask_of(spikes, fired)


@kernel("to, given, one, two, three", returns=0)
def copy_state(to: Place, given: Place) -> None:
    """Copy the state of a chunk, u, v, potential and blocked, whose fields lie side by side."""
    for field in range(KEPT_FIELDS):
        to[field] = given[field]


@kernel("registers, child, same, parent", returns=0)
def pass_on(child: Place, parent: Place) -> None:
    """Add the voltages of a chunk to what its parent gets from its children in this row."""
    parent[JOINED] += child[V]
