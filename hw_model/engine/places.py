"""Where nodes, pieces and columns of a phase lie: nodes by number, columns in slots of chunks."""

import numpy as np

from hw_model.engine.layout import LANES
from hw_model.program.chip_program import ChipProgram
from hw_model.program.pieces import Pieces
from hw_model.values import Frozen, IntArray


class Numbering:
    """Inputs, then groups, with their names and sizes; ``first``: first lines or columns; ``parent``, or -1."""

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
        parents = [
            number[program.joined_to[name]] if name in program.joined_to else -1
            for name in self.names
        ]
        self.parent = np.array(parents, dtype=np.int64)

    def of_source(self, source: IntArray) -> tuple[IntArray, IntArray]:
        """Return the nodes of sources, lines and then columns, and the numbers of these on them."""
        node = np.asarray(np.searchsorted(self._begin, source, side="right") - 1)
        return node, source - self._begin[node]

    def of_column(self, column: IntArray) -> IntArray:
        """Return the nodes of columns."""
        return self.of_source(self.lines + column)[0]


class Cut(Frozen, eq=False):
    """Pieces cut into chunks: node, piece, first column and width of each chunk, the slot of every column.

    ``of_node``: the first chunk of each node, with the end.
    """

    node: IntArray
    piece: IntArray
    first_column: IntArray
    width: IntArray
    slot: IntArray
    of_node: IntArray


def cut_pieces(pieces: Pieces, nodes: Numbering) -> Cut:
    """Cut the pieces in the order of their columns, which is that of their nodes."""
    order = np.argsort(pieces.first)
    size = pieces.size[order]
    chunks = -(-pieces.size[order] // LANES)
    begin = np.cumsum(chunks) - chunks
    slot = np.arange(size.sum()) + np.repeat(LANES * begin - pieces.first[order], size)
    piece = np.repeat(order, chunks)
    first_column = pieces.first[piece] + LANES * (np.arange(len(piece)) - np.repeat(begin, chunks))
    width = np.minimum(LANES, pieces.stop[piece] - first_column)
    node = nodes.of_column(first_column)
    of_node = np.searchsorted(node, np.arange(len(nodes.names) + 1))
    return Cut(node, piece, first_column, width, slot, of_node)
