"""What a synapse format holds: bits, exponents and delays."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from hw_model.arithmetic.weights import WEIGHT_BITS, WEIGHT_EXPONENTS
from locsnn_compile.network.chip_neurons import ChipCuba, Signs
from locsnn_compile.strategies import NATIVE
from locsnn_compile.stress.cases.case import (
    CHANNELS,
    NEURONS,
    SEED,
    Case,
    case_of,
    chip_network,
    lif_case,
    random_input,
    srm,
    srm_cases,
    weights,
)

DELAYS = (0, 1, 61, 62, 63, 10**9)


def weight_bits() -> Iterator[Case]:
    """Every width that a format has, and one that none has."""
    group = "weight bits"
    for bits in (*WEIGHT_BITS, 7):
        name = "1 bit" if bits == 1 else f"{bits} bits"
        yield from srm_cases(group, name, weight_bits=bits, quick=bits in (1, 7))
        yield lif_case(group, name, weight_bits=bits, quick=bits in (1, 4))


def weight_exponents() -> Iterator[Case]:
    """Integer weights of every exponent, at the ends of their grid; negative exponents lose low bits."""
    ends: dict[Signs, tuple[int, ...]] = {"apart": (-255, -1, 1, 255), "mixed": (-256, -2, 2, 254)}
    for signs, mantissas in ends.items():
        mantissa = np.random.default_rng(SEED).choice(mantissas, (NEURONS, CHANNELS))
        for exponent in WEIGHT_EXPONENTS[:: 1 if signs == "mixed" else 5]:
            neuron = ChipCuba.of(NEURONS, decay_u=4096, decay_v=410, threshold=max(1, int(255 * 2.0**exponent)))
            network = chip_network(neuron, mantissa, exponent=exponent, signs=signs)
            name = f"exponent {exponent}, signs {signs}"
            yield Case("weight exponents", name, NATIVE, network, random_input(), quick=exponent in (-8, 7))


def delays() -> Iterator[Case]:
    """Synaptic delays at the ends of what a format holds, and past them."""
    for delay in DELAYS:
        name, quick = f"delay {delay}", delay in (62, 63)
        yield case_of("delays", name, "dendrite", srm(), weights(), delay=delay, quick=quick)
        yield lif_case("delays", name, delay=delay, quick=quick)
    many = np.random.default_rng(SEED).integers(0, 63, (NEURONS, CHANNELS))
    yield lif_case("delays", "delays 0 to 62, each its own", delay=many)
