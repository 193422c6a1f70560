"""Groups of cases that vary the neuron: its time constants, decays, threshold, refractory count and bias.

A group is a function, whose docstring is the text about it on the page.
"""

from collections.abc import Iterator
from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np

from hw_model.arithmetic.loihi import DECAYS
from hw_model.texts.templates import yaml_table
from locsnn_compile.network.chip_neurons import ChipCuba, ChipSrm
from locsnn_compile.network.neurons import Rule
from locsnn_compile.settings import NATIVE, USUAL
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

STEPS_OF_TAU = (0.5, 1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 2000, 5000, 8000, 10_000)
"""Time constants in steps; the longest exceed 8192, beyond which the nearest decay on the chip is 0."""
SHORT_STEPS = 200
"""Steps of a recording for neurons of short time constants."""
LONG_STEPS = 2000
"""Steps of a recording for neurons of time constants of ``LONG_FROM`` steps or more."""
LONG_FROM = 200
KEEPS_ALL, FORGETS = DECAYS
"""The ends of the grid of decays, 0 and 4096, in 4096ths that are lost per step."""
ENDS = (KEEPS_ALL, KEEPS_ALL + 1, FORGETS - 1, FORGETS)
THRESHOLD = 400
"""A threshold mantissa, 64 units of the register each, around which the potentials of these cases vary."""
SPIKES_TO_THRESHOLD = (1, 2, 3, 4, 7)
"""Spikes that add up to a threshold."""
RULES: tuple[Rule, ...] = (">", ">=")
"""When a neuron spikes: above its threshold, or also exactly at it."""
LIMIT = 4090.0
"""In thresholds: about the largest bias, of 4,095 * 2^6, that leaves a threshold mantissa of 1."""
MEMBRANE_OF_10_STEPS = 410
"""In 4096ths: 4096 / 10, the decay of a membrane that loses a tenth per step."""
EXTREMES: dict[str, dict[str, dict[str, Any]]] = yaml_table(__package__, "extremes.yaml")
"""What is changed of the neuron or its weights, by kind of neuron and by name of the case."""


def time_constants() -> Iterator[Case]:
    """Time constants from half a step to more than a decay holds. The decay nearest to `exp(-1 / tau)` is within 1/8192
    of it, so long time constants are coarse: at 1,000 steps the decay has 3 bits. From about 2,000 steps the alpha
    kernel gains so much that all weights are below the smallest charge.
    """
    for tau in STEPS_OF_TAU:
        steps = LONG_STEPS if tau >= LONG_FROM else SHORT_STEPS
        recordings = random_input(steps, samples=1)
        weights = random_weights(tau)
        yield from srm_cases(
            f"tau_sr {tau:g}", srm(tau_sr=tau), weights, recordings=recordings, x=tau
        )
        yield lif_case(
            f"leak of {tau:g} steps",
            lif(tau),
            random_weights(tau, response="leak"),
            recordings=recordings,
            x=tau,
        )
        with_current = lif(tau, decay_u=-np.expm1(-1 / tau))
        yield lif_case(
            f"leak and current of {tau:g}", with_current, weights / tau**0.5, recordings=recordings
        )


def refractory_time_constants() -> Iterator[Case]:
    """The kernel of a neuron's own spikes. `dendrite` has any time constant that a decay holds, `delay-line` any that
    63 steps of delay hold, and `reset` has no such kernel.
    """
    for tau in STEPS_OF_TAU:
        yield from srm_cases(f"tau_ref {tau:g}", srm(tau_ref=tau))


def decays() -> Iterator[Case]:
    """Networks that are already integers, so all of the error is truncation. A decay that keeps all
    or nothing cuts nothing."""
    mantissa = np.random.default_rng(SEED).integers(-90, 120, (NEURONS, CHANNELS))
    for decay_u, decay_v in product(ENDS, ENDS):
        neuron = ChipCuba.of(NEURONS, decay_u=decay_u, decay_v=decay_v, threshold=THRESHOLD)
        yield case_of(f"decay_u {decay_u}, decay_v {decay_v}", NATIVE, neuron, mantissa)
    for decay, refractory_decay in zip(ENDS, reversed(ENDS), strict=True):
        dendrite = ChipSrm.with_taps(
            NEURONS,
            decay=decay,
            threshold=THRESHOLD,
            refractory_decay=refractory_decay,
            mantissa=-200,
            exponent=1,
        )
        yield case_of(
            f"decays {decay}, refractory {refractory_decay}", "dendrite", dendrite, mantissa
        )
        taps = ChipSrm.with_taps(
            NEURONS,
            decay=decay,
            threshold=THRESHOLD,
            delay=[0, 1, 62],
            mantissa=[-200, 100, -50],
            exponent=[1, 1, 0],
        )
        yield case_of(f"decays {decay}", "delay-line", taps, mantissa)


def exact_thresholds() -> Iterator[Case]:
    """Weights that add up to exactly the threshold. If the chip holds them without rounding, the rule, `>` or `>=`, is
    kept; otherwise the least rounding decides, and each such decision is counted.
    """
    one_channel = random_input(channels=1)
    two_channels = random_input(channels=2)
    for rule in RULES:
        integrator = lif(size=1, decay_v=0.0, rule=rule)
        for spikes in SPIKES_TO_THRESHOLD:
            words = "one spike" if spikes == 1 else f"{spikes} spikes"
            yield lif_case(
                f"integrator, {words}, rule {rule}",
                integrator,
                [[THETA / spikes]],
                recordings=one_channel,
            )
        yield lif_case(
            f"memoryless, 1/4 and 3/4, rule {rule}",
            lif(size=1, decay_v=1.0, rule=rule),
            [[0.25 * THETA, 0.75 * THETA]],
            recordings=two_channels,
        )
    # Single spikes, so far apart that the kernel of one ends before the next.
    apart = np.zeros_like(one_channel)
    apart[:, 0 : STEPS : STEPS // 2] = 1
    for strategy, tau in product(USUAL, (1.0, 10.0)):
        yield case_of(f"peak of a kernel of {tau:g}", strategy, srm(tau_sr=tau), [[THETA]], apart)
    # A weight mantissa of 100 charges 6,400 units, as much as a threshold mantissa of 100. A bias adds single units.
    for bias, words in ((0, "at"), (1, "a unit above")):
        memoryless = ChipCuba.of(
            1, decay_u=FORGETS, decay_v=FORGETS, threshold=100, bias_mantissa=bias
        )
        yield case_of(f"integers, {words} it", NATIVE, memoryless, [[100]], one_channel)
    memoryless_srm = ChipSrm.with_taps(
        1, decay=FORGETS, threshold=100, refractory_decay=FORGETS, mantissa=-1, exponent=0
    )
    yield case_of("integers, at it", "dendrite", memoryless_srm, [[100]], one_channel)


def refractory_counts() -> Iterator[Case]:
    """Steps for which a neuron is held after a spike: the chip counts to 63."""
    for steps in (0, 1, 2, 63, 64, 10**12):
        yield lif_case(f"count {steps}", lif(refractory=steps), random_weights(response="leak") * 3)
    for scale in (5.0, 10.0, 100.0):
        yield case_of(f"scale_ref {scale:g}", "reset", srm(scale_ref=scale), random_weights() * 3)


def biases() -> Iterator[Case]:
    """A bias below half a unit of the register is lost, and one above 4,095 thresholds is refused."""
    one_channel = random_input(channels=1)
    for bias in (1e-9, 1e-6, 1e-3, 0.05, 1.0, 100.0, LIMIT, LIMIT + 10, -0.05, -100.0, -LIMIT):
        yield lif_case(f"bias {bias:g} thresholds", lif(bias=bias * THETA))
    alone = lif(bias=0.2 * THETA, decay_v=0.0)
    yield lif_case(
        "bias alone, nothing fades", alone, np.zeros((NEURONS, 1)), recordings=one_channel
    )
    for mantissa, exponent in ((-4096, 7), (4095, 7), (4095, 0), (4096, 0), (-4097, 0), (1, 8)):
        neuron = ChipCuba.of(
            NEURONS,
            decay_u=FORGETS,
            decay_v=MEMBRANE_OF_10_STEPS,
            threshold=8000,
            bias_mantissa=mantissa,
            bias_exponent=exponent,
        )
        name = f"mantissa {mantissa}, exponent {exponent}"
        largest = np.full((NEURONS, 1), 255)
        yield case_of(name, NATIVE, neuron, largest, one_channel)


def float_extremes() -> Iterator[Case]:
    """Denormal numbers, infinity and nan are refused, or counted as lost; nothing turns into nan."""
    for name, change in EXTREMES["srm"].items():
        neuron = replace(srm(), **change)
        # Weights keep their ratio to the threshold, as far as their products are finite.
        is_moderate = 1e-200 < neuron.theta < 1e200
        factor = neuron.theta / THETA if is_moderate else 1.0
        yield from srm_cases(name, neuron, random_weights() * factor)
    for name, change in EXTREMES["lif"].items():
        weights = random_weights(response="leak") * change.get("weights times", 1.0)
        if "weights" in change:
            weights[:] = change["weights"]
        if "weights but the first" in change:
            weights[:, 1:] = change["weights but the first"]
        of_neuron = {key: value for key, value in change.items() if not key.startswith("weights")}
        yield lif_case(name, lif(**of_neuron), weights)
