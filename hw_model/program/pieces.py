"""A piece is the part of a group on one core. Counts are kept by piece, and nothing finer."""

from functools import cached_property, lru_cache

import numpy as np

from hw_model.program.chip_program import ChipProgram
from hw_model.values import Frozen, IntArray


class Pieces(Frozen, eq=False):
    """The pieces of a phase, core by core, on each core in the order of its compartments.

    Piece p is columns ``first[p]..stop[p]`` of ``group[p]``, on the phase's core ``core[p]`` (an index, not its
    number); core c has the pieces ``of_core[c]..of_core[c + 1]``.
    """

    group: tuple[str, ...]
    core: IntArray
    first: IntArray
    stop: IntArray
    of_core: IntArray

    @cached_property
    def of_column(self) -> IntArray:
        """The piece of each column."""
        order = np.argsort(self.first)
        return np.repeat(order, self.size[order])

    @property
    def size(self) -> IntArray:
        """The number of compartments of each piece."""
        return self.stop - self.first

    def of_pieces(self, values: IntArray) -> IntArray:
        """Add up values (..., pieces) by core, (..., cores)."""
        return np.add.reduceat(values, self.of_core[:-1], axis=-1)


@lru_cache(maxsize=32)
def pieces_of(program: ChipProgram, phase: str) -> Pieces:
    """Return the pieces of a phase. Programs are hashed by identity."""
    begin = {name: columns.start for name, columns in program.columns_of(phase).items()}
    cores = program.cores_of(phase)
    slices = [part for core in cores for part in core.slices]
    return Pieces(
        group=tuple(part.group for part in slices),
        core=np.repeat(np.arange(len(cores)), [len(core.slices) for core in cores]),
        first=np.array([begin[part.group] + part.start for part in slices], dtype=np.int64),
        stop=np.array([begin[part.group] + part.stop for part in slices], dtype=np.int64),
        of_core=np.cumsum([0, *(len(core.slices) for core in cores)]),
    )
