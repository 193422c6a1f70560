"""Groups of cases that vary what reaches a neuron: weights and their rounding, delays, and inputs up to crowds.

A group is a function, whose docstring is the text about it on the page.
"""

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from hw_model.arithmetic.fixed_point import WEIGHT_BITS, WEIGHT_EXPONENTS
from hw_model.arithmetic.loihi import FORGETS
from locsnn_compile.network.chip_neurons import ChipCuba, ChipNeuron, ChipSrm
from locsnn_compile.network.projections import Signs
from locsnn_compile.passes.rounding.task import FINE, NEAREST, Rounding
from locsnn_compile.settings import NATIVE
from locsnn_compile.stress.cases import case as usual
from locsnn_compile.stress.cases.case import Case, case_of, lif, lif_case, srm, srm_cases, weights

DECADES = range(-6, 7)
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
CROWD = 4096
"""Input axons of a core; a neuron with a self-synapse needs one for itself."""


def one_scale_for_all() -> Iterator[Case]:
    """Thresholds and weights scaled together by twelve orders of magnitude give equal integers: only ratios reach the
    chip.
    """
    for decade in DECADES[::3]:
        by, name = 10.0**decade, f"both times 1e{decade:+d}"
        yield from srm_cases(name, srm(theta=usual.THETA * by), weights() * by)
        yield lif_case(name, lif(threshold=usual.THETA * by), weights(response="leak") * by)


def weights_against_thresholds() -> Iterator[Case]:
    """Weights over twelve orders of magnitude with one threshold. At the lower end they round to 0; at the upper end
    the charge of a single step fills its register.
    """
    for decade in DECADES:
        by, name = 10.0**decade, f"weights times 1e{decade:+d}"
        yield from srm_cases(name, given=weights() * by, x=by)
        yield lif_case(name, given=weights(response="leak") * by, x=by)


def weight_shapes() -> Iterator[Case]:
    """One exponent serves a population, so one huge weight costs all others their bits."""
    shape, drawn = (usual.NEURONS, usual.CHANNELS), weights()
    lonely, uneven = np.zeros(shape), drawn.copy()
    lonely[0, 0] = usual.THETA
    uneven[0, 0] = 1000 * usual.THETA
    for name, given in (
        ("all equal", np.full(shape, 0.1 * usual.THETA)),
        ("all zero", np.zeros(shape)),
        ("one, of all", lonely),
        ("one huge among small ones", uneven),
        ("one neuron far heavier", drawn * np.array([1000.0, 1.0, 1.0, 1.0])[:, None]),
        ("all negative", -np.abs(drawn)),
        ("negative zeros", np.full(shape, -0.0)),
    ):
        yield from srm_cases(name, given=given)
        yield lif_case(name, given=given)


def weight_bits() -> Iterator[Case]:
    """Every width of a synapse format, and 7, which none has."""
    for bits in (*WEIGHT_BITS, 7):
        name = "1 bit" if bits == 1 else f"{bits} bits"
        yield from srm_cases(name, weight_bits=bits)
        yield lif_case(name, weight_bits=bits)


def roundings() -> Iterator[Case]:
    """Each step beyond rounding to the nearest, alone and all together. The other groups use all of them but splitting,
    as `locsnn-compile` does. Weights are rounded for recordings that are not played here.
    """
    for name, rounding in ROUNDINGS.items():
        for tau in TIME_CONSTANTS:
            yield from srm_cases(
                f"{name}, tau_sr {tau:g}", srm(tau_sr=tau), weights(tau), rounding=rounding
            )
        yield lif_case(name, rounding=rounding)


def weight_exponents() -> Iterator[Case]:
    """Integer weights at the ends of their grid; the threshold grows with the exponent. A negative exponent removes low
    bits, and all bits of the smallest weights.
    """
    ends: dict[Signs, tuple[int, ...]] = {"apart": (-255, -1, 1, 255), "mixed": (-256, -2, 2, 254)}
    for signs, mantissas in ends.items():
        mantissa = np.random.default_rng(usual.SEED).choice(
            mantissas, (usual.NEURONS, usual.CHANNELS)
        )
        for exponent in WEIGHT_EXPONENTS[:: 1 if signs == "mixed" else 5]:
            neuron = ChipCuba.of(
                usual.NEURONS,
                decay_u=FORGETS,
                decay_v=410,
                threshold=max(1, int(255 * 2.0**exponent)),
            )
            name = f"exponent {exponent}, signs {signs}"
            yield case_of(name, NATIVE, neuron, mantissa, exponent=exponent, signs=signs)


def delays() -> Iterator[Case]:
    """Delays of up to 62 steps, and longer ones, which are refused."""
    for delay in DELAYS:
        yield case_of(f"delay {delay}", "dendrite", srm(), weights(), delay=delay)
        yield lif_case(f"delay {delay}", delay=delay)
    many = np.random.default_rng(usual.SEED).integers(0, 63, (usual.NEURONS, usual.CHANNELS))
    yield lif_case("delays 0 to 62, each its own", delay=many)


def input_patterns() -> Iterator[Case]:
    """Silence, single spikes, alternating spikes, bursts, and every line in every step, for the published neuron."""
    none = np.zeros((1, usual.STEPS, usual.CHANNELS), dtype=np.uint8)
    once, alternating, bursts = none.copy(), none.copy(), none.copy()
    once[0, 0, 0] = 1
    alternating[0, ::2] = 1
    bursts[0, np.arange(usual.STEPS) % 50 < 10] = 1
    for name, played in (
        ("none", none),
        ("one spike", once),
        (
            "one per channel, in turn",
            np.eye(usual.CHANNELS, dtype=np.uint8)[np.arange(usual.STEPS) % usual.CHANNELS][None],
        ),
        ("alternating", alternating),
        ("bursts", bursts),
        ("every step", np.ones_like(none)),
        ("random", usual.random_input()),
    ):
        yield from srm_cases(name, played=played)
        yield lif_case(name, played=played)


def crowds() -> Iterator[Case]:
    """All the inputs of a core with the largest possible weights in every step: the charge of one step wraps, and every
    wrap is counted.
    """
    neuron = ChipCuba.of(1, decay_u=410, decay_v=410, threshold=1000)
    dendrite = ChipSrm.with_taps(
        1, decay=390, threshold=8000, refractory_decay=2589, mantissa=-250, exponent=6
    )

    def crowd(
        name: str, strategy: str, model: ChipNeuron, lines: int, weight: int, **more: Any
    ) -> Case:
        every = np.ones((1, 20, lines), dtype=np.uint8)
        return case_of(
            f"{lines} inputs{name}", strategy, model, np.full((1, lines), weight), every, **more
        )

    for sign, word in ((1, "excite"), (-1, "inhibit")):
        for exponent in (0, 7):
            name = f" {word}, exponent {exponent}"
            yield crowd(name, NATIVE, neuron, CROWD, sign * 255, exponent=exponent)
            yield crowd(name, "dendrite", dendrite, CROWD - 1, sign * 255, exponent=exponent)
    yield crowd("", "dendrite", dendrite, CROWD, 255)
