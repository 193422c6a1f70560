"""Groups of cases that vary what reaches a neuron: weights and their rounding, delays, and inputs up to crowds.

A group is a function, whose docstring is the text about it on the page.
"""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from hw_model.arithmetic.fixed_point import WEIGHT_BITS, WEIGHT_EXPONENTS
from hw_model.arithmetic.loihi import FORGETS
from locsnn_compile.network.chip_neurons import ChipCuba, ChipNeuron, ChipSrm
from locsnn_compile.network.projections import Signs
from locsnn_compile.passes.rounding.task import FINE, NEAREST, Rounding
from locsnn_compile.settings import NATIVE
from locsnn_compile.stress.cases.case import (
    CHANNELS,
    NEURONS,
    SEED,
    STEPS,
    THETA,
    Case,
    case_of,
    lif,
    lif_case,
    random_input,
    random_weights,
    srm,
    srm_cases,
)

DECADES = range(-6, 7)
"""Powers of ten by which weights or thresholds are scaled."""
DELAYS = (0, 1, 61, 62, 63, 10**9)
"""In steps, around 62, the longest of a synapse: 64 accumulator slots less two."""
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
"""In steps: that of the published neuron, and one ten times as long."""
LARGEST_MANTISSA = 255
"""Of weights of 8 bits whose signs are apart."""
MEMBRANE_OF_10_STEPS = 410
"""In 4096ths: 4096 / 10, the decay of a membrane that loses a tenth per step."""
CROWD = 4096
"""Input axons of a core; a neuron with a self-synapse needs one for itself."""


def one_scale_for_all() -> Iterator[Case]:
    """Thresholds and weights scaled together by twelve orders of magnitude give equal integers: only ratios reach the
    chip.
    """
    for decade in DECADES[::3]:
        factor = 10.0**decade
        name = f"both times 1e{decade:+d}"
        yield from srm_cases(name, srm(theta=THETA * factor), random_weights() * factor)
        leaky_weights = random_weights(response="leak") * factor
        yield lif_case(name, lif(threshold=THETA * factor), leaky_weights)


def weights_against_thresholds() -> Iterator[Case]:
    """Weights over twelve orders of magnitude with one threshold. At the lower end they round to 0; at the upper end
    the charge of a single step fills its register.
    """
    for decade in DECADES:
        factor = 10.0**decade
        name = f"weights times 1e{decade:+d}"
        yield from srm_cases(name, weights=random_weights() * factor, x=factor)
        yield lif_case(name, weights=random_weights(response="leak") * factor, x=factor)


def weight_shapes() -> Iterator[Case]:
    """One exponent serves a population, so one huge weight costs all others their bits."""
    shape = (NEURONS, CHANNELS)
    usual = random_weights()
    only_one = np.zeros(shape)
    only_one[0, 0] = THETA
    one_huge = usual.copy()
    one_huge[0, 0] = 1000 * THETA
    first_neuron_heavier = usual * np.array([1000.0, 1.0, 1.0, 1.0])[:, None]
    for name, weights in (
        ("all equal", np.full(shape, 0.1 * THETA)),
        ("all zero", np.zeros(shape)),
        ("one, of all", only_one),
        ("one huge among small ones", one_huge),
        ("one neuron far heavier", first_neuron_heavier),
        ("all negative", -np.abs(usual)),
        ("negative zeros", np.full(shape, -0.0)),
    ):
        yield from srm_cases(name, weights=weights)
        yield lif_case(name, weights=weights)


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
                f"{name}, tau_sr {tau:g}", srm(tau_sr=tau), random_weights(tau), rounding=rounding
            )
        yield lif_case(name, rounding=rounding)


def weight_exponents() -> Iterator[Case]:
    """Integer weights at the ends of their grid; the threshold grows with the exponent. A negative exponent removes low
    bits, and all bits of the smallest weights.
    """
    ends: dict[Signs, tuple[int, ...]] = {"apart": (-255, -1, 1, 255), "mixed": (-256, -2, 2, 254)}
    for signs, mantissas in ends.items():
        mantissa = np.random.default_rng(SEED).choice(mantissas, (NEURONS, CHANNELS))
        stride = 1 if signs == "mixed" else 5  # every exponent, or only some, to save time
        for exponent in WEIGHT_EXPONENTS[::stride]:
            neuron = ChipCuba.of(
                NEURONS,
                decay_u=FORGETS,
                decay_v=MEMBRANE_OF_10_STEPS,
                threshold=max(1, int(LARGEST_MANTISSA * 2.0**exponent)),
            )
            name = f"exponent {exponent}, signs {signs}"
            yield case_of(name, NATIVE, neuron, mantissa, exponent=exponent, signs=signs)


def delays() -> Iterator[Case]:
    """Delays of up to 62 steps, and longer ones, which are refused."""
    for delay in DELAYS:
        yield case_of(f"delay {delay}", "dendrite", srm(), random_weights(), delay=delay)
        yield lif_case(f"delay {delay}", delay=delay)
    each_its_own = np.random.default_rng(SEED).integers(0, 62, (NEURONS, CHANNELS), endpoint=True)
    yield lif_case("delays 0 to 62, each its own", delay=each_its_own)


def input_patterns() -> Iterator[Case]:
    """Silence, single spikes, alternating spikes, bursts, and every line in every step, for the published neuron."""
    none = np.zeros((1, STEPS, CHANNELS), dtype=np.uint8)
    once = none.copy()
    once[0, 0, 0] = 1
    in_turn = np.eye(CHANNELS, dtype=np.uint8)[np.arange(STEPS) % CHANNELS][None]
    alternating = none.copy()
    alternating[0, ::2] = 1
    bursts = none.copy()
    is_in_burst = np.arange(STEPS) % 50 < 10
    bursts[0, is_in_burst] = 1
    for name, recordings in (
        ("none", none),
        ("one spike", once),
        ("one per channel, in turn", in_turn),
        ("alternating", alternating),
        ("bursts", bursts),
        ("every step", np.ones_like(none)),
        ("random", random_input()),
    ):
        yield from srm_cases(name, recordings=recordings)
        yield lif_case(name, recordings=recordings)


def crowds() -> Iterator[Case]:
    """All the inputs of a core with the largest possible weights in every step: the charge of one step wraps, and every
    wrap is counted.
    """
    neuron = ChipCuba.of(
        1, decay_u=MEMBRANE_OF_10_STEPS, decay_v=MEMBRANE_OF_10_STEPS, threshold=1000
    )
    # The published time constants in 4096ths: 4096 * (1 - exp(-1 / 10)) and 4096 * (1 - exp(-1 / 1)).
    dendrite = ChipSrm.with_taps(
        1, decay=390, threshold=8000, refractory_decay=2589, mantissa=-250, exponent=6
    )
    for weight, word in ((LARGEST_MANTISSA, "excite"), (-LARGEST_MANTISSA, "inhibit")):
        for exponent in (0, 7):
            words = f" {word}, exponent {exponent}"
            yield _crowd(words, NATIVE, neuron, CROWD, weight, exponent)
            yield _crowd(words, "dendrite", dendrite, CROWD - 1, weight, exponent)
    # One more than fits next to the self-synapse of the dendrite: it is refused.
    yield _crowd("", "dendrite", dendrite, CROWD, LARGEST_MANTISSA)


def _crowd(
    words: str, strategy: str, neuron: ChipNeuron, lines: int, weight: int, exponent: int = 0
) -> Case:
    """Return one neuron behind ``lines`` inputs of one weight, all of which spike in each of 20 steps."""
    weights = np.full((1, lines), weight)
    recordings = np.ones((1, 20, lines), dtype=np.uint8)
    name = f"{lines} inputs{words}"
    return case_of(name, strategy, neuron, weights, recordings, exponent=exponent)
