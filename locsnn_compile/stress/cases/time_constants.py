"""Time constants from half a step to more than decays hold."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from locsnn_compile.strategies import USUAL
from locsnn_compile.stress.cases.case import Case, lif, lif_case, random_input, srm, srm_cases, weights

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
        kernel, given = srm(tau_sr=tau), weights(tau)
        yield from srm_cases(
            group, f"tau_sr {tau:g}", kernel, given, played, steps=steps, x=tau, quick=quick, quick_as=USUAL
        )
        name, leaky = f"leak of {tau:g} steps", weights(tau, response="leak")
        yield lif_case(group, name, lif(tau), leaky, played, steps=steps, x=tau, quick=quick or tau == 1000)
        name, both = f"leak and current of {tau:g}", lif(tau, decay_u=-np.expm1(-1 / tau))
        yield lif_case(group, name, both, given / tau**0.5, played, steps=steps)


def refractory_time_constants() -> Iterator[Case]:
    """The refractory kernel, beside an input kernel of 10 steps."""
    group = "refractory time constants"
    for tau in STEPS_OF_TAU:
        quick, neuron = tau in (0.5, 1000, 10_000), srm(tau_ref=tau)
        yield from srm_cases(group, f"tau_ref {tau:g}", neuron, quick=quick, quick_as=("dendrite", "delay-line"))
