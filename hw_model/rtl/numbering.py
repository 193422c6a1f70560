"""Number the compartments of a program, in the order in which the core updates them.

A compartment may be joined to another, its parent, to which it adds its voltage in the same step.
So children come before parents: phase by phase, the deepest children first, siblings next to each
other, and a parent at least ``JOIN_DISTANCE`` after its last child. Where nothing else can be
updated in between, numbers have gaps, in which the core waits.
"""

from collections.abc import Callable, Sequence

import numpy as np

from hw_model.description.open_core import Sizes
from hw_model.mapping.circles import roots
from hw_model.program.chip_program import ChipProgram, Core
from hw_model.values import Frozen, IntArray

JOIN_DISTANCE = 6
"""Least number of cycles from the issue of a child to that of its parent.

The pipeline (update.sv) writes the sum of the children in cycle 8 and reads it for the parent in
cycle 3, and a word can be read in the cycle after it was written: 8 + 1 - 3.
"""


class Numbering(Frozen, eq=False):
    """The compartments of all cores of a program, core after core, and their numbers.

    - ``number`` (compartments,): the number of each; there may be gaps
    - ``parent`` (compartments,): the compartment that each is joined to, as an index of these
      arrays, or -1
    - ``of_phase[phase]`` (columns,): the numbers of the compartments of a phase, by column of the
      program
    - ``ends`` (phases,): the first number after each phase
    - ``shared``: whether all phases keep their states in the same places
    """

    number: IntArray
    parent: IntArray
    of_phase: dict[str, IntArray]
    ends: list[int]
    shared: bool

    def places(self, numbers: IntArray) -> IntArray:
        """Return the places of the states and charges of compartments, given their numbers.

        The result is a new array. A place is the number itself or, where phases share places, its
        distance from the first number of its phase.
        """
        if not self.shared:
            return numbers.copy()
        first_of_phase = np.array([0, *self.ends[:-1]])
        phase = np.searchsorted(self.ends, numbers, side="right")
        return np.asarray(numbers - first_of_phase[phase])

    def sum_words(self) -> int:
        """Return how many words for sums of joined voltages the core needs, a power of two.

        A parent's word is its place modulo this number. Two parents may share a word, but not while
        both wait for children: the sum of one would be overwritten before it is read.
        """
        is_child = self.parent >= 0
        child = self.number[is_child]
        parent_of_child = self.number[self.parent[is_child]]
        parents, index_of_parent = np.unique(parent_of_child, return_inverse=True)
        # The first child of a parent is the one with the least number.
        first_child = np.full(len(parents), self.ends[-1])
        np.minimum.at(first_child, index_of_parent, child)
        # Doubling ends at the latest where each parent has a word of its own.
        words = 1
        while self._sums_collide(parents, first_child, words):
            words *= 2
        return words

    def _sums_collide(self, parents: IntArray, first_child: IntArray, words: int) -> bool:
        """Return whether, with so many words, a sum would be overwritten before it is read.

        ``parents`` (n,) are numbers, ascending, and ``first_child`` (n,) the numbers of their first
        children.
        """
        word = self.places(parents) % words
        # Neighbours in this order are the sums that follow each other in one word.
        order = np.lexsort((first_child, word))
        share_word = np.diff(word[order]) == 0
        # The sum is written in cycle 8 of its first child, and the parent before reads its own in
        # cycle 3. They collide unless the write comes later, so if first_child + 8 <= parent + 3.
        write = first_child[order][1:] + JOIN_DISTANCE
        read = parents[order][:-1] + 1
        return bool((share_word & (write <= read)).any())


def numbered(program: ChipProgram, phases: Sequence[str], sizes: Sizes) -> Numbering:
    """Number the compartments of all cores, with ``phases`` in the order in which they run."""
    # Compartments are counted core after core; `begin` is the first of each core.
    begin = np.cumsum([0, *(core.compartments for core in program.cores)])
    parent = of_compartments(
        program, lambda core: np.where(core.parent < 0, -1, begin[core.number] + core.parent)
    )
    phase_of = of_compartments(program, lambda core: phases.index(core.phase))
    _, depth = roots(parent)
    batch = _family_batches(parent, phase_of, len(phases), sizes)
    # The last key counts first: by phase, by batch, the deepest first, and siblings together.
    order = np.lexsort((parent, -depth, batch, phase_of))
    number = _numbers_in_order(order, parent)
    last = [number[phase_of == index].max(initial=-1) for index in range(len(phases))]
    # A phase without compartments ends where the phase before it does.
    ends = [end + 1 for end in np.maximum.accumulate(last).tolist()]
    of_core = np.split(number, begin[1:-1])
    of_phase = {name: program.by_column(name, lambda core: of_core[core.number]) for name in phases}
    return Numbering(number, parent, of_phase, ends, shared=sizes.places > 0)


def _family_batches(parent: IntArray, phase_of: IntArray, phases: int, sizes: Sizes) -> IntArray:
    """Return the batch of each compartment; the batches of a phase are updated one after the other.

    A family is a compartment that is joined to no other, the root, with all that is joined to it,
    also by way of others. A batch has at most ``sizes.sums`` families, so that there is room for
    their sums.
    """
    if not sizes.sums:
        # Each parent has a word of its own for its sum: all families are one batch.
        return np.zeros_like(parent)
    root, _ = roots(parent)
    is_root = parent < 0
    family_of_root = np.zeros_like(parent)
    for phase in range(phases):
        of_phase = phase_of == phase
        # Families are counted from 0 in each phase.
        family_of_root[of_phase] = np.cumsum(is_root[of_phase]) - 1
    return family_of_root[root] // sizes.sums


def _numbers_in_order(order: IntArray, parent: IntArray) -> IntArray:
    """Return the least ascending numbers that leave :data:`JOIN_DISTANCE` before every parent.

    ``order`` lists the compartments, each child before its parent.
    """
    number = np.empty_like(parent)
    next_number = 0
    earliest_of_parent: dict[int, int] = {}
    for compartment in order.tolist():
        earliest = max(next_number, earliest_of_parent.get(compartment, 0))
        number[compartment] = earliest
        # Children ascend, so the last one of a parent leaves its entry. The entry of -1, no parent,
        # is never looked up.
        earliest_of_parent[int(parent[compartment])] = earliest + JOIN_DISTANCE
        next_number = earliest + 1
    return number


def of_compartments(program: ChipProgram, values: Callable[[Core], IntArray | int]) -> IntArray:
    """Return a value for each compartment; ``values`` gives those of a core, or one for all."""
    parts = [np.broadcast_to(values(core), core.compartments) for core in program.cores]
    return np.concatenate(parts).astype(np.int64)
