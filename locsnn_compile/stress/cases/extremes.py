"""Floats at the ends of what there is: denormal, huge, and not numbers at all."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from locsnn_compile.network.neurons import Cuba, FloatArray, SrmAlpha
from locsnn_compile.stress.cases.case import CHANNELS, NEURONS, THETA, Case, lif, lif_case, srm, srm_cases, weights

LEAST, LARGEST = 5e-324, float(np.finfo(np.float64).max)
"""The smallest denormal of float64, and its largest number."""


def float_extremes() -> Iterator[Case]:
    """Numbers that a file may hold, whatever they mean."""
    for name, neuron in _neurons().items():
        scaled = weights() * (neuron.theta / THETA if 1e-200 < neuron.theta < 1e200 else 1.0)
        yield from srm_cases(name, neuron, scaled, quick=True)
    for name, (integrator, given) in _integrators().items():
        yield lif_case(name, integrator, given, quick=True)


def _neurons() -> dict[str, SrmAlpha]:
    changes: dict[str, dict[str, float]] = {
        "theta 5e-324": {"theta": LEAST},
        "theta 1e-100": {"theta": 1e-100},
        "theta 1e+100": {"theta": 1e100},
        "theta 1.8e+308": {"theta": LARGEST},
        "theta nan": {"theta": np.nan},
        "tau_sr 1e-320": {"tau_sr": 1e-320},
        "tau_sr 0.001": {"tau_sr": 1e-3},
        "tau_sr inf": {"tau_sr": np.inf},
        "tau_ref 0.001": {"tau_ref": 1e-3},
        "tau_ref 1e+300": {"tau_ref": 1e300},
        "scale_ref 0": {"scale_ref": 0.0},
        "scale_ref 5e-324": {"scale_ref": LEAST},
        "scale_ref 1e-6": {"scale_ref": 1e-6},
        "scale_ref 1e+4": {"scale_ref": 1e4},
        "scale_ref 1e+6": {"scale_ref": 1e6},
    }
    return {name: replace(srm(), **change) for name, change in changes.items()}


def _integrators() -> dict[str, tuple[Cuba, FloatArray]]:
    shape, drawn = (NEURONS, CHANNELS), weights(response="leak")
    denormal = drawn.copy()
    denormal[:, 1:] = LEAST
    return {
        "weights 5e-324": (lif(), np.full(shape, LEAST)),
        "weights 1e-310, one a neuron not": (lif(), denormal),
        "weights 1e+100": (lif(), np.full(shape, 1e100)),
        "weights 1.8e+308": (lif(), np.full(shape, LARGEST)),
        "weights and threshold 1e+100": (lif(threshold=1e100), drawn * 1e99),
        "weights inf": (lif(), np.full(shape, np.inf)),
        "weights nan": (lif(), np.full(shape, np.nan)),
        "threshold 5e-324": (lif(threshold=LEAST), drawn),
        "leak of 5e-324 a step": (lif(decay_v=LEAST), drawn),
        "leak of 1 - 1e-16": (lif(decay_v=1 - 1e-16), drawn),
        "bias 5e-324": (lif(bias=LEAST), drawn),
        "bias 1e+300": (lif(bias=1e300), drawn),
    }
