"""Choose where on the board each core sits, so that spikes travel few hops.

Before: a PlacedGraph whose cores sit in network order.
After:  the same cores and slices in other slots; the expected hops per step are no more than before.

A *slot* is a position on the board that holds one core; some slots stay empty. A *hop* is one link between
neighbouring tiles of the chip's mesh. The *traffic* between two cores is the number of spikes per step that they are
expected to send each other.

To put cores where traffic times distance is least is the quadratic assignment problem, which is NP-hard. So this is a
local search from several starts: network order, the spectral order of the traffic graph, and on small boards a few
random orders. From each start, the exchange of two slots that saves the most hops is repeated until no exchange saves
any. The best result is taken. Network order is a start, so the result is never worse than no arrangement.
"""

import math
from dataclasses import replace

import numpy as np

from hw_model.description.chip import Chip
from hw_model.mapping.circles import sources_first
from hw_model.mapping.placement import PlacedGraph
from hw_model.values import ArrayLike, FloatArray, IntArray

MIN_CORES = 3
"""The fewest cores that are arranged. Two cores send all their traffic to each other, whichever comes first."""
MAX_SLOTS = 1024
"""Boards that need more slots keep network order: the search takes time with the cube of the slots.

462 cores take 4 seconds (docs/research/benchmarks/placing.md).
"""
SHUFFLES = 4
"""Random starts that are tried, from a fixed seed. Chosen by hand."""
MAX_SHUFFLED = 128
"""The most slots for which random starts are tried, so that they add little time. Chosen by hand."""
_NO_GAIN = 1e-9
"""An exchange must save more hops than this; without it, rounding could exchange the same pair for ever."""


def arrange_cores(placed: PlacedGraph, expected_spikes: FloatArray | None = None) -> PlacedGraph:
    """Return the graph with slots that lower the expected hops.

    ``expected_spikes``: spikes per step of every source, numbered as :func:`hw_model.mapping.fan_in.first_source`
    does; by default every compartment counts as one spike per step.
    """
    chip = placed.chip
    # Only the chips that the cores need take part; the others of the board stay empty.
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
    improved = [_exchange_slots(traffic, distance, start) for start in starts]
    best = min(improved, key=lambda slots_of_cores: total_hops(traffic, distance, slots_of_cores))
    return replace(placed, slots=tuple(map(int, best)))


def core_traffic(placed: PlacedGraph, expected_spikes: FloatArray | None = None) -> FloatArray:
    """Return the expected packets per step between cores, (cores, cores): both directions added, the diagonal 0.

    A packet goes from a spiking compartment to each core that it reaches, however many synapses it has there.
    """
    core_of = placed.core_of_source()
    spikes = np.ones(len(core_of)) if expected_spikes is None else expected_spikes
    sent = np.zeros((placed.cores, placed.cores))
    for target, axons in enumerate(placed.axons):
        # Input lines have core -1: their spikes come from outside, so they pull a core nowhere.
        senders = axons[core_of[axons] >= 0]
        sent[:, target] = np.bincount(core_of[senders], spikes[senders], minlength=placed.cores)
    # Spikes within a core cross no link.
    np.fill_diagonal(sent, 0.0)
    return sent + sent.T


def slot_distances(chip: Chip, slots: int) -> FloatArray:
    """Return the hops between each two of the first ``slots`` slots, (slots, slots): Manhattan distance of tiles."""
    tiles = np.array([chip.tile_of(slot) for slot in range(slots)], dtype=np.float64)
    return np.asarray(np.abs(tiles[:, None] - tiles[None]).sum(axis=2))


def total_hops(traffic: FloatArray, distance: FloatArray, slots: ArrayLike) -> float:
    """Return the expected hops per step: traffic times distance, summed over pairs of cores."""
    slot_of = np.asarray(slots)
    # The matrices hold every pair twice, so the sum is halved.
    return float((traffic * distance[np.ix_(slot_of, slot_of)]).sum() / 2)


def _spectral_start(traffic: FloatArray, chip: Chip, slots: int) -> IntArray:
    """Return the slot of each core in spectral order: cores with much traffic become neighbours on the tiles.

    The traffic graph is divided into its connected components, since the Fiedler vector orders only a connected
    graph. The cores follow each other along a snake through the tiles.
    """
    # Traffic is symmetric, so the strongly connected components are the connected ones.
    components = sources_first(len(traffic), np.argwhere(traffic))
    component_orders = [_spectral_order(traffic, np.array(component)) for component in components]
    order = np.concatenate(component_orders)
    start = np.empty(len(order), dtype=np.int64)
    start[order] = _snake(chip, slots)[: len(order)]
    return start


def _snake(chip: Chip, slots: int) -> list[int]:
    """Return the slots along a snake: down one column of tiles, up the next, so that successors are neighbours."""

    def place_on_snake(slot: int) -> tuple[int, int, int]:
        column, row = chip.tile_of(slot)
        goes_up = column % 2 == 1
        # The slots of one tile, which has several cores, follow each other.
        return column, -row if goes_up else row, slot

    return sorted(range(slots), key=place_on_snake)


def _spectral_order(traffic: FloatArray, component: IntArray) -> IntArray:
    """Return the cores of a connected component in the order of their entries in its Fiedler vector.

    The Fiedler vector is the eigenvector of the graph's Laplacian with the second smallest eigenvalue. Nodes with
    strong links have similar entries.
    """
    if len(component) < MIN_CORES:
        return component
    traffic_within = traffic[np.ix_(component, component)]
    laplacian = np.diag(traffic_within.sum(axis=1)) - traffic_within
    # eigh sorts eigenvalues in ascending order.
    fiedler = np.linalg.eigh(laplacian).eigenvectors[:, 1]
    # The sign of an eigenvector is arbitrary: choose the one that puts the first core near the start.
    ascending = fiedler if fiedler[0] <= 0 else -fiedler
    # Rounded, so that the last bits, which differ between machines, do not decide the order.
    return component[np.argsort(np.round(ascending, 9), kind="stable")]


def _exchange_slots(traffic: FloatArray, distance: FloatArray, start: IntArray) -> IntArray:
    """Exchange the pair of slots that saves the most hops until none saves any; return the slot of each core.

    An empty slot is treated as a core without traffic, numbered after the real ones. Thus a core can move to it.
    """
    cores = len(start)
    slots = len(distance)
    empty = np.setdiff1d(np.arange(slots), start)
    slot_of = np.concatenate((start, empty))
    flow = np.zeros((slots, slots))
    flow[:cores, :cores] = traffic
    # hops[i, s] is the hops of core i's traffic if core i were in slot s and all other cores stayed.
    hops = flow @ distance[slot_of]
    while True:
        change = _change_of_hops(hops, flow, distance, slot_of)
        # The rows of real cores are enough: to exchange two empty slots changes nothing.
        i, j = np.unravel_index(int(change[:cores].argmin()), (cores, slots))
        if change[i, j] >= -_NO_GAIN:
            return slot_of[:cores]
        # Update `hops` in place, which costs slots^2; to compute it anew would cost slots^3.
        # Traffic with core i now ends at the slot of core j, and the other way round.
        distance_change = distance[slot_of[j]] - distance[slot_of[i]]
        hops += flow[:, [i]] * distance_change - flow[:, [j]] * distance_change
        slot_of[[i, j]] = slot_of[[j, i]]


def _change_of_hops(
    hops: FloatArray, flow: FloatArray, distance: FloatArray, slot_of: IntArray
) -> FloatArray:
    """Return the change of all hops if cores i and j exchange slots, (slots, slots); negative is better.

    ``change[i, j] = hops[i, slot of j] + hops[j, slot of i] - hops[i, slot of i] - hops[j, slot of j] + correction``
    """
    hops_in_slot_of = hops[:, slot_of]
    hops_now = np.diag(hops_in_slot_of)
    # `hops` assumes that the other core stays where it is, so it puts both into one slot, at distance 0 from each
    # other. In fact they are as far apart after the exchange as before, which counts once for each of the two.
    correction = 2 * flow * distance[np.ix_(slot_of, slot_of)]
    return np.asarray(
        hops_in_slot_of + hops_in_slot_of.T - hops_now[:, None] - hops_now[None] + correction
    )
