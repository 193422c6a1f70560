"""Formats with several exponents for the weights of one population: each weight is in the finest one that holds it.

Weights are whole numbers of *quanta*. A quantum is the smallest effective weight that the chip has, a unit. Grade k
of b bits holds multiples of ``2^k`` up to ``(2^b - 1) * 2^k`` quanta: the mantissas have b high bits, and the exponent
is ``k + b - 8``. A *split* weight has two synapses, the second in the finest grade that holds what the first leaves.
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
GRADES, GRADES_IF_SPLIT, GRADES_BESIDE_TAPS = 4, 3, 2
"""Numbers of grades for first synapses. Second synapses at most double them, and signs double that: at most 12 of a
core's 16 formats, or 8 next to the 6 of taps."""

FORMATS_OF_TAPS = 6
"""Largest number of synapse formats that the taps of neurons take."""


class Grades(Frozen):
    """Grades of weights of ``weight_bits`` bits, finest first."""

    weight_bits: int
    held: tuple[int, ...]

    @classmethod
    def holding(
        cls, largest: float, weight_bits: int, *, count: int = GRADES, split: bool = False
    ) -> "Grades":
        """Return ``count`` grades for magnitudes up to ``largest`` quanta, and those of second synapses, if any."""
        top = coarsest(weight_bits)
        highest = next((k for k in range(top) if np.rint(largest / 2**k) < 1 << weight_bits), top)
        first = set(range(max(0, highest - count + 1), highest + 1))
        second = {max(0, k - weight_bits) for k in first} if split else set()
        return cls(weight_bits, tuple(sorted(first | second)))

    def grade(self, magnitude: FloatArray) -> IntArray:
        """Return, for each magnitude, the finest grade that holds it with one more step, else the coarsest."""
        grades = np.array(self.held, dtype=np.int64)
        one_more_step = 1 << grades if self.weight_bits > 1 else 0
        largest = (self.largest_of(grades) - one_more_step).astype(np.float64)
        index = np.minimum(np.searchsorted(largest, magnitude), len(grades) - 1)
        return grades[index]

    def second_grade(self, grade: IntArray) -> IntArray:
        """Return the grade of a split weight's second synapse: the finest that holds what the first one leaves."""
        index = np.searchsorted(self.held, np.asarray(grade) - self.weight_bits)
        return np.array(self.held, dtype=np.int64)[index]

    def largest_of(self, grade: IntArray) -> IntArray:
        """Return the largest magnitude of every grade, in quanta."""
        return largest_multiple(self.weight_bits) << grade

    def exponent(self, grade: int) -> int:
        """Return the weight exponent of a grade's format."""
        return grade + self.weight_bits - MANTISSA_BITS

    def parts(
        self, quanta: IntArray, grade: IntArray, split: BoolArray
    ) -> Iterator[tuple[IntArray, int]]:
        """Yield (mantissas, exponent) for every grade in use, finest first; effective weights add up."""
        magnitude = np.abs(quanta)
        first = magnitude >> grade << grade
        second = np.where(split, magnitude - first, 0)
        second_grade = self.second_grade(grade)
        for k in self.held:
            in_grade = np.where(grade == k, first, 0) + np.where(second_grade == k, second, 0)
            if in_grade.any():
                mantissa = in_grade >> k << (MANTISSA_BITS - self.weight_bits)
                yield np.sign(quanta) * mantissa, self.exponent(k)


def grades_for(largest: float, task: Task, neuron: ChipNeuron) -> Grades:
    """Return the grades for magnitudes up to ``largest`` quanta onto these neurons.

    A core holds so many formats, and each width of the delay field needs its own: the more widths there are, the fewer
    grades. If there are still too many formats, counting that of own spikes, some share a delay field when cores are
    filled; with one width there is nothing to share.
    """
    split = task.rounding.split > 0
    taps = neuron.strategy == "delay-line"
    delay_widths = {int(np.max(p.delay, initial=0)).bit_length() for p in task.incoming}
    kinds = max(1, len(delay_widths))
    if not split:
        count_max = GRADES
    elif taps:
        count_max = GRADES_BESIDE_TAPS
    else:
        count_max = GRADES_IF_SPLIT
    if taps:
        own_formats = FORMATS_OF_TAPS
    else:
        own_formats = int(kinds == 1 and neuron.strategy != "native")
    signs = 2
    synapses = 2 if split else 1
    formats_left = task.chip.limits.synapse_formats_per_core - own_formats
    count = max(1, min(count_max, formats_left // (signs * kinds * synapses)))
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
    whole = np.abs(quanta) // np.maximum(step, 1)
    return [np.sign(quanta) * step * ((whole + number) // dendrites) for number in range(dendrites)]


def in_grades(
    p: Projection,
    quanta: IntArray,
    grade: IntArray,
    split: BoolArray,
    grades: Grades,
    dendrites: int = 1,
) -> list[ChipProjection]:
    """Return a projection, with values in quanta, as one projection per dendrite and grade; with zeros if all are 0.

    ``grade`` is that of each dendrite's share.
    """
    projections = []
    step = 1 << np.where(split, grades.second_grade(grade), grade)
    for dendrite, share in enumerate(shares(quanta, dendrites, step)):
        parts = list(grades.parts(share, grade, split)) or [
            (share, grades.exponent(grades.held[0]))
        ]
        for mantissa, exponent in parts:
            projection = ChipProjection(
                p.source,
                p.target,
                with_values(p.weights, mantissa),
                exponent,
                grades.weight_bits,
                delay=p.delay,
                dendrite=dendrite,
            )
            projections.append(projection)
    return projections


def round_apart(task: Task, scaled: Scaled) -> list[list[ChipProjection]]:
    """Round each weight onto a population to the nearest value of the finest format that holds it.

    The largest weights are the ones that are split. Returns the projections that each incoming one becomes.
    """
    dendrites = scaled.neuron.dendrites
    quanta_per_weight = loihi.in_units(scaled.gain * scaled.scale)
    ideal = [values_of(p.weights) * of_target(p.weights, quanta_per_weight) for p in task.incoming]
    largest = max((float(np.abs(quanta).max(initial=0.0)) for quanta in ideal), default=0.0)
    grades = grades_for(largest / dendrites, task, scaled.neuron)
    is_split = _coarsest(ideal, task.rounding.split)
    rounded = []
    for p, wanted, split in zip(task.incoming, ideal, is_split, strict=True):
        grade = grades.grade(np.abs(wanted) / dendrites)
        step = 1 << np.where(split, grades.second_grade(grade), grade)
        quanta = nearest(wanted, step, dendrites * grades.largest_of(grade))
        rounded.append(in_grades(p, quanta, grade, split, grades, dendrites))
    return rounded


def _coarsest(ideal: Sequence[FloatArray], share: float) -> list[BoolArray]:
    """Mark the ``share`` of weights that are largest, over all projections."""
    if not ideal:
        return []
    flat = np.concatenate([np.abs(part).ravel() for part in ideal])
    count = round(share * int((flat > 0).sum()))
    marked = np.zeros(len(flat), dtype=np.bool_)
    marked[np.argsort(-flat, kind="stable")[:count]] = True
    ends = np.cumsum([part.size for part in ideal])[:-1]
    return [
        piece.reshape(part.shape) for piece, part in zip(np.split(marked, ends), ideal, strict=True)
    ]
