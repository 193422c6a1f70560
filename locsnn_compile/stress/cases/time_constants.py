"""Time constants from half a step to more than decays hold."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from locsnn_compile.stress.case import (
    NATIVE,
    SRM_STRATEGIES,
    Case,
    float_network,
    lif,
    random_input,
    srm,
    weights,
)

STEPS_OF_TAU = (0.5, 1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 2000, 5000, 8000, 10_000)
QUICK = (0.5, 10, 10_000)
SHORT, LONG, FROM = 200, 2000, 200
"""Steps of a recording: of time constants of 200 steps and more, the longer."""


def time_constants() -> Iterator[Case]:
    """The alpha kernel of the input, and the leak of integrate-and-fire neurons."""
    group = "time constants"
    for tau in STEPS_OF_TAU:
        steps = LONG if tau >= FROM else SHORT
        played, quick = random_input(steps, samples=1), tau in QUICK
        for strategy in SRM_STRATEGIES:
            network = float_network(srm(tau_sr=tau), weights(tau), steps=steps)
            yield Case(group, f"tau_sr {tau:g}", strategy, network, played, x=tau, quick=quick)
        network = float_network(lif(tau), weights(tau, response="leak"), steps=steps)
        yield Case(group, f"leak of {tau:g} steps", NATIVE, network, played, x=tau, quick=quick or tau == 1000)
        both = float_network(lif(tau, decay_u=-np.expm1(-1 / tau)), weights(tau) / tau**0.5, steps=steps)
        yield Case(group, f"leak and current of {tau:g}", NATIVE, both, played)


def refractory_time_constants() -> Iterator[Case]:
    """The refractory kernel, beside an input kernel of 10 steps."""
    for tau in STEPS_OF_TAU:
        for strategy in SRM_STRATEGIES:
            network = float_network(srm(tau_ref=tau), weights())
            quick = tau in (0.5, 1000, 10_000) and strategy != "reset"
            yield Case("refractory time constants", f"tau_ref {tau:g}", strategy, network, random_input(), quick=quick)
