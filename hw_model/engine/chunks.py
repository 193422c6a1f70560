"""The kernels over the lanes of a chunk in one step: how a compartment is updated.

Registers ``c`` and charges are of one type, 32 or 64 bits: :func:`hw_model.engine.lay_out.fast_layout` knows which one
holds every sum. Charges are in units of 64, the least that a weight can be; ``widths`` are
:class:`hw_model.engine.layout.Widths`. Kernels return spikes as bits, how many lanes were busy, and as bits which
of them do not rest.
"""

from collections.abc import Mapping
from functools import reduce
from operator import or_

from hw_model.arithmetic.fixed_point import WEIGHT_SHIFT
from hw_model.engine.lanes import (
    Ends,
    Given,
    Lanes,
    Place,
    Returned,
    before,
    bits,
    count,
    each_row,
    halves,
    held,
    kernel,
    mask_of,
    put,
    put_numbers,
    seldom,
    short,
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

Fields = Place | Mapping[int, Lanes]
"""Registers of a chunk: where they lie, or what was read of them before a loop."""


def _rz(x: Lanes, keep: Lanes) -> Lanes:
    """Return sign(x) * ((|x| * keep) >> 12): with x = 4096 a + b no product is wider than x, or than 24 bits.

    Shifts round down; 4095 more, all bits that stand before a negative a, makes that towards 0.
    """
    high, keep = x >> 12, keep & (2 * 4096 - 1)
    return short(high) * keep + (((x & 4095) * keep + before(high, 12)) >> 12)


def _wrap(x: Lanes, half: Lanes | int | None) -> Lanes:
    """Return x in two's complement: its low bits, of which the highest, worth half, counts as negative."""
    return x if half is None else ((x & (half * 2 - 1)) ^ half) - half


def _take_charge(c: Fields, u: Lanes, charge: Lanes, ends: Ends) -> tuple[Lanes, Lanes, Lanes]:
    """Decay u and take the charge of a step into it; return q, and u before and after it wraps."""
    half_charge, half_current = ends
    q = _wrap(charge, half_charge)
    unwrapped = _rz(u, c[KEEP_U]) + (q << WEIGHT_SHIFT)
    return q, unwrapped, _wrap(unwrapped, half_current)


def _take_current(
    c: Fields, v: Lanes, u: Lanes, added: Lanes | int, ends: Ends
) -> tuple[Lanes, Lanes, Lanes]:
    """Decay v and take u, bias and what children add into it; return the drive, that wrapped, and v before clipping."""
    drive = u if ends[1] is None else u + c[BIAS]  # a chunk that is plain has no bias
    wrapped = _wrap(drive, ends[1])
    return drive, wrapped, _rz(v, c[KEEP_V]) + wrapped + added


def _clip(c: Fields, v: Lanes) -> Lanes:
    v = where(v < c[VMIN], c[VMIN], v)
    return where(v > c[VMAX], c[VMAX], v)


def _fire(c: Place, v: Lanes) -> tuple[Lanes, Lanes, Lanes, Lanes]:
    """Compare v with the threshold, unless blocked; set v and blocked.

    Return whether it spikes, whether it was not blocked, v as the threshold saw it, and both registers ored.
    """
    blocked = c[BLOCKED]
    live = blocked == 0
    seen = where(blocked != 0, 0, v)
    fired = live & (v > c[THRESHOLD])
    left = where(fired, 0, seen)
    blocked = where(fired, c[REFRACTORY] - 1, where(live, 0, blocked - 1))
    c[V], c[BLOCKED] = left, blocked
    return fired, live, seen, left | blocked


def _count(c: Place, *events: tuple[int, Lanes]) -> None:
    """Count which lanes met an event. Few do: to look for any takes less time than to count none."""
    with seldom(reduce(or_, (met for _, met in events))):
        for field, met in events:
            c[field] += met


@kernel("registers, at, charge, row, slot, widths", returns=3)
def update(c: Place, charge: Place, widths: Given) -> Returned:
    """Update a chunk. Its charges are taken and set to 0."""
    ends = halves(c, widths)
    arrived, added, bias = charge[0], c[JOINED], c[BIAS]
    charge[0] = 0
    c[JOINED] = 0
    busy = (arrived | c[U] | c[V] | bias | added) != 0
    q, unwrapped, u = _take_charge(c, c[U], arrived, ends)
    drive, wrapped, unclipped = _take_current(c, c[V], u, added, ends)
    clipped = _clip(c, unclipped)
    fired, live, seen, state = _fire(c, clipped)
    c[U], c[POTENTIAL] = u, seen
    wraps = (
        (CHARGE_WRAPS, q != arrived),
        (CURRENT_WRAPS, u != unwrapped),
        (CURRENT_WRAPS, live & (wrapped != drive)),
    )
    _count(c, *wraps, (VOLTAGE_CLIPS, live & (clipped != unclipped)))
    return bits(fired), count(busy), bits((u | state | bias) != 0)


def _respond_plainly(c: Place, charge: Place) -> tuple[Lanes, Lanes, Lanes]:
    """Take charge into u and v, where nothing can wrap; return which lanes were busy, u, and v before any threshold."""
    arrived, u, v = charge[0], c[U], c[V]
    charge[0] = 0
    busy = (arrived | u | v) != 0
    u = _rz(u, c[KEEP_U]) + (arrived << WEIGHT_SHIFT)
    unclipped = _rz(v, c[KEEP_V]) + u
    clipped = _clip(c, unclipped)
    c[U] = u
    _count(c, (VOLTAGE_CLIPS, clipped != unclipped))
    return busy, u, clipped


@kernel("registers, at, charge, row, slot", returns=3)
def update_plain(c: Place, charge: Place) -> Returned:
    """Do the same for a chunk without bias, refractory steps and children, in which nothing can wrap."""
    busy, u, v = _respond_plainly(c, charge)
    fired = v > c[THRESHOLD]
    left = where(fired, 0, v)
    c[V], c[POTENTIAL] = left, v
    return bits(fired), count(busy), bits((u | left) != 0)


@kernel(
    "registers, at, same, other_at, also, soma_at, charge, row, slot, charges, other_row, other_slot",
    returns=7,
)
def update_pair(
    c: Place, other: Place, soma: Place, charge: Place, other_charge: Place
) -> Returned:
    """Do the same for two plain chunks of dendrites, and a third that is only their sum and is never refractory.

    Return its spikes, how many lanes of each were busy, and which of each do not rest. Potentials are not kept.
    """
    busy, u, v = _respond_plainly(c, charge)
    other_busy, other_u, other_v = _respond_plainly(other, other_charge)
    c[V], other[V] = v, other_v
    total = v + other_v
    clipped = _clip(soma, total)
    fired = clipped > soma[THRESHOLD]
    left = where(fired, 0, clipped)
    soma_busy = (soma[V] | total) != 0
    soma[V] = left
    _count(soma, (VOLTAGE_CLIPS, clipped != total))
    rests = bits((u | v) != 0), bits((other_u | other_v) != 0), bits(left != 0)
    return bits(fired), count(busy), count(other_busy), count(soma_busy), *rests


@kernel("registers, at", returns=3)
def add_up(c: Place) -> Returned:
    """Do the same for a chunk that keeps nothing, and that no synapse reaches: its v is what its children add."""
    unclipped = c[JOINED]
    c[JOINED] = 0
    busy = (c[V] | unclipped) != 0
    clipped = _clip(c, unclipped)
    fired, live, seen, state = _fire(c, clipped)
    c[POTENTIAL] = seen
    _count(c, (VOLTAGE_CLIPS, live & (clipped != unclipped)))
    return bits(fired), count(busy), bits(state != 0)


def _respond(
    c: Fields, u: Lanes, v: Lanes, charge: Lanes, ends: Ends, added: Lanes | int = 0
) -> tuple[Lanes, Lanes]:
    """Take charge and what children add into u and v, and count nothing; return u, and v before any threshold."""
    _, _, u = _take_charge(c, u, charge, ends)
    _, _, v = _take_current(c, v, u, added, ends)
    return u, _clip(c, v)


@kernel("registers, at, charge, row, slot, widths", returns=1)
def advance(c: Place, charge: Place, widths: Given) -> Returned:
    """Do what :func:`update` does, but count nothing and leave the charge.

    What no one will ask for need not be counted, in steps that are run only for their spikes.
    """
    added = c[JOINED]
    c[JOINED] = 0
    u, v = _respond(c, c[U], c[V], charge[0], halves(c, widths), added)
    fired, _, seen, _ = _fire(c, v)
    c[U], c[POTENTIAL] = u, seen
    return (bits(fired),)


@kernel(
    "registers, at, before, step, member, after, next, same, charge, row, slot, e, f, g, echo, h, i, j, masks, k, l,"
    "flips, m, n, numbers, o, spikes, many, widths",
    returns=0,
)
def advance_pair(
    c: Place, before: Place, after: Place, charge: Place, other_charge: Place, echo: Place, other_echo: Place,
    masks: Place, flips: Place, numbers: Place, spikes: Given, many: Given, widths: Given,
) -> None:  # fmt: skip
    """Do the same in so ``many`` rows for two dendrites, whose registers follow each other, and a third, their sum.

    This is how a spike response neuron is lowered: its alpha dendrite, its refractory dendrite, and its soma. Their
    states are read from one place and written to another; ``spikes`` are those of the row before, as bits, and
    ``echo`` is what a spike adds to the charges of the next row. Spikes are written as bits, and counted. Without
    ``widths``, an empty tuple, both dendrites are plain.
    """
    ends, second, parameters = (
        halves(c, widths),
        KEPT_FIELDS,
        (KEEP_U, KEEP_V, BIAS, VMIN, VMAX, THRESHOLD),
    )
    one, other, soma = (
        {field: c.after(n * FIELDS)[field] for field in parameters} for n in range(3)
    )
    u, v, u_other, v_other = (held(before[field]) for field in (0, 1, second, second + 1))
    fired, counted, echoes = held(mask_of(c, spikes)), held(numbers[0]), (echo[0], other_echo[0])
    # The sum is not kept, so it need not be clipped: where clipped ones never exceed the threshold, no sum exceeds
    # another. None is raised above it, for vmin is 0 at most and the threshold 0 at least.
    threshold = where(soma[VMAX] > soma[THRESHOLD], soma[THRESHOLD], one[VMAX] + other[VMAX])
    for row in each_row(c, many):
        arrived, also = (where(fired[0], weights, weights & 0) for weights in echoes)
        u[0], v[0] = _respond(one, u[0], v[0], charge.row(row)[0] + arrived, ends)
        u_other[0], v_other[0] = _respond(
            other, u_other[0], v_other[0], other_charge.row(row)[0] + also, ends
        )
        to, was = after.row(row), masks.row(row).bits()
        to[0], to[1], to[second], to[second + 1] = u[0], v[0], u_other[0], v_other[0]
        fired[0] = v[0] + v_other[0] > threshold
        flips.row(row).put_bits(fired[0] != was)
        masks.row(row).put_bits(fired[0])
        counted[0] = counted[0] + fired[0] - was
    numbers[0] = counted[0]


@kernel("charge, row, slot, weights, at, times", returns=0)
def add_multiple(charge: Place, weights: Place, times: Given) -> None:
    """Add the weights of a spike to a chunk's charges, ``times`` times: -1 takes them back."""
    charge[0] += charge.each(times) * weights[0]


@kernel("charge, row, slot, weights, at", returns=0)
def add_weights(charge: Place, weights: Place) -> None:
    """Add the weights of a spike to a chunk's charges."""
    charge[0] += weights[0]


@kernel("charge, row, slot, echo, at, came, went", returns=0)
def change_echo(charge: Place, echo: Place, came: Given, went: Given) -> None:
    """Add what the spikes that came pass on, and take back what those that went have."""
    nothing = echo[0] & 0
    added = where(mask_of(charge, came), echo[0], nothing)
    charge[0] += added - where(mask_of(charge, went), echo[0], nothing)


@kernel("numbers, at, came, went", returns=0)
def count_changes(numbers: Place, came: Given, went: Given) -> None:
    """Count spikes that came, given as bits, and no longer those that went."""
    numbers[0] = numbers[0] + mask_of(numbers, came) - mask_of(numbers, went)


@kernel("numbers, at, number", returns=0)
def fill(numbers: Place, number: Given) -> None:
    """Put one number into all lanes."""
    numbers[0] = numbers.each(number)


@kernel("event, at, first, spikes", returns=1)
def list_lanes(event: Place, first: Given, spikes: Given) -> Returned:
    """List a chunk's spikes, given as bits, counted from ``first``; return how many there are."""
    return (put_numbers(event, mask_of(event, spikes), first),)


@kernel("event, at, rows, same, row, first, flips, spikes", returns=1)
def list_flips(
    event: Place, rows: Place, row: Given, first: Given, flips: Given, spikes: Given
) -> Returned:
    """List with their row the spikes that came or went; those that went, not among ``spikes``, as ``~number``."""
    numbers, rows[0] = event.each(first) + event.numbers(), rows.each(row)
    return (
        put(event, mask_of(event, flips), where(mask_of(event, spikes), numbers, numbers ^ -1)),
    )


@kernel("spikes, row, column, fired", returns=0)
def note(spikes: Place, fired: Given) -> None:
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
