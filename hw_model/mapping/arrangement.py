"""Choose where on the board each core sits, so that spikes travel few hops.

Before: a PlacedGraph whose cores sit in network order.
After:  the same cores and slices in other slots; the expected hops a step are no more than before.

The traffic between two cores is the expected spikes of all compartments of the one that reach the other. Where to put
cores so that traffic times distance is least is the quadratic assignment problem. Starts are network order, the
spectral order of the traffic graph laid along the tiles in a snake, and on one chip a few shuffles. Each is improved by
exchanging the pair of slots, one of them perhaps empty, that saves most, until none saves any; the best end is taken.
"""

import math
from dataclasses import replace

import numpy as np

from hw_model.description.chip import Chip
from hw_model.mapping.circles import sources_first
from hw_model.mapping.placement import PlacedGraph
from hw_model.values import ArrayLike, FloatArray, IntArray

MIN_CORES = 3
"""Of fewer cores no order is better than another."""
MAX_SLOTS = 1024
"""Boards that need more slots than this keep network order: the search takes time with their cube."""
SHUFFLES = 4
"""Shuffled starts that are tried too, from a fixed seed."""
MAX_SHUFFLED = 128
"""Most slots of a board on which shuffled starts are tried."""
_NO_GAIN = 1e-9
"""Hops that an exchange must save: less is rounding."""


def arrange_cores(placed: PlacedGraph, expected_spikes: FloatArray | None = None) -> PlacedGraph:
    """Return the graph with slots that lower the expected hops.

    ``expected_spikes``: spikes a step of every source, numbered as :func:`hw_model.mapping.fan_in.first_source` does;
    by default all compartments are taken to spike alike.
    """
    chip = placed.chip
    chips = math.ceil(placed.cores / chip.limits.cores_per_chip)
    slots = chips * chip.limits.cores_per_chip
    if placed.cores < MIN_CORES or slots > MAX_SLOTS:
        return placed
    distance = slot_distances(chip, slots)
    traffic = core_traffic(placed, expected_spikes)
    starts = [np.array(placed.slots), _spectral_start(traffic, chip, slots)]
    if slots <= MAX_SHUFFLED:
        random = np.random.default_rng(0)
        starts += [random.permutation(slots)[: placed.cores] for _ in range(SHUFFLES)]
    ends = [_exchange_slots(traffic, distance, start) for start in starts]
    best = min(ends, key=lambda end: total_hops(traffic, distance, end))
    return replace(placed, slots=tuple(map(int, best)))


def core_traffic(placed: PlacedGraph, expected_spikes: FloatArray | None = None) -> FloatArray:
    """Return expected packets a step between cores, (cores, cores), both ways added up; 0 from a core to itself."""
    core_of = placed.core_of_source()
    spikes = np.ones(len(core_of)) if expected_spikes is None else expected_spikes
    sent = np.zeros((placed.cores, placed.cores))
    for target, axons in enumerate(placed.axons):
        senders = axons[core_of[axons] >= 0]
        sent[:, target] = np.bincount(core_of[senders], spikes[senders], minlength=placed.cores)
    np.fill_diagonal(sent, 0.0)
    return sent + sent.T


def slot_distances(chip: Chip, slots: int) -> FloatArray:
    """Return hops between the first slots of the board, (slots, slots)."""
    tiles = np.array([chip.tile_of(slot) for slot in range(slots)], dtype=np.float64)
    return np.asarray(np.abs(tiles[:, None] - tiles[None]).sum(axis=2))


def total_hops(traffic: FloatArray, distance: FloatArray, slots: ArrayLike) -> float:
    """Return the expected hops a step: traffic times distance, every pair of cores once."""
    slot_of = np.asarray(slots)
    return float((traffic * distance[np.ix_(slot_of, slot_of)]).sum() / 2)


def _spectral_start(traffic: FloatArray, chip: Chip, slots: int) -> IntArray:
    """Lay cores along a snake through the tiles, part by connected part, in the order of the part's Fiedler vector."""
    parts = sources_first(len(traffic), np.argwhere(traffic))
    order = np.concatenate([_spectral_order(traffic, np.array(part)) for part in parts])
    start = np.empty(len(order), dtype=np.int64)
    start[order] = _snake(chip, slots)[: len(order)]
    return start


def _snake(chip: Chip, slots: int) -> list[int]:
    """Return slots column by column of tiles, down one and up the next."""

    def place(slot: int) -> tuple[int, int, int]:
        column, row = chip.tile_of(slot)
        goes_up = column % 2 == 1
        row_of_snake = -row if goes_up else row
        return column, row_of_snake, slot

    return sorted(range(slots), key=place)


def _spectral_order(traffic: FloatArray, part: IntArray) -> IntArray:
    """Return the cores of a connected part in the order of its Fiedler vector, which keeps neighbours close."""
    if len(part) < MIN_CORES:
        return part
    within = traffic[np.ix_(part, part)]
    laplacian = np.diag(within.sum(axis=1)) - within
    fiedler = np.linalg.eigh(laplacian).eigenvectors[:, 1]
    # Its sign is arbitrary: the first core goes first.
    from_first = fiedler if fiedler[0] <= 0 else -fiedler
    # Rounding keeps the order from hanging on the last bits.
    return part[np.argsort(np.round(from_first, 9), kind="stable")]


def _exchange_slots(traffic: FloatArray, distance: FloatArray, start: IntArray) -> IntArray:
    """Exchange the best pair of slots until none saves hops; return the slot of each core.

    Empty slots take part as cores without traffic, numbered after the others.
    """
    cores = len(start)
    slots = len(distance)
    empty = np.setdiff1d(np.arange(slots), start)
    slot_of = np.concatenate((start, empty))
    flow = np.zeros((slots, slots))
    flow[:cores, :cores] = traffic
    # hops[i, s]: those of core i's traffic were it in slot s, all others staying.
    hops = flow @ distance[slot_of]
    while True:
        change = _change_of_hops(hops, flow, distance, slot_of)
        # Two empty slots need not be exchanged.
        i, j = np.unravel_index(int(change[:cores].argmin()), (cores, slots))
        if change[i, j] >= -_NO_GAIN:
            return slot_of[:cores]
        # All traffic with core i now ends at the slot of j, and the other way round.
        further = distance[slot_of[j]] - distance[slot_of[i]]
        hops += flow[:, [i]] * further - flow[:, [j]] * further
        slot_of[[i, j]] = slot_of[[j, i]]


def _change_of_hops(
    hops: FloatArray, flow: FloatArray, distance: FloatArray, slot_of: IntArray
) -> FloatArray:
    """Return by how much the hops change if cores i and j exchange slots, (cores, cores)."""
    # Of core i in the slot of core j.
    moved = hops[:, slot_of]
    stayed = np.diag(moved)
    # Traffic between the two that are exchanged is counted as if the other had stayed.
    between = 2 * flow * distance[np.ix_(slot_of, slot_of)]
    return np.asarray(moved + moved.T - stayed[:, None] - stayed[None] + between)
