"""Round weights each by itself, in formats by size."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from locsnn_compile.network.neurons import FloatArray
from locsnn_compile.network.projections import ChipProjection, of_target, values_of
from locsnn_compile.passes.rounding.grades import BoolArray, grades_for, in_grades, nearest
from locsnn_compile.passes.rounding.task import Scaled, Task


def round_apart(task: Task, scaled: Scaled) -> list[list[ChipProjection]]:
    """Round the weights onto a population to the nearest of the finest format that holds them.

    The share that is split is the coarsest one. Returns the projections that each incoming one becomes.
    """
    incoming, dendrites = task.incoming, scaled.neuron.dendrites
    ideal = [values_of(p.weights) * of_target(p.weights, scaled.gain * scaled.scale / 64) for p in incoming]
    largest = max((float(np.abs(part).max(initial=0.0)) for part in ideal), default=0.0)
    grades = grades_for(largest / dendrites, task, scaled.neuron)
    grade = [grades.grade(np.abs(part) / dendrites) for part in ideal]
    split = _coarsest(ideal, task.rounding.split)
    made = []
    for p, part, k, two in zip(incoming, ideal, grade, split, strict=True):
        step = 1 << np.where(two, grades.second_grade(k), k)
        quanta = nearest(part, step, dendrites * grades.largest_of(k))
        made.append(in_grades(p, quanta, k, two, grades, dendrites))
    return made


def _coarsest(ideal: Sequence[FloatArray], share: float) -> list[BoolArray]:
    """Mark the share of weights that are largest, over all projections."""
    if not ideal:
        return []
    flat = np.concatenate([np.abs(part).ravel() for part in ideal])
    count = round(share * int((flat > 0).sum()))
    marked = np.zeros(len(flat), dtype=np.bool_)
    marked[np.argsort(-flat, kind="stable")[:count]] = True
    ends = np.cumsum([part.size for part in ideal])[:-1]
    return [piece.reshape(part.shape) for piece, part in zip(np.split(marked, ends), ideal, strict=True)]
