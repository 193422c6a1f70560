"""The numbers of a program's compartments in the core, which are the order of their updates.

Phase by phase, deepest children first, siblings together, and a parent at least ``JOIN_DISTANCE`` after its last child.
"""

from collections.abc import Callable, Sequence

import numpy as np

from hw_model.description.open_core import Sizes
from hw_model.mapping.circles import roots
from hw_model.program.chip_program import ChipProgram, Core
from hw_model.values import Frozen, IntArray

JOIN_DISTANCE = 6
"""Cycles from the issue of a child to the earliest of its parent: the sum is written in cycle 8 and read in cycle 3."""


class Numbering(Frozen, eq=False):
    """The compartments of all cores of a program, core after core, and their numbers.

    ``number`` (compartments,); ``parent`` (compartments,): the compartment that each is joined to, or -1;
    ``of_phase[phase]`` (columns,): numbers by column; ``ends`` (phases,): the first number after each phase;
    ``shared``: whether all phases keep their states in the same places.
    """

    number: IntArray
    parent: IntArray
    of_phase: dict[str, IntArray]
    ends: list[int]
    shared: bool

    def places(self, numbers: IntArray) -> IntArray:
        """Return where states and charges of compartments lie, from the first of all or of their phase on."""
        begins = np.array([0, *self.ends[:-1]]) * self.shared
        return np.asarray(numbers - begins[np.searchsorted(self.ends, numbers, side="right")])

    def sums(self) -> int:
        """Return the least power of two that tells all parents apart that wait for their children at a time."""
        numbers, parent = self.number[self.parent >= 0], self.number[self.parent[self.parent >= 0]]
        parents, which = np.unique(parent, return_inverse=True)
        begins = np.full(len(parents), self.ends[-1])
        np.minimum.at(begins, which, numbers)
        places, words = self.places(parents), 1
        while True:
            by_word = np.lexsort((begins, places % words))
            same = np.diff(places[by_word] % words) == 0
            if not (
                same & (begins[by_word][1:] + JOIN_DISTANCE <= parents[by_word][:-1] + 1)
            ).any():
                return words
            words *= 2


def numbered(program: ChipProgram, phases: Sequence[str], sizes: Sizes) -> Numbering:
    """Number the compartments of all cores, with ``phases`` in the order in which they run."""
    begin = np.cumsum([0, *(core.compartments for core in program.cores)])
    parent = of_compartments(
        program, lambda core: np.where(core.parent < 0, -1, begin[core.number] + core.parent)
    )
    turn = of_compartments(program, lambda core: phases.index(core.phase))
    root, depth = roots(parent)
    # Families of a phase come so few at a time that their sums find room.
    rank, is_root = np.zeros_like(parent), parent < 0
    for index in range(len(phases)):
        rank[turn == index] = np.cumsum(is_root[turn == index]) - 1
    together = rank[root] // sizes.sums if sizes.sums else rank * 0
    number, following = np.empty_like(parent), 0
    earliest: dict[int, int] = {}
    for index in np.lexsort((parent, -depth, together, turn)).tolist():
        number[index] = max(following, earliest.get(index, 0))
        following = int(number[index]) + 1
        earliest[int(parent[index])] = following + JOIN_DISTANCE - 1
    last = [number[turn == index].max(initial=-1) for index in range(len(phases))]
    own = np.split(number, begin[1:-1])
    of_phase = {name: program.by_column(name, lambda core: own[core.number]) for name in phases}
    ends = [end + 1 for end in np.maximum.accumulate(last).tolist()]
    return Numbering(number, parent, of_phase, ends, shared=sizes.places > 0)


def of_compartments(program: ChipProgram, values: Callable[[Core], IntArray | int]) -> IntArray:
    """Return what ``values`` gives for the compartments of every core, core after core."""
    parts = [np.broadcast_to(values(core), core.compartments) for core in program.cores]
    return np.concatenate(parts).astype(np.int64)
