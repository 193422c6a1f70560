"""Weights that are alike, that are not, and that are none."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from locsnn_compile.network.neurons import FloatArray
from locsnn_compile.stress.cases.case import CHANNELS, NEURONS, THETA, Case, lif_case, srm_cases, weights


def weight_shapes() -> Iterator[Case]:
    """Each with every strategy."""
    group = "shapes of weights"
    for name, given in _shapes().items():
        yield from srm_cases(group, name, given=given, quick=True)
        yield lif_case(group, name, given=given, quick=name == "one, of all")


def _shapes() -> dict[str, FloatArray]:
    shape, drawn = (NEURONS, CHANNELS), weights()
    lonely, uneven = np.zeros(shape), drawn.copy()
    lonely[0, 0] = THETA
    uneven[0, 0] = 1000 * THETA
    return {
        "all equal": np.full(shape, 0.1 * THETA),
        "all zero": np.zeros(shape),
        "one, of all": lonely,
        "one huge among small ones": uneven,
        "one neuron far heavier": drawn * np.array([1000.0, 1.0, 1.0, 1.0])[:, None],
        "all negative": -np.abs(drawn),
        "negative zeros": np.full(shape, -0.0),
    }
