"""Which ways packets take through the mesh of a chip, from core to core of a phase.

Cores sit in tiles of a two-dimensional mesh. A packet first travels east or west (X), then north or
south (Y). A *link* leads from one tile to a neighbour; a *way* is the sequence of links from a
*piece*, the compartments of one group on one core, to a core that receives its spikes.
"""

from collections.abc import Iterable, Iterator
from functools import cached_property, lru_cache
from itertools import pairwise

import numpy as np

from hw_model.program.chip_program import ChipProgram, Core
from hw_model.program.pieces import pieces_of
from hw_model.values import Frozen, IntArray

Tile = tuple[int, int]
"""Column and row."""
Link = tuple[Tile, Tile]
"""From a tile to the next."""
PER_PACKET = ("axon_packets", "packets_within_tile", "hops_x", "hops_y")
"""What a packet adds to on its way: one for itself, one if it stays within its tile, and its hops."""


class Routes(Frozen, eq=False):
    """The ways that packets of a phase can take, sorted by the piece that sends them.

    - way r goes from ``piece[r]`` of the phase (:mod:`hw_model.program.pieces`), on core ``source[r]``, to core
      ``target[r]`` (indices of the phase's cores). Its length is ``hops[r]`` (east-west, north-south), and it takes the
      links ``over[r]`` (longest way,), padded with -1
    - ``links[l]``: (column, row) of the tile that a link leaves, and of the one that it enters; ``along_y[l]`` is
      1 if it goes north or south, 0 if east or west
    - ``sent`` (3, entries): a column of the phase's spikes (:meth:`ChipProgram.columns_of_core`), a way, and how many
      packets of one spike of that column take it
    """

    piece: IntArray
    source: IntArray
    target: IntArray
    hops: IntArray
    over: IntArray
    links: tuple[Link, ...]
    along_y: IntArray
    sent: IntArray

    @cached_property
    def per_packet(self) -> dict[str, IntArray]:
        """What a packet on each way adds to each count of :data:`PER_PACKET`, (ways,)."""
        x, y = self.hops.T
        is_within_tile = (x + y == 0).astype(np.int64)
        return dict(zip(PER_PACKET, (np.ones_like(x), is_within_tile, x, y), strict=True))

    def loads(self, packets: IntArray) -> IntArray:
        """Return the packets on each link, (..., links), given those on each way, (..., ways)."""
        loads = np.zeros((*packets.shape[:-1], len(self.links)), dtype=np.int64)
        # The first links of all ways, then their second ones, and so on.
        for link_of_way in self.over.T:
            way = np.flatnonzero(link_of_way >= 0)
            np.add.at(loads.T, link_of_way[way], packets[..., way].T)
        return loads


@lru_cache(maxsize=8)
def routes_of(program: ChipProgram, phase: str) -> Routes:
    """Return the ways of a phase.

    The cache is keyed by the identity of the program, which never changes.
    """
    cores = program.cores_of(phase)
    index_of = {core.number: index for index, core in enumerate(cores)}
    pieces = pieces_of(program, phase)
    ways = _Ways()
    sent = []
    for index, core in enumerate(cores):
        column = program.columns_of_core(core)[core.axons.out_compartment]
        piece_in_core = core.slice_of_compartment[core.axons.out_compartment]
        # One way per pair of a piece of this core and a receiving core; `_Ways` gets them below, in this order.
        ends = np.stack((piece_in_core, core.axons.out_core))
        ends_of_way, way_of_axon = np.unique(ends, axis=1, return_inverse=True)
        # numpy 2.0 alone gives the inverse a second axis.
        packets_of_spike = np.stack((column, len(ways) + way_of_axon.reshape(-1)))
        column_and_way, packets = np.unique(packets_of_spike, axis=1, return_counts=True)
        sent.append(np.concatenate((column_and_way, packets[None])))
        for piece_of_way, target_number in ends_of_way.T.tolist():
            target = cores[index_of[target_number]]
            first_piece = int(pieces.of_core[index])
            ways.piece.append(first_piece + piece_of_way)
            ways.target.append(index_of[target_number])
            ways.hops.append(program.chip.hops(core.slot, target.slot))
            ways.add_links(_links(program, core, target))
    all_pieces = np.array(ways.piece, dtype=np.int64)
    links = tuple(ways.number_of_link)
    return Routes(
        piece=all_pieces,
        source=pieces.core[all_pieces],
        target=np.array(ways.target, dtype=np.int64),
        hops=np.array(ways.hops, dtype=np.int64).reshape(-1, 2),
        over=ways.over(),
        links=links,
        along_y=np.array([_is_along_y(link) for link in links], dtype=np.int64),
        sent=np.concatenate(sent, axis=1),
    )


class _Ways:
    """Collects ways, and numbers the links that they take in the order of first use."""

    def __init__(self) -> None:
        self.piece: list[int] = []
        self.target: list[int] = []
        self.hops: list[tuple[int, int]] = []
        self.links: list[list[int]] = []
        self.number_of_link: dict[Link, int] = {}

    def __len__(self) -> int:
        return len(self.piece)

    def add_links(self, links: Iterable[Link]) -> None:
        """Add the links of the next way; a link that no earlier way takes gets the next number."""
        numbers = self.number_of_link
        self.links.append([numbers.setdefault(link, len(numbers)) for link in links])

    def over(self) -> IntArray:
        """Return the links of all ways, (ways, longest way), padded with -1."""
        longest = max(map(len, self.links), default=0)
        over = np.full((len(self.links), longest), -1, dtype=np.int64)
        for way, links in enumerate(self.links):
            over[way, : len(links)] = links
        return over


def _is_along_y(link: Link) -> bool:
    """Return whether a link leads north or south: from a tile to one in the same column."""
    (from_column, _), (to_column, _) = link
    return from_column == to_column


def _links(program: ChipProgram, source: Core, target: Core) -> Iterator[Link]:
    """Yield the links from one core to another, X first, then Y."""
    x, y = program.chip.tile_of(source.slot)
    to_x, to_y = program.chip.tile_of(target.slot)
    along_x = [(at, y) for at in range(x, to_x, 1 if to_x > x else -1)]
    along_y = [(to_x, at) for at in range(y, to_y, 1 if to_y > y else -1)]
    # Both ranges end before their goal: the corner is the first of `along_y`, and the last tile is added.
    yield from pairwise([*along_x, *along_y, (to_x, to_y)])
