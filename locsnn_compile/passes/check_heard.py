"""Refuse a population of which the chip would hear nothing, though the float network does.

Weights that round to 0 are counted, and a population can lose most of them. One that loses them all is silent on the
chip; where a single input could have made it spike, that is another network.
"""

from __future__ import annotations

from collections.abc import Iterable
from functools import singledispatch

import numpy as np

from locsnn_compile.errors import TargetError
from locsnn_compile.network.neurons import FloatArray, Leaky, Neuron, SrmAlpha
from locsnn_compile.network.projections import ChipProjection, values_of
from locsnn_compile.passes.kernels import kernel
from locsnn_compile.passes.rounding.task import Task


def check_heard(task: Task, rounded: Iterable[Iterable[ChipProjection]], steps: int) -> None:
    """Check the weights onto a population beside what they were rounded to; ``steps`` of a recording."""
    if any(values_of(p.mantissa).any() for of_one in rounded for p in of_one):
        return
    answer, fix = _answer(task.population.neuron, steps)
    reached = float((task.largest * answer).max())
    if reached >= 1:
        raise TargetError(
            task.where,
            "every weight rounds to 0, so it would hear nothing",
            measured=f"one input that spikes in every step could reach {reached:.3g} thresholds",
            fix=fix,
        )


@singledispatch
def _answer(neuron: Neuron, steps: int) -> tuple[FloatArray, str]:
    """Return how many thresholds a weight of 1 adds up to, (n,) or (), if its source spikes in every step; a way out.

    Of models that are not known it is that of one step.
    """
    return 1.0 / np.asarray(neuron.spikes_at, dtype=np.float64), "Use larger weights."


@_answer.register
def _(neuron: SrmAlpha, steps: int) -> tuple[FloatArray, str]:
    answer = np.array(kernel(neuron.tau_sr, np.arange(1.0, steps)).sum() / neuron.theta)
    return answer, "Use larger weights, a shorter tau_sr, or a smaller scale_ref."


@_answer.register
def _(neuron: Leaky, steps: int) -> tuple[FloatArray, str]:
    """At most: a register adds a steady input up to less than 1 / decay, and to less than its steps."""
    with np.errstate(divide="ignore"):
        u, v = (np.minimum(1.0 / lost, steps) for lost in (neuron.decay_u, neuron.decay_v))
    return u * v / neuron.threshold, "Use larger weights, or smaller biases."
