"""The ways of spikes between the cores of a phase: X first, then Y, link by link."""

from collections.abc import Iterator
from functools import cached_property, lru_cache
from itertools import pairwise

import numpy as np

from hw_model.program.chip_program import ChipProgram, Core
from hw_model.program.pieces import pieces_of
from hw_model.values import Frozen, IntArray

Tile = tuple[int, int]
PER_PACKET = ("axon_packets", "packets_within_tile", "hops_x", "hops_y")
"""Counts of a packet that its way determines."""


class Routes(Frozen, eq=False):
    """The ways that packets of a phase can take, sorted by the piece that sends them.

    - Way r goes from ``piece[r]`` of the phase (:mod:`hw_model.program.pieces`), on core ``source[r]``, to core
      ``target[r]`` (indices of the phase's cores). Its length is ``hops[r]`` (east-west, north-south), and it takes the
      links ``over[r]`` (longest way,), filled up with -1.
    - ``links[l]``: (column, row) of the tile that a link leaves, and of the one that it enters; ``along_y[l]`` tells
      whether it goes north or south
    - ``sent`` (3, entries): a column, a way, and how many packets of one spike of that column take it
    """

    piece: IntArray
    source: IntArray
    target: IntArray
    hops: IntArray
    over: IntArray
    links: tuple[tuple[Tile, Tile], ...]
    along_y: IntArray
    sent: IntArray

    @cached_property
    def per_packet(self) -> dict[str, IntArray]:
        """What a packet on each way adds to each count of :data:`PER_PACKET`, (ways,)."""
        x, y = self.hops.T
        return dict(
            zip(PER_PACKET, (np.ones_like(x), (x + y == 0).astype(np.int64), x, y), strict=True)
        )

    def loads(self, packets: IntArray) -> IntArray:
        """Return the packets on each link, (..., links), given those on each way, (..., ways)."""
        loads = np.zeros((*packets.shape[:-1], len(self.links)), dtype=np.int64)
        for k in range(self.over.shape[1]):
            way = np.flatnonzero(self.over[:, k] >= 0)
            np.add.at(loads.T, self.over[way, k], packets[..., way].T)
        return loads


@lru_cache(maxsize=8)
def routes_of(program: ChipProgram, phase: str) -> Routes:
    """Return the ways of a phase. Programs are hashed by identity."""
    cores = program.cores_of(phase)
    place = {core.number: i for i, core in enumerate(cores)}
    number_of: dict[tuple[Tile, Tile], int] = {}
    pieces = pieces_of(program, phase)
    piece: list[int] = []
    target, hops, over, sent = [], [], [], []
    for index, core in enumerate(cores):
        local = core.slice_of_compartment[core.axons.out_compartment]
        ways = np.stack((local, core.axons.out_core))
        reached, way = np.unique(ways, axis=1, return_inverse=True)
        column = program.columns_of_core(core)[core.axons.out_compartment]
        places = np.stack((column, len(piece) + way.reshape(-1)))
        pairs, packets = np.unique(places, axis=1, return_counts=True)
        sent.append(np.concatenate((pairs, packets[None])))
        for own, to in reached.T.tolist():
            piece.append(int(pieces.of_core[index]) + own)
            target.append(place[to])
            hops.append(program.chip.hops(core.slot, program.cores[to].slot))
            links = _links(program, core, cores[place[to]])
            over.append([number_of.setdefault(link, len(number_of)) for link in links])
    longest = max(map(len, over), default=0)
    return Routes(
        piece=np.array(piece, dtype=np.int64),
        source=pieces.core[np.array(piece, dtype=np.int64)],
        target=np.array(target, dtype=np.int64),
        hops=np.array(hops, dtype=np.int64).reshape(-1, 2),
        over=np.array([row + [-1] * (longest - len(row)) for row in over], dtype=np.int64).reshape(
            len(over), longest
        ),
        links=tuple(number_of),
        along_y=np.array([a[0] == b[0] for a, b in number_of], dtype=np.int64),
        sent=np.concatenate(sent, axis=1),
    )


def _links(program: ChipProgram, source: Core, target: Core) -> Iterator[tuple[Tile, Tile]]:
    """Yield the links from one core to another, X first, then Y."""
    (x, y), (to_x, to_y) = program.chip.tile_of(source.slot), program.chip.tile_of(target.slot)
    along_x = [(at, y) for at in range(x, to_x, 1 if to_x > x else -1)]
    along_y = [(to_x, at) for at in range(y, to_y, 1 if to_y > y else -1)]
    yield from pairwise([*along_x, *along_y, (to_x, to_y)])
