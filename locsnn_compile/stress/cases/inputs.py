"""Inputs from silence to every line in every step, and more of them than a register adds up."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from hw_model.engine.trace import ByteArray
from locsnn_compile.network.chip_neurons import ChipCuba, ChipSrm
from locsnn_compile.strategies import NATIVE
from locsnn_compile.stress.cases.case import CHANNELS, STEPS, Case, chip_network, lif_case, random_input, srm_cases

CROWD = 4096
"""Input axons that a core has; a neuron with a self-synapse takes one for itself."""


def input_patterns() -> Iterator[Case]:
    """What recordings may be, onto the published neuron."""
    for name, played in _patterns().items():
        yield from srm_cases(name, played=played, quick=True)
        yield lif_case(name, played=played)


def crowds() -> Iterator[Case]:
    """As many inputs as a core has, with the largest weights there are, all at once."""
    neuron = ChipCuba.of(1, decay_u=410, decay_v=410, threshold=1000)
    dendrite = ChipSrm.with_dendrite(
        1, decay=390, threshold=8000, refractory_decay=2589, refractory_mantissa=-250, refractory_exponent=6
    )
    for sign, word in ((1, "excite"), (-1, "inhibit")):
        for exponent in (0, 7):
            for model, strategy, lines in ((neuron, NATIVE, CROWD), (dendrite, "dendrite", CROWD - 1)):
                network = chip_network(model, np.full((1, lines), sign * 255), exponent=exponent, steps=20)
                every = np.ones((1, 20, lines), dtype=np.uint8)
                name = f"{lines} inputs {word}, exponent {exponent}"
                yield Case(name, strategy, network, every, quick=exponent == 7 and sign == 1)
    many = chip_network(dendrite, np.full((1, CROWD), 255), steps=20)
    yield Case(f"{CROWD} inputs", "dendrite", many, np.ones((1, 20, CROWD), dtype=np.uint8))


def _patterns() -> dict[str, ByteArray]:
    none = np.zeros((1, STEPS, CHANNELS), dtype=np.uint8)
    once, alternating, bursts = none.copy(), none.copy(), none.copy()
    once[0, 0, 0] = 1
    alternating[0, ::2] = 1
    bursts[0, np.arange(STEPS) % 50 < 10] = 1
    return {
        "none": none,
        "one spike": once,
        "one a channel, in turn": np.eye(CHANNELS, dtype=np.uint8)[np.arange(STEPS) % CHANNELS][None],
        "alternating": alternating,
        "bursts": bursts,
        "every step": np.ones_like(none),
        "random": random_input(),
    }
