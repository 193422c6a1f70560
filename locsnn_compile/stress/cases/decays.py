"""Time constants and decays: from half a step to more than decays hold, and both ends of their grid."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product

import numpy as np

from locsnn_compile.network.chip_neurons import ChipCuba, ChipSrm
from locsnn_compile.strategies import NATIVE, USUAL
from locsnn_compile.stress.cases.case import (
    CHANNELS,
    NEURONS,
    SEED,
    Case,
    chip_network,
    lif,
    lif_case,
    random_input,
    srm,
    srm_cases,
    weights,
)

STEPS_OF_TAU = (0.5, 1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 2000, 5000, 8000, 10_000)
QUICK = (0.5, 10, 10_000)
SHORT, LONG, FROM = 200, 2000, 200
"""Steps of a recording: of time constants of 200 steps and more, the longer."""
ENDS = (0, 1, 4095, 4096)
THRESHOLD = 400


def time_constants() -> Iterator[Case]:
    """The alpha kernel of the input, and the leak of integrate-and-fire neurons."""
    for tau in STEPS_OF_TAU:
        steps = LONG if tau >= FROM else SHORT
        played, quick = random_input(steps, samples=1), tau in QUICK
        kernel, given = srm(tau_sr=tau), weights(tau)
        yield from srm_cases(f"tau_sr {tau:g}", kernel, given, played, steps=steps, x=tau, quick=quick, quick_as=USUAL)
        name, leaky = f"leak of {tau:g} steps", weights(tau, response="leak")
        yield lif_case(name, lif(tau), leaky, played, steps=steps, x=tau, quick=quick or tau == 1000)
        name, both = f"leak and current of {tau:g}", lif(tau, decay_u=-np.expm1(-1 / tau))
        yield lif_case(name, both, given / tau**0.5, played, steps=steps)


def refractory_time_constants() -> Iterator[Case]:
    """The refractory kernel, beside an input kernel of 10 steps."""
    for tau in STEPS_OF_TAU:
        quick, neuron = tau in (0.5, 1000, 10_000), srm(tau_ref=tau)
        yield from srm_cases(f"tau_ref {tau:g}", neuron, quick=quick, quick_as=("dendrite", "delay-line"))


def decays() -> Iterator[Case]:
    """Effective decays of 0 (all is kept), 1, 4095 and 4096 (nothing is)."""
    played = random_input()
    mantissa = np.random.default_rng(SEED).integers(-90, 120, (NEURONS, CHANNELS))
    for decay_u, decay_v in product(ENDS, ENDS):
        neuron = ChipCuba.of(NEURONS, decay_u=decay_u, decay_v=decay_v, threshold=THRESHOLD)
        name = f"decay_u {decay_u}, decay_v {decay_v}"
        yield Case(name, NATIVE, chip_network(neuron, mantissa), played, quick=decay_u == 4095 - decay_v)
    for decay, own in ((0, 4096), (1, 4095), (4095, 1), (4096, 0)):
        dendrite = ChipSrm.with_dendrite(
            NEURONS,
            decay=decay,
            threshold=THRESHOLD,
            refractory_decay=own,
            refractory_mantissa=-200,
            refractory_exponent=1,
        )
        name = f"decays {decay}, refractory {own}"
        yield Case(name, "dendrite", chip_network(dendrite, mantissa), played, quick=decay == 1)
        taps = ChipSrm.with_taps(
            NEURONS, decay=decay, threshold=THRESHOLD, delay=[0, 1, 62], mantissa=[-200, 100, -50], exponent=[1, 1, 0]
        )
        yield Case(f"decays {decay}", "delay-line", chip_network(taps, mantissa), played)
