"""The pieces of a phase. A piece is the part of a group that is on one core.

The engines count spikes, updates and so on per piece, not per compartment: energy needs counts per core, reports need
counts per group, and both are sums over pieces.
"""

from functools import cached_property, lru_cache

import numpy as np

from hw_model.program.chip_program import ChipProgram
from hw_model.values import Frozen, IntArray


class Pieces(Frozen, eq=False):
    """The pieces of a phase, core by core, on each core in the order of its compartments.

    Piece p belongs to ``group[p]`` and has the columns ``first[p]..stop[p]`` of arrays over the phase's compartments.
    It is on core ``core[p]``, which counts only the cores of this phase. Core c has the pieces
    ``of_core[c]..of_core[c + 1]``.
    """

    group: tuple[str, ...]
    core: IntArray
    first: IntArray
    stop: IntArray
    of_core: IntArray

    @cached_property
    def of_column(self) -> IntArray:
        """The piece of each column, (columns,)."""
        # Pieces are ordered by core; columns by group, so the parts of a group on several cores follow each other.
        by_column = np.argsort(self.first)
        return np.repeat(by_column, self.size[by_column])

    @property
    def size(self) -> IntArray:
        """The number of compartments of each piece."""
        return self.stop - self.first

    def of_pieces(self, values: IntArray) -> IntArray:
        """Return the sums of values (..., pieces) per core, (..., cores)."""
        return np.add.reduceat(values, self.of_core[:-1], axis=-1)


@lru_cache(maxsize=32)
def pieces_of(program: ChipProgram, phase: str) -> Pieces:
    """Return the pieces of a phase.

    Many callers ask for the same program's pieces, so results are cached. A program is hashed by its identity.
    """
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
