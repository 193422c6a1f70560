"""What decides a spike next to weights: the rule at the threshold, refractory counts and biases."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product

import numpy as np

from hw_model.engine.trace import ByteArray
from locsnn_compile.network.chip_neurons import ChipCuba, ChipSrm
from locsnn_compile.network.neurons import Rule
from locsnn_compile.strategies import NATIVE, USUAL
from locsnn_compile.stress.cases.case import (
    NEURONS,
    STEPS,
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

PARTS = (1, 2, 3, 4, 7)
"""A threshold in so many spikes."""
RULES: tuple[Rule, ...] = (">", ">=")
LIMIT = 4090.0
"""Thresholds: about the largest bias beside which a threshold mantissa of 1 is left."""


def exact_thresholds() -> Iterator[Case]:
    """Weights that add up to the threshold, in float and in the chip's integers."""
    one = random_input(channels=1)
    for rule in RULES:
        for parts in PARTS:
            name, neuron = f"integrator, {_spikes(parts)}, rule {rule}", lif(size=1, decay_v=0.0, rule=rule)
            yield lif_case(name, neuron, [[THETA / parts]], one, quick=parts == 3)
        name, neuron = f"memoryless, 1/4 and 3/4, rule {rule}", lif(size=1, decay_v=1.0, rule=rule)
        yield lif_case(name, neuron, [[0.25 * THETA, 0.75 * THETA]], random_input(channels=2))
    for strategy, tau in product(USUAL, (1.0, 10.0)):
        name, quick = f"peak of a kernel of {tau:g}", strategy == "dendrite"
        yield case_of(name, strategy, srm(tau_sr=tau), [[THETA]], _apart(one), quick=quick)
    for over, word in ((0, "at"), (1, "a unit above")):
        memoryless = ChipCuba.of(
            1, decay_u=4096, decay_v=4096, threshold=100, bias_mantissa=over, bias_exponent=0, refractory=1
        )
        network = chip_network(memoryless, [[100]])
        yield Case(f"integers, {word} it", NATIVE, network, one, quick=True)
    memoryless_srm = ChipSrm.with_dendrite(
        1, decay=4096, threshold=100, refractory_decay=4096, refractory_mantissa=-1, refractory_exponent=0
    )
    yield Case("integers, at it", "dendrite", chip_network(memoryless_srm, [[100]]), one)


def _spikes(parts: int) -> str:
    return "one spike" if parts == 1 else f"{parts} spikes"


def _apart(played: ByteArray) -> ByteArray:
    """Return single spikes so far apart that the kernel of one is over before the next."""
    alone = np.zeros_like(played)
    alone[:, 0 : STEPS : STEPS // 2] = 1
    return alone


def refractory_counts() -> Iterator[Case]:
    """Steps without a spike from none to all that the chip counts, and past them."""
    for steps in (0, 1, 2, 63, 64, 10**12):
        neuron, given = lif(refractory=steps), weights(response="leak") * 3
        yield lif_case(f"count {steps}", neuron, given, quick=steps in (63, 64))
    for scale in (5.0, 10.0, 100.0):
        name = f"scale_ref {scale:g}"
        yield case_of(name, "reset", srm(scale_ref=scale), weights() * 3, quick=scale == 100)


def biases() -> Iterator[Case]:
    """From lost in rounding to more than a mantissa holds."""
    one = random_input(channels=1)
    for bias in (1e-9, 1e-6, 1e-3, 0.05, 1.0, 100.0, LIMIT, LIMIT + 10, -0.05, -100.0, -LIMIT):
        quick = bias in (1e-9, LIMIT, LIMIT + 10)
        yield lif_case(f"{bias:g} thresholds", lif(bias=bias * THETA), quick=quick)
    alone = lif(bias=0.2 * THETA, decay_v=0.0)
    yield lif_case("bias alone, nothing fades", alone, np.zeros((NEURONS, 1)), one, quick=True)
    for mantissa, exponent in ((-4096, 7), (4095, 7), (4095, 0), (4096, 0), (-4097, 0), (1, 8)):
        neuron = ChipCuba.of(
            NEURONS, decay_u=4096, decay_v=410, threshold=8000, bias_mantissa=mantissa, bias_exponent=exponent
        )
        network = chip_network(neuron, np.full((NEURONS, 1), 255))
        yield Case(f"mantissa {mantissa}, exponent {exponent}", NATIVE, network, one, quick=exponent == 8)
