"""What a neuron is: its time constants, decays, threshold, refractory count and bias, each from end to end."""

from collections.abc import Iterator
from dataclasses import replace
from itertools import product

import numpy as np

from locsnn_compile.network.neurons import Rule
from locsnn_compile.network.quantized import ChipCuba, ChipSrm
from locsnn_compile.settings import NATIVE, USUAL
from locsnn_compile.stress.cases import case as usual
from locsnn_compile.stress.cases.case import NEURONS, THETA, Case, case_of, lif, lif_case, srm, srm_cases, weights

STEPS_OF_TAU = (0.5, 1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 2000, 5000, 8000, 10_000)
SHORT, LONG, FROM = 200, 2000, 200
"""Steps of a recording: of time constants of 200 steps and more, the longer."""
ENDS = (0, 1, 4095, 4096)
THRESHOLD = 400
PARTS = (1, 2, 3, 4, 7)
"""A threshold in so many spikes."""
RULES: tuple[Rule, ...] = (">", ">=")
LIMIT = 4090.0
"""Thresholds: about the largest bias next to which a threshold mantissa of 1 is left."""
LEAST, LARGEST = 5e-324, float(np.finfo(np.float64).max)
"""The smallest denormal of float64, and its largest number."""


def time_constants() -> Iterator[Case]:
    """From half a step to more than a decay holds. The decay nearest to `exp(-1 / tau)` is within 1/8192 of it, so long
    time constants are coarse: at 1,000 steps it has 3 bits. From about 2,000 steps the alpha kernel gains so much that
    all weights are less than the smallest charge.
    """
    for tau in STEPS_OF_TAU:
        played = usual.random_input(LONG if tau >= FROM else SHORT, samples=1)
        given, leaky = weights(tau), weights(tau, response="leak")
        yield from srm_cases(f"tau_sr {tau:g}", srm(tau_sr=tau), given, played, x=tau)
        yield lif_case(f"leak of {tau:g} steps", lif(tau), leaky, played, x=tau)
        both = lif(tau, decay_u=-np.expm1(-1 / tau))
        yield lif_case(f"leak and current of {tau:g}", both, given / tau**0.5, played)


def refractory_time_constants() -> Iterator[Case]:
    """The kernel of the neuron's own spikes. `dendrite` takes what a decay holds, `delay-line` what 63 steps of delay
    hold, and `reset` has none.
    """
    for tau in STEPS_OF_TAU:
        yield from srm_cases(f"tau_ref {tau:g}", srm(tau_ref=tau))


def decays() -> Iterator[Case]:
    """Networks that are integers already: all of the error is truncation. A decay of 0 or 4096 cuts nothing."""
    mantissa = np.random.default_rng(usual.SEED).integers(-90, 120, (NEURONS, usual.CHANNELS))
    for decay_u, decay_v in product(ENDS, ENDS):
        neuron = ChipCuba.of(NEURONS, decay_u=decay_u, decay_v=decay_v, threshold=THRESHOLD)
        yield case_of(f"decay_u {decay_u}, decay_v {decay_v}", NATIVE, neuron, mantissa)
    for decay, own in ((0, 4096), (1, 4095), (4095, 1), (4096, 0)):
        dendrite = ChipSrm.with_taps(
            NEURONS,
            decay=decay,
            threshold=THRESHOLD,
            refractory_decay=own,
            mantissa=-200,
            exponent=1,
        )
        yield case_of(f"decays {decay}, refractory {own}", "dendrite", dendrite, mantissa)
        taps = ChipSrm.with_taps(
            NEURONS, decay=decay, threshold=THRESHOLD, delay=[0, 1, 62], mantissa=[-200, 100, -50], exponent=[1, 1, 0]
        )
        yield case_of(f"decays {decay}", "delay-line", taps, mantissa)


def exact_thresholds() -> Iterator[Case]:
    """Weights that add up to the threshold exactly. Where the chip holds them without rounding the rule, `>` or `>=`,
    is kept; elsewhere the least rounding decides, and each such decision is counted.
    """
    one, two = (usual.random_input(channels=channels) for channels in (1, 2))
    for rule in RULES:
        for parts in PARTS:
            name, neuron = "one spike" if parts == 1 else f"{parts} spikes", lif(size=1, decay_v=0.0, rule=rule)
            yield lif_case(f"integrator, {name}, rule {rule}", neuron, [[THETA / parts]], one)
        neuron = lif(size=1, decay_v=1.0, rule=rule)
        yield lif_case(f"memoryless, 1/4 and 3/4, rule {rule}", neuron, [[0.25 * THETA, 0.75 * THETA]], two)
    # Single spikes so far apart that the kernel of one is over before the next.
    apart = np.zeros_like(one)
    apart[:, 0 : usual.STEPS : usual.STEPS // 2] = 1
    for strategy, tau in product(USUAL, (1.0, 10.0)):
        yield case_of(f"peak of a kernel of {tau:g}", strategy, srm(tau_sr=tau), [[THETA]], apart)
    for over, word in ((0, "at"), (1, "a unit above")):
        memoryless = ChipCuba.of(1, decay_u=4096, decay_v=4096, threshold=100, bias_mantissa=over)
        yield case_of(f"integers, {word} it", NATIVE, memoryless, [[100]], one)
    memoryless_srm = ChipSrm.with_taps(1, decay=4096, threshold=100, refractory_decay=4096, mantissa=-1, exponent=0)
    yield case_of("integers, at it", "dendrite", memoryless_srm, [[100]], one)


def refractory_counts() -> Iterator[Case]:
    """Steps that a neuron is held after a spike: the chip counts to 63."""
    for steps in (0, 1, 2, 63, 64, 10**12):
        yield lif_case(f"count {steps}", lif(refractory=steps), weights(response="leak") * 3)
    for scale in (5.0, 10.0, 100.0):
        yield case_of(f"scale_ref {scale:g}", "reset", srm(scale_ref=scale), weights() * 3)


def biases() -> Iterator[Case]:
    """A bias of less than half a unit of the register is lost, and one of more than 4,095 thresholds is refused."""
    one = usual.random_input(channels=1)
    for bias in (1e-9, 1e-6, 1e-3, 0.05, 1.0, 100.0, LIMIT, LIMIT + 10, -0.05, -100.0, -LIMIT):
        yield lif_case(f"{bias:g} thresholds", lif(bias=bias * THETA))
    alone = lif(bias=0.2 * THETA, decay_v=0.0)
    yield lif_case("bias alone, nothing fades", alone, np.zeros((NEURONS, 1)), one)
    for mantissa, exponent in ((-4096, 7), (4095, 7), (4095, 0), (4096, 0), (-4097, 0), (1, 8)):
        neuron = ChipCuba.of(
            NEURONS, decay_u=4096, decay_v=410, threshold=8000, bias_mantissa=mantissa, bias_exponent=exponent
        )
        name, given = f"mantissa {mantissa}, exponent {exponent}", np.full((NEURONS, 1), 255)
        yield case_of(name, NATIVE, neuron, given, one)


def float_extremes() -> Iterator[Case]:
    """Denormal, infinite, not a number: refused, or counted as lost; nothing turns into nan."""
    for name, change in _SRM_EXTREMES.items():
        neuron = replace(srm(), **change)
        scaled = weights() * (neuron.theta / THETA if 1e-200 < neuron.theta < 1e200 else 1.0)
        yield from srm_cases(name, neuron, scaled)
    shape, drawn = (NEURONS, usual.CHANNELS), weights(response="leak")
    denormal = drawn.copy()
    denormal[:, 1:] = LEAST
    for name, integrator, given in (
        ("weights 5e-324", lif(), np.full(shape, LEAST)),
        ("weights 1e-310, one a neuron not", lif(), denormal),
        ("weights 1e+100", lif(), np.full(shape, 1e100)),
        ("weights 1.8e+308", lif(), np.full(shape, LARGEST)),
        ("weights and threshold 1e+100", lif(threshold=1e100), drawn * 1e99),
        ("weights inf", lif(), np.full(shape, np.inf)),
        ("weights nan", lif(), np.full(shape, np.nan)),
        ("threshold 5e-324", lif(threshold=LEAST), drawn),
        ("leak of 5e-324 a step", lif(decay_v=LEAST), drawn),
        ("leak of 1 - 1e-16", lif(decay_v=1 - 1e-16), drawn),
        ("bias 5e-324", lif(bias=LEAST), drawn),
        ("bias 1e+300", lif(bias=1e300), drawn),
    ):
        yield lif_case(name, integrator, given)


_SRM_EXTREMES: dict[str, dict[str, float]] = {
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
