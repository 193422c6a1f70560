"""Number the nodes of a phase, and cut its pieces into chunks, for the layout of the fast engine.

A *node* is an input or a group of compartments, a *piece* the part of a group on one core, and a
*column* one compartment of the phase. Compartments are updated in *chunks* of ``LANES`` at a time.
Chunk k has the *slots* ``LANES * k`` to ``LANES * (k + 1) - 1``, one for each compartment; a chunk
that is not full leaves its last slots empty.
"""

import numpy as np

from hw_model.engine.layout import LANES
from hw_model.program.chip_program import ChipProgram
from hw_model.program.pieces import Pieces
from hw_model.values import Frozen, IntArray


class Numbering:
    """The nodes of a phase: inputs come first, then groups.

    - ``inputs``: the number of inputs, and ``lines``: input lines of all inputs
    - ``names[n]`` and ``size[n]``: name and number of lines or compartments of node n
    - ``first[n]``: its first input line or, for a group, its first column
    - ``parent[n]``: the node whose compartments it is joined to, or -1
    """

    def __init__(self, program: ChipProgram, phase: str) -> None:
        places = {**program.lines_of(phase), **program.columns_of(phase)}
        self.inputs = len(program.inputs_of(phase))
        self.names = list(places)
        self.first = np.array([place.start for place in places.values()], dtype=np.int64)
        self.size = np.array(
            [place.stop - place.start for place in places.values()], dtype=np.int64
        )
        self.lines = int(self.size[: self.inputs].sum())
        self._begin = np.cumsum(self.size) - self.size
        number = {name: node for node, name in enumerate(self.names)}
        self.parent = np.full(len(self.names), -1, dtype=np.int64)
        for name, parent_name in program.joined_to.items():
            if name in number:
                self.parent[number[name]] = number[parent_name]

    def of_source(self, source: IntArray) -> tuple[IntArray, IntArray]:
        """Return the node of each source, and the number of the source within its node.

        Sources are numbered over the whole phase: lines first, then columns.
        """
        node = np.asarray(np.searchsorted(self._begin, source, side="right") - 1)
        return node, source - self._begin[node]

    def of_column(self, column: IntArray) -> IntArray:
        """Return the node of each column."""
        return self.of_source(self.lines + column)[0]


class Cut(Frozen, eq=False):
    """The chunks of a phase.

    - ``node``, ``piece``, ``first_column``, ``width`` (chunks,): of each chunk; ``width`` is its number of columns
    - ``slot`` (columns,): the slot of each column
    - ``of_node`` (nodes + 1,): node n has the chunks ``of_node[n]`` to ``of_node[n + 1] - 1``
    """

    node: IntArray
    piece: IntArray
    first_column: IntArray
    width: IntArray
    slot: IntArray
    of_node: IntArray


def cut_pieces(pieces: Pieces, nodes: Numbering) -> Cut:
    """Cut every piece into chunks.

    Pieces are listed core by core. Sorted by their columns they are in the order of nodes, so that
    the chunks of a node follow each other.
    """
    order = np.argsort(pieces.first)
    size = pieces.size[order]
    chunks = -(-size // LANES)  # chunks of each piece, rounded up
    first_chunk = np.cumsum(chunks) - chunks
    # From a column to its slot: the same offset for all columns of a piece.
    slot = np.arange(size.sum()) + np.repeat(LANES * first_chunk - pieces.first[order], size)
    piece = np.repeat(order, chunks)
    chunk_in_piece = np.arange(len(piece)) - np.repeat(first_chunk, chunks)
    first_column = pieces.first[piece] + LANES * chunk_in_piece
    width = np.minimum(LANES, pieces.stop[piece] - first_column)
    node = nodes.of_column(first_column)
    of_node = np.searchsorted(node, np.arange(len(nodes.names) + 1))
    return Cut(node, piece, first_column, width, slot, of_node)
