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
    ``shared``: whether all phases keep their states in the same places. Numbers may have gaps, in which the core waits.
    """

    number: IntArray
    parent: IntArray
    of_phase: dict[str, IntArray]
    ends: list[int]
    shared: bool

    def places(self, numbers: IntArray) -> IntArray:
        """Return, in a new array, where the states and charges of compartments with these numbers lie.

        They are counted from the first of all compartments on or, where phases share places, from the first of each.
        """
        if not self.shared:
            return numbers.copy()
        first_of_phase = np.array([0, *self.ends[:-1]])
        phase = np.searchsorted(self.ends, numbers, side="right")
        return np.asarray(numbers - first_of_phase[phase])

    def sums(self) -> int:
        """Return the least power of two that tells all parents apart that wait for their children at a time."""
        is_child = self.parent >= 0
        child = self.number[is_child]
        parent_of_child = self.number[self.parent[is_child]]
        parents, index_of_parent = np.unique(parent_of_child, return_inverse=True)
        # The first child of a parent is the one with the least number.
        first_child = np.full(len(parents), self.ends[-1])
        np.minimum.at(first_child, index_of_parent, child)
        # Doubling ends at the latest where each parent has a word of its own.
        words = 1
        while self._meet(parents, first_child, words):
            words *= 2
        return words

    def _meet(self, parents: IntArray, first_child: IntArray, words: int) -> bool:
        """Tell whether a sum is begun before the last one in its word has been read.

        ``parents`` (n,) are numbers, ascending, and ``first_child`` (n,) those of their first children.
        """
        word = self.places(parents) % words
        order = np.lexsort((first_child, word))
        share_word = np.diff(word[order]) == 0
        begins = first_child[order][1:] + JOIN_DISTANCE
        is_read = parents[order][:-1] + 1
        return bool((share_word & (begins <= is_read)).any())


def numbered(program: ChipProgram, phases: Sequence[str], sizes: Sizes) -> Numbering:
    """Number the compartments of all cores, with ``phases`` in the order in which they run."""
    begin = np.cumsum([0, *(core.compartments for core in program.cores)])
    parent = of_compartments(
        program, lambda core: np.where(core.parent < 0, -1, begin[core.number] + core.parent)
    )
    turn = of_compartments(program, lambda core: phases.index(core.phase))
    _, depth = roots(parent)
    together = _families_together(parent, turn, len(phases), sizes)
    order = np.lexsort((parent, -depth, together, turn))
    number = _numbers_in_order(order, parent)
    last = [number[turn == index].max(initial=-1) for index in range(len(phases))]
    ends = [end + 1 for end in np.maximum.accumulate(last).tolist()]
    of_core = np.split(number, begin[1:-1])
    of_phase = {name: program.by_column(name, lambda core: of_core[core.number]) for name in phases}
    return Numbering(number, parent, of_phase, ends, shared=sizes.places > 0)


def _families_together(parent: IntArray, turn: IntArray, phases: int, sizes: Sizes) -> IntArray:
    """Return a number for each compartment: families of a phase with one number are updated together.

    They are at most ``sizes.sums``, so their sums find room. A family is all that is joined below one root.
    """
    if not sizes.sums:
        # Each parent has a word for its sum: all families are updated together.
        return np.zeros_like(parent)
    root, _ = roots(parent)
    is_root = parent < 0
    family_of_root = np.zeros_like(parent)
    for phase in range(phases):
        of_phase = turn == phase
        family_of_root[of_phase] = np.cumsum(is_root[of_phase]) - 1
    return family_of_root[root] // sizes.sums


def _numbers_in_order(order: IntArray, parent: IntArray) -> IntArray:
    """Return the least numbers in an order that leave :data:`JOIN_DISTANCE` before every parent."""
    number = np.empty_like(parent)
    next_number = 0
    earliest_of_parent: dict[int, int] = {}
    for compartment in order.tolist():
        own_number = max(next_number, earliest_of_parent.get(compartment, 0))
        number[compartment] = own_number
        earliest_of_parent[int(parent[compartment])] = own_number + JOIN_DISTANCE
        next_number = own_number + 1
    return number


def of_compartments(program: ChipProgram, values: Callable[[Core], IntArray | int]) -> IntArray:
    """Return what ``values`` gives for the compartments of every core, core after core."""
    parts = [np.broadcast_to(values(core), core.compartments) for core in program.cores]
    return np.concatenate(parts).astype(np.int64)
