"""Weights: their magnitudes, their shapes, and what rounding and synapse formats make of them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from hw_model.arithmetic.weights import WEIGHT_BITS, WEIGHT_EXPONENTS
from locsnn_compile.network.chip_neurons import ChipCuba, Signs
from locsnn_compile.network.neurons import FloatArray
from locsnn_compile.passes.rounding.rounding import FINE, NEAREST, Rounding
from locsnn_compile.strategies import NATIVE
from locsnn_compile.stress.cases.case import (
    CHANNELS,
    NEURONS,
    SEED,
    THETA,
    Case,
    case_of,
    chip_network,
    lif,
    lif_case,
    random_input,
    srm,
    srm_cases,
    weights,
)

DECADES = range(-6, 7)
QUICK = (-6, 0, 6)
DELAYS = (0, 1, 61, 62, 63, 10**9)
ROUNDINGS: dict[str, Rounding] = {
    "nearest": NEAREST,
    "two decays": Rounding(fitted_decays=True),
    "several formats": Rounding(graded=True),
    "together": Rounding(error_aware=True),
    "scales apart": Rounding(scaled_apart=True),
    "all of these": FINE,
    "a quarter split": replace(FINE, split=0.25),
    "all split": replace(FINE, split=1.0),
}
TIME_CONSTANTS = (10.0, 100.0)


def one_scale_for_all() -> Iterator[Case]:
    """Threshold and weights alike: only their ratio reaches the chip."""
    for decade in DECADES[::3]:
        by, name, quick = 10.0**decade, f"both times 1e{decade:+d}", decade in QUICK
        scaled = srm(theta=THETA * by)
        yield from srm_cases(name, scaled, weights() * by, quick=quick, quick_as=("delay-line",))
        yield lif_case(name, lif(threshold=THETA * by), weights(response="leak") * by, quick=quick)


def weights_against_thresholds() -> Iterator[Case]:
    """Weights from a millionth to a million of what the threshold is made for."""
    for decade in DECADES:
        by, name, quick = 10.0**decade, f"weights times 1e{decade:+d}", decade in QUICK
        yield from srm_cases(name, given=weights() * by, x=by, quick=quick)
        yield lif_case(name, given=weights(response="leak") * by, x=by, quick=quick)


def weight_shapes() -> Iterator[Case]:
    """Each with every strategy."""
    for name, given in _shapes().items():
        yield from srm_cases(name, given=given, quick=True)
        yield lif_case(name, given=given, quick=name == "one, of all")


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


def weight_bits() -> Iterator[Case]:
    """Every width that a format has, and one that none has."""
    for bits in (*WEIGHT_BITS, 7):
        name = "1 bit" if bits == 1 else f"{bits} bits"
        yield from srm_cases(name, weight_bits=bits, quick=bits in (1, 7))
        yield lif_case(name, weight_bits=bits, quick=bits in (1, 4))


def weight_exponents() -> Iterator[Case]:
    """Integer weights of every exponent, at the ends of their grid; negative exponents lose low bits."""
    ends: dict[Signs, tuple[int, ...]] = {"apart": (-255, -1, 1, 255), "mixed": (-256, -2, 2, 254)}
    for signs, mantissas in ends.items():
        mantissa = np.random.default_rng(SEED).choice(mantissas, (NEURONS, CHANNELS))
        for exponent in WEIGHT_EXPONENTS[:: 1 if signs == "mixed" else 5]:
            neuron = ChipCuba.of(NEURONS, decay_u=4096, decay_v=410, threshold=max(1, int(255 * 2.0**exponent)))
            network = chip_network(neuron, mantissa, exponent=exponent, signs=signs)
            name = f"exponent {exponent}, signs {signs}"
            yield Case(name, NATIVE, network, random_input(), quick=exponent in (-8, 7))


def delays() -> Iterator[Case]:
    """Synaptic delays at the ends of what a format holds, and past them."""
    for delay in DELAYS:
        name, quick = f"delay {delay}", delay in (62, 63)
        yield case_of(name, "dendrite", srm(), weights(), delay=delay, quick=quick)
        yield lif_case(name, delay=delay, quick=quick)
    many = np.random.default_rng(SEED).integers(0, 63, (NEURONS, CHANNELS))
    yield lif_case("delays 0 to 62, each its own", delay=many)


def roundings() -> Iterator[Case]:
    """Each alone and all together, at a short and a long time constant."""
    for name, rounding in ROUNDINGS.items():
        for tau in TIME_CONSTANTS:
            quick = tau == 100 and name in ("nearest", "all split")
            neuron, given = srm(tau_sr=tau), weights(tau)
            yield from srm_cases(f"{name}, tau_sr {tau:g}", neuron, given, rounding=rounding, quick=quick)
        yield lif_case(name, rounding=rounding)
