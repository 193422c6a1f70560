"""Formats with several exponents for the weights of one population: each weight is in the finest one that holds it.

Weights are whole numbers of *quanta*. A quantum is the smallest effective weight that the chip has, a unit. The
*grades* of a population are formats that differ only in their exponent. Grade k of b bits holds multiples of ``2^k``
up to ``(2^b - 1) * 2^k`` quanta: the mantissas have b high bits, and the exponent is ``k + b - 8``. A *split* weight
has two synapses to the same target: the second holds the remainder that the first cannot, in the finest grade that
holds it.
"""

from collections.abc import Iterator, Sequence

import numpy as np

from hw_model.arithmetic import loihi
from hw_model.arithmetic.fixed_point import WEIGHT_EXPONENTS
from hw_model.values import BoolArray, FloatArray, Frozen, IntArray
from locsnn_compile.network.chip_neurons import ChipNeuron
from locsnn_compile.network.projections import (
    ChipProjection,
    Projection,
    of_target,
    values_of,
    with_values,
)
from locsnn_compile.passes.rounding.task import Scaled, Task

MANTISSA_BITS = 8
"""Bits of a mantissa; a weight of fewer bits uses the high ones."""

# A core has 16 synapse formats. Each grade takes two, one per sign; grades of second synapses take as many again.
GRADES = 4
"""Largest number of grades of a population without split weights: 8 formats."""
GRADES_IF_SPLIT = 3
"""Largest number of grades of first synapses if weights are split: 12 formats."""
GRADES_BESIDE_TAPS = 2
"""Largest number of grades of first synapses if weights are split and neurons have taps: 8 formats, next to 6."""

FORMATS_OF_TAPS = 6
"""Largest number of synapse formats that the self-synapses (taps) of strategy ``delay-line`` take."""


class Grades(Frozen):
    """The grades of a population, whose weights have ``weight_bits`` bits; ``numbers`` are their k, finest first."""

    weight_bits: int
    numbers: tuple[int, ...]

    @classmethod
    def holding(
        cls, largest: float, weight_bits: int, *, count: int = GRADES, split: bool = False
    ) -> "Grades":
        """Return ``count`` grades for magnitudes up to ``largest`` quanta; if ``split``, also those of second synapses.

        The coarsest is the finest one that holds the largest magnitude, and the others follow it downwards.
        """
        top = coarsest(weight_bits)
        highest = next((k for k in range(top) if np.rint(largest / 2**k) < 1 << weight_bits), top)
        first = set(range(max(0, highest - count + 1), highest + 1))
        # What grade k leaves is below 2^k, which grade k - weight_bits holds with all bits.
        second = {max(0, k - weight_bits) for k in first} if split else set()
        return cls(weight_bits, tuple(sorted(first | second)))

    def grade(self, magnitude: FloatArray) -> IntArray:
        """Return, for each magnitude, the finest grade that holds it with one more step, else the coarsest.

        One more step, because a weight that is rounded together with others may take the next value above.
        """
        grades = np.array(self.numbers, dtype=np.int64)
        # A grade of one bit holds a single step, which leaves no room for another.
        one_more_step = 1 << grades if self.weight_bits > 1 else 0
        largest = (self.largest_of(grades) - one_more_step).astype(np.float64)
        index = np.minimum(np.searchsorted(largest, magnitude), len(grades) - 1)
        return grades[index]

    def second_grade(self, grade: IntArray) -> IntArray:
        """Return the grade of a split weight's second synapse: the finest that holds what the first one leaves."""
        index = np.searchsorted(self.numbers, np.asarray(grade) - self.weight_bits)
        return np.array(self.numbers, dtype=np.int64)[index]

    def largest_of(self, grade: IntArray) -> IntArray:
        """Return the largest magnitude of every grade, in quanta."""
        return largest_multiple(self.weight_bits) << grade

    def exponent(self, grade: int) -> int:
        """Return the weight exponent of a grade's format."""
        return grade + self.weight_bits - MANTISSA_BITS

    def parts(
        self, quanta: IntArray, grade: IntArray, split: BoolArray
    ) -> Iterator[tuple[IntArray, int]]:
        """Yield (mantissas, exponent) for every grade in use, finest first; the effective weights add up to ``quanta``.

        ``grade`` is that of each weight's first synapse.
        """
        magnitude = np.abs(quanta)
        # The first synapse takes the multiple of 2^grade, the second what is left.
        first = magnitude >> grade << grade
        second = np.where(split, magnitude - first, 0)
        second_grade = self.second_grade(grade)
        for k in self.numbers:
            in_grade = np.where(grade == k, first, 0) + np.where(second_grade == k, second, 0)
            if in_grade.any():
                mantissa = in_grade >> k << (MANTISSA_BITS - self.weight_bits)
                yield np.sign(quanta) * mantissa, self.exponent(k)


def grades_for(largest: float, task: Task, neuron: ChipNeuron) -> Grades:
    """Return the grades for magnitudes up to ``largest`` quanta onto these neurons.

    A core holds a limited number of synapse formats. A format also fixes the width of the delay field, so each grade
    needs one format per width: the more widths there are, the fewer grades. Own spikes take formats as well, except
    that with several widths, placement can let formats share a wider delay field if there are too many.
    """
    split = task.rounding.split > 0
    taps = neuron.strategy == "delay-line"
    delay_widths = {int(np.max(p.delay, initial=0)).bit_length() for p in task.incoming}
    widths = max(1, len(delay_widths))
    if not split:
        count_max = GRADES
    elif taps:
        count_max = GRADES_BESIDE_TAPS
    else:
        count_max = GRADES_IF_SPLIT
    if taps:
        own_formats = FORMATS_OF_TAPS
    else:
        own_formats = int(widths == 1 and neuron.strategy != "native")
    signs = 2
    synapses_per_weight = 2 if split else 1
    formats_left = task.chip.limits.synapse_formats_per_core - own_formats
    formats_per_grade = signs * widths * synapses_per_weight
    count = max(1, min(count_max, formats_left // formats_per_grade))
    if not task.rounding.graded:
        count = 1
    return Grades.holding(largest, task.grid.weight_bits, count=count, split=split)


def nearest(quanta: FloatArray, step: IntArray, largest: IntArray) -> IntArray:
    """Round to the nearest multiples of ``step``, half to even, and clip to magnitudes; 0 where the step is 0."""
    rounded = np.rint(quanta / np.maximum(step, 1)) * step
    return np.clip(rounded, -largest, largest).astype(np.int64)


def largest_multiple(weight_bits: int) -> int:
    """Return the largest multiple of a grade's step that a weight can be."""
    return (1 << weight_bits) - 1


def coarsest(weight_bits: int) -> int:
    """Return the chip's coarsest grade with this many bits."""
    return WEIGHT_EXPONENTS[-1] + MANTISSA_BITS - weight_bits


def shares(quanta: IntArray, dendrites: int, step: IntArray | int) -> list[IntArray]:
    """Divide multiples of ``step`` into nearly equal multiples, one for each dendrite."""
    steps = np.abs(quanta) // np.maximum(step, 1)
    # The sum over i = 0..d-1 of (x + i) // d is x.
    return [np.sign(quanta) * step * ((steps + number) // dendrites) for number in range(dendrites)]


def in_grades(
    p: Projection,
    quanta: IntArray,
    grade: IntArray,
    split: BoolArray,
    grades: Grades,
    dendrites: int = 1,
) -> list[ChipProjection]:
    """Return a projection, with values in quanta, as one projection per dendrite and grade.

    ``grade`` is that of each dendrite's share. A dendrite whose weights are all 0 gets a projection of zeros, so that
    every projection of the network remains, and its lost weights can be counted.
    """
    projections = []
    step = 1 << np.where(split, grades.second_grade(grade), grade)
    for dendrite, share in enumerate(shares(quanta, dendrites, step)):
        parts = list(grades.parts(share, grade, split))
        if not parts:
            all_zero = (share, grades.exponent(grades.numbers[0]))
            parts = [all_zero]
        for mantissa, exponent in parts:
            projection = ChipProjection(
                source=p.source,
                target=p.target,
                mantissa=with_values(p.weights, mantissa),
                exponent=exponent,
                weight_bits=grades.weight_bits,
                delay=p.delay,
                dendrite=dendrite,
            )
            projections.append(projection)
    return projections


def round_apart(task: Task, scaled: Scaled) -> list[list[ChipProjection]]:
    """Round each weight onto a population to the nearest value of the finest format that holds it.

    If a share of weights is split, these are the largest, whose formats are coarsest. Returns the projections that each
    incoming projection becomes.
    """
    dendrites = scaled.neuron.dendrites
    quanta_per_weight = loihi.in_units(scaled.gain * scaled.scale)
    ideal = [values_of(p.weights) * of_target(p.weights, quanta_per_weight) for p in task.incoming]
    largest = max((float(np.abs(quanta).max(initial=0.0)) for quanta in ideal), default=0.0)
    grades = grades_for(largest / dendrites, task, scaled.neuron)
    is_split = _largest(ideal, task.rounding.split)
    rounded = []
    for p, ideal_quanta, split in zip(task.incoming, ideal, is_split, strict=True):
        grade = grades.grade(np.abs(ideal_quanta) / dendrites)
        step = 1 << np.where(split, grades.second_grade(grade), grade)
        quanta = nearest(ideal_quanta, step, dendrites * grades.largest_of(grade))
        rounded.append(in_grades(p, quanta, grade, split, grades, dendrites))
    return rounded


def _largest(ideal: Sequence[FloatArray], share: float) -> list[BoolArray]:
    """Mark the largest weights over all projections, as many as a ``share`` of those that are not 0."""
    if not ideal:
        return []
    flat = np.concatenate([np.abs(part).ravel() for part in ideal])
    count = round(share * int((flat > 0).sum()))
    marked = np.zeros(len(flat), dtype=np.bool_)
    # A stable sort marks equal weights in the same order on every machine.
    marked[np.argsort(-flat, kind="stable")[:count]] = True
    ends = np.cumsum([part.size for part in ideal])[:-1]
    marked_of_projection = zip(np.split(marked, ends), ideal, strict=True)
    return [mask.reshape(part.shape) for mask, part in marked_of_projection]
