"""Refractory counts and biases at their limits."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from locsnn_compile.network.chip_neurons import ChipCuba
from locsnn_compile.strategies import NATIVE
from locsnn_compile.stress.cases.case import (
    NEURONS,
    THETA,
    Case,
    case_of,
    chip_network,
    lif,
    lif_case,
    random_input,
    srm,
    weights,
)

LIMIT = 4090.0
"""Thresholds: about the largest bias beside which a threshold mantissa of 1 is left."""


def refractory_counts() -> Iterator[Case]:
    """Steps without a spike from none to all that the chip counts, and past them."""
    group = "refractory counts"
    for steps in (0, 1, 2, 63, 64, 10**12):
        neuron, given = lif(refractory=steps), weights(response="leak") * 3
        yield lif_case(group, f"count {steps}", neuron, given, quick=steps in (63, 64))
    for scale in (5.0, 10.0, 100.0):
        name = f"scale_ref {scale:g}"
        yield case_of(group, name, "reset", srm(scale_ref=scale), weights() * 3, quick=scale == 100)


def biases() -> Iterator[Case]:
    """From lost in rounding to more than a mantissa holds."""
    group, one = "biases", random_input(channels=1)
    for bias in (1e-9, 1e-6, 1e-3, 0.05, 1.0, 100.0, LIMIT, LIMIT + 10, -0.05, -100.0, -LIMIT):
        quick = bias in (1e-9, LIMIT, LIMIT + 10)
        yield lif_case(group, f"{bias:g} thresholds", lif(bias=bias * THETA), quick=quick)
    alone = lif(bias=0.2 * THETA, decay_v=0.0)
    yield lif_case(group, "bias alone, nothing fades", alone, np.zeros((NEURONS, 1)), one, quick=True)
    for mantissa, exponent in ((-4096, 7), (4095, 7), (4095, 0), (4096, 0), (-4097, 0), (1, 8)):
        neuron = ChipCuba.of(
            NEURONS, decay_u=4096, decay_v=410, threshold=8000, bias_mantissa=mantissa, bias_exponent=exponent
        )
        network = chip_network(neuron, np.full((NEURONS, 1), 255))
        yield Case(group, f"mantissa {mantissa}, exponent {exponent}", NATIVE, network, one, quick=exponent == 8)
