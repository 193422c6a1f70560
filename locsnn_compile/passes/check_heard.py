"""Refuse a population of which the chip would hear nothing, though the float network does.

Weights that round to 0 are counted, and a population can lose most of them. One that loses them all is silent on the
chip; where a single input could have made it spike, that is another network.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from locsnn_compile.errors import TargetError
from locsnn_compile.network.chip_neurons import ChipProjection
from locsnn_compile.network.matrices import row_maxima, values_of
from locsnn_compile.network.network import Population, Projection
from locsnn_compile.network.neurons import Cuba, FloatArray, SoftCuba, SrmAlpha
from locsnn_compile.passes.kernels import kernel


def check_heard(
    population: Population,
    neuron: SrmAlpha | Cuba | SoftCuba,
    incoming: Iterable[Projection],
    rounded: Iterable[ChipProjection],
    steps: int,
) -> None:
    """Check the weights onto a population beside what they were rounded to; ``steps`` of a recording."""
    if any(values_of(p.mantissa).any() for p in rounded):
        return
    largest = np.max([np.zeros(population.size), *(row_maxima(p.weights) for p in incoming)], axis=0)
    reached = float((largest * _answer(neuron, steps)).max())
    if reached >= 1:
        raise TargetError(
            f"population {population.name!r}",
            "every weight rounds to 0, so it would hear nothing",
            measured=f"one input that spikes in every step could reach {reached:.3g} thresholds",
            fix=_way_out(neuron),
        )


def _answer(neuron: SrmAlpha | Cuba | SoftCuba, steps: int) -> FloatArray:
    """Return how many thresholds a weight of 1 adds up to, (n,) or (), if its source spikes in every step.

    Of integrators at most: a register adds a steady input up to less than 1 / decay, and to less than its steps.
    """
    if isinstance(neuron, SrmAlpha):
        return np.array(kernel(neuron.tau_sr, np.arange(1.0, steps)).sum() / neuron.theta)
    with np.errstate(divide="ignore"):
        u, v = (np.minimum(1.0 / lost, steps) for lost in (neuron.decay_u, neuron.decay_v))
    answer: FloatArray = u * v / neuron.threshold
    return answer


def _way_out(neuron: SrmAlpha | Cuba | SoftCuba) -> str:
    if isinstance(neuron, SrmAlpha):
        return "Use larger weights, a shorter tau_sr, or a smaller scale_ref."
    return "Use larger weights, or smaller biases."
