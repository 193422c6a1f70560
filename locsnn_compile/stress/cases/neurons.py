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
from locsnn_compile.stress.cases import case as usual
from locsnn_compile.stress.cases.case import Case, case_of, lif, lif_case, srm, srm_cases, weights

STEPS_OF_TAU = (0.5, 1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 2000, 5000, 8000, 10_000)
SHORT, LONG, FROM = 200, 2000, 200
"""Steps of a recording, short and long; long for time constants from this many steps."""
KEEPS_ALL, FORGETS = DECAYS
ENDS = (KEEPS_ALL, KEEPS_ALL + 1, FORGETS - 1, FORGETS)
THRESHOLD = 400
PARTS = (1, 2, 3, 4, 7)
"""Spikes that add up to a threshold."""
RULES: tuple[Rule, ...] = (">", ">=")
LIMIT = 4090.0
"""In thresholds: about the largest bias that leaves a threshold mantissa of 1."""
EXTREMES: dict[str, dict[str, dict[str, Any]]] = yaml_table(__package__, "extremes.yaml")
"""What is changed, by neuron and by name of the case."""


def time_constants() -> Iterator[Case]:
    """Time constants from half a step to more than a decay holds. The decay nearest to `exp(-1 / tau)` is within 1/8192
    of it, so long time constants are coarse: at 1,000 steps the decay has 3 bits. From about 2,000 steps the alpha
    kernel gains so much that all weights are below the smallest charge.
    """
    for tau in STEPS_OF_TAU:
        played = usual.random_input(LONG if tau >= FROM else SHORT, samples=1)
        given, leaky = weights(tau), weights(tau, response="leak")
        yield from srm_cases(f"tau_sr {tau:g}", srm(tau_sr=tau), given, played=played, x=tau)
        yield lif_case(f"leak of {tau:g} steps", lif(tau), leaky, played=played, x=tau)
        both = lif(tau, decay_u=-np.expm1(-1 / tau))
        yield lif_case(f"leak and current of {tau:g}", both, given / tau**0.5, played=played)


def refractory_time_constants() -> Iterator[Case]:
    """The kernel of a neuron's own spikes. `dendrite` has any time constant that a decay holds, `delay-line` any that
    63 steps of delay hold, and `reset` has no such kernel.
    """
    for tau in STEPS_OF_TAU:
        yield from srm_cases(f"tau_ref {tau:g}", srm(tau_ref=tau))


def decays() -> Iterator[Case]:
    """Networks that are already integers, so all of the error is truncation. A decay that keeps all
    or nothing cuts nothing."""
    mantissa = np.random.default_rng(usual.SEED).integers(-90, 120, (usual.NEURONS, usual.CHANNELS))
    for decay_u, decay_v in product(ENDS, ENDS):
        neuron = ChipCuba.of(usual.NEURONS, decay_u=decay_u, decay_v=decay_v, threshold=THRESHOLD)
        yield case_of(f"decay_u {decay_u}, decay_v {decay_v}", NATIVE, neuron, mantissa)
    for decay, own in zip(ENDS, reversed(ENDS), strict=True):
        dendrite = ChipSrm.with_taps(
            usual.NEURONS,
            decay=decay,
            threshold=THRESHOLD,
            refractory_decay=own,
            mantissa=-200,
            exponent=1,
        )
        yield case_of(f"decays {decay}, refractory {own}", "dendrite", dendrite, mantissa)
        taps = ChipSrm.with_taps(
            usual.NEURONS,
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
    one, two = (usual.random_input(channels=channels) for channels in (1, 2))
    for rule in RULES:
        for parts in PARTS:
            name, neuron = (
                "one spike" if parts == 1 else f"{parts} spikes",
                lif(size=1, decay_v=0.0, rule=rule),
            )
            yield lif_case(
                f"integrator, {name}, rule {rule}", neuron, [[usual.THETA / parts]], played=one
            )
        neuron, given = (
            lif(size=1, decay_v=1.0, rule=rule),
            [[0.25 * usual.THETA, 0.75 * usual.THETA]],
        )
        yield lif_case(f"memoryless, 1/4 and 3/4, rule {rule}", neuron, given, played=two)
    # Single spikes, so far apart that the kernel of one ends before the next.
    apart = np.zeros_like(one)
    apart[:, 0 : usual.STEPS : usual.STEPS // 2] = 1
    for strategy, tau in product(USUAL, (1.0, 10.0)):
        yield case_of(
            f"peak of a kernel of {tau:g}", strategy, srm(tau_sr=tau), [[usual.THETA]], apart
        )
    for over, word in ((0, "at"), (1, "a unit above")):
        memoryless = ChipCuba.of(
            1, decay_u=FORGETS, decay_v=FORGETS, threshold=100, bias_mantissa=over
        )
        yield case_of(f"integers, {word} it", NATIVE, memoryless, [[100]], one)
    memoryless_srm = ChipSrm.with_taps(
        1, decay=FORGETS, threshold=100, refractory_decay=FORGETS, mantissa=-1, exponent=0
    )
    yield case_of("integers, at it", "dendrite", memoryless_srm, [[100]], one)


def refractory_counts() -> Iterator[Case]:
    """Steps for which a neuron is held after a spike: the chip counts to 63."""
    for steps in (0, 1, 2, 63, 64, 10**12):
        yield lif_case(f"count {steps}", lif(refractory=steps), weights(response="leak") * 3)
    for scale in (5.0, 10.0, 100.0):
        yield case_of(f"scale_ref {scale:g}", "reset", srm(scale_ref=scale), weights() * 3)


def biases() -> Iterator[Case]:
    """A bias below half a unit of the register is lost, and one above 4,095 thresholds is refused."""
    one = usual.random_input(channels=1)
    for bias in (1e-9, 1e-6, 1e-3, 0.05, 1.0, 100.0, LIMIT, LIMIT + 10, -0.05, -100.0, -LIMIT):
        yield lif_case(f"bias {bias:g} thresholds", lif(bias=bias * usual.THETA))
    alone = lif(bias=0.2 * usual.THETA, decay_v=0.0)
    yield lif_case("bias alone, nothing fades", alone, np.zeros((usual.NEURONS, 1)), played=one)
    for mantissa, exponent in ((-4096, 7), (4095, 7), (4095, 0), (4096, 0), (-4097, 0), (1, 8)):
        neuron = ChipCuba.of(
            usual.NEURONS,
            decay_u=FORGETS,
            decay_v=410,
            threshold=8000,
            bias_mantissa=mantissa,
            bias_exponent=exponent,
        )
        name, given = f"mantissa {mantissa}, exponent {exponent}", np.full((usual.NEURONS, 1), 255)
        yield case_of(name, NATIVE, neuron, given, one)


def float_extremes() -> Iterator[Case]:
    """Denormal numbers, infinity and nan are refused, or counted as lost; nothing turns into nan."""
    for name, change in EXTREMES["srm"].items():
        neuron = replace(srm(), **change)
        scaled = weights() * (neuron.theta / usual.THETA if 1e-200 < neuron.theta < 1e200 else 1.0)
        yield from srm_cases(name, neuron, scaled)
    for name, change in EXTREMES["lif"].items():
        given = weights(response="leak") * change.get("weights times", 1.0)
        for which, first in (("weights", 0), ("weights but the first", 1)):
            if which in change:
                given[:, first:] = change[which]
        integrator = lif(
            **{key: value for key, value in change.items() if not key.startswith("weights")}
        )
        yield lif_case(name, integrator, given)
