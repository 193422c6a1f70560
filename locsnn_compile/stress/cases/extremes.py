"""Floats at the ends of what there is: denormal, huge, and not numbers at all."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from locsnn_compile.network.network import Network
from locsnn_compile.network.neurons import SrmAlpha
from locsnn_compile.stress.case import (
    CHANNELS,
    NATIVE,
    NEURONS,
    SRM_STRATEGIES,
    THETA,
    Case,
    float_network,
    lif,
    random_input,
    srm,
    weights,
)

LEAST, LARGEST = 5e-324, float(np.finfo(np.float64).max)
"""The smallest denormal of float64, and its largest number."""


def float_extremes() -> Iterator[Case]:
    """Numbers that a file may hold, whatever they mean."""
    group, played = "extreme floats", random_input()
    for name, neuron in _neurons().items():
        for strategy in SRM_STRATEGIES:
            scaled = weights() * (neuron.theta / THETA if 1e-200 < neuron.theta < 1e200 else 1.0)
            network = float_network(neuron, scaled)
            yield Case(group, name, strategy, network, played, quick=strategy == "dendrite")
    for name, network in _integrators().items():
        yield Case(group, name, NATIVE, network, played, quick=True)


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


def _integrators() -> dict[str, Network]:
    shape, drawn = (NEURONS, CHANNELS), weights(response="leak")
    denormal = drawn.copy()
    denormal[:, 1:] = LEAST
    return {
        "weights 5e-324": float_network(lif(), np.full(shape, LEAST)),
        "weights 1e-310, one a neuron not": float_network(lif(), denormal),
        "weights 1e+100": float_network(lif(), np.full(shape, 1e100)),
        "weights 1.8e+308": float_network(lif(), np.full(shape, LARGEST)),
        "weights and threshold 1e+100": float_network(lif(threshold=1e100), drawn * 1e99),
        "weights inf": float_network(lif(), np.full(shape, np.inf)),
        "weights nan": float_network(lif(), np.full(shape, np.nan)),
        "threshold 5e-324": float_network(lif(threshold=LEAST), drawn),
        "leak of 5e-324 a step": float_network(lif(decay_v=LEAST), drawn),
        "leak of 1 - 1e-16": float_network(lif(decay_v=1 - 1e-16), drawn),
        "bias 5e-324": float_network(lif(bias=LEAST), drawn),
        "bias 1e+300": float_network(lif(bias=1e300), drawn),
    }
