"""Potentials exactly at the threshold, where the rule decides: ``>`` or ``>=``."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product

import numpy as np

from hw_model.engine.trace import ByteArray
from locsnn_compile.network.chip_neurons import ChipCuba, ChipSrm
from locsnn_compile.network.neurons import Rule
from locsnn_compile.strategies import NATIVE, USUAL
from locsnn_compile.stress.cases.case import STEPS, THETA, Case, case_of, chip_network, lif, lif_case, random_input, srm

PARTS = (1, 2, 3, 4, 7)
"""A threshold in so many spikes."""
RULES: tuple[Rule, ...] = (">", ">=")


def exact_thresholds() -> Iterator[Case]:
    """Weights that add up to the threshold, in float and in the chip's integers."""
    group, one = "potentials at the threshold", random_input(channels=1)
    for rule in RULES:
        for parts in PARTS:
            name, neuron = f"integrator, {_spikes(parts)}, rule {rule}", lif(size=1, decay_v=0.0, rule=rule)
            yield lif_case(group, name, neuron, [[THETA / parts]], one, quick=parts == 3)
        name, neuron = f"memoryless, 1/4 and 3/4, rule {rule}", lif(size=1, decay_v=1.0, rule=rule)
        yield lif_case(group, name, neuron, [[0.25 * THETA, 0.75 * THETA]], random_input(channels=2))
    for strategy, tau in product(USUAL, (1.0, 10.0)):
        name, quick = f"peak of a kernel of {tau:g}", strategy == "dendrite"
        yield case_of(group, name, strategy, srm(tau_sr=tau), [[THETA]], _apart(one), quick=quick)
    for over, word in ((0, "at"), (1, "a unit above")):
        memoryless = ChipCuba.of(
            1, decay_u=4096, decay_v=4096, threshold=100, bias_mantissa=over, bias_exponent=0, refractory=1
        )
        network = chip_network(memoryless, [[100]])
        yield Case(group, f"integers, {word} it", NATIVE, network, one, quick=True)
    memoryless_srm = ChipSrm.with_dendrite(
        1, decay=4096, threshold=100, refractory_decay=4096, refractory_mantissa=-1, refractory_exponent=0
    )
    yield Case(group, "integers, at it", "dendrite", chip_network(memoryless_srm, [[100]]), one)


def _spikes(parts: int) -> str:
    return "one spike" if parts == 1 else f"{parts} spikes"


def _apart(played: ByteArray) -> ByteArray:
    """Return single spikes so far apart that the kernel of one is over before the next."""
    alone = np.zeros_like(played)
    alone[:, 0 : STEPS : STEPS // 2] = 1
    return alone
