"""Decays at both ends of the grid, in networks that are the chip's integers already."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product

import numpy as np

from locsnn_compile.network.chip_neurons import ChipCuba, ChipSrm
from locsnn_compile.strategies import NATIVE
from locsnn_compile.stress.cases.case import CHANNELS, NEURONS, SEED, Case, chip_network, random_input

ENDS = (0, 1, 4095, 4096)
THRESHOLD = 400


def decays() -> Iterator[Case]:
    """Effective decays of 0 (all is kept), 1, 4095 and 4096 (nothing is)."""
    group, played = "decays at the ends of the grid", random_input()
    mantissa = np.random.default_rng(SEED).integers(-90, 120, (NEURONS, CHANNELS))
    for decay_u, decay_v in product(ENDS, ENDS):
        neuron = ChipCuba.of(NEURONS, decay_u=decay_u, decay_v=decay_v, threshold=THRESHOLD)
        name = f"decay_u {decay_u}, decay_v {decay_v}"
        yield Case(group, name, NATIVE, chip_network(neuron, mantissa), played, quick=decay_u == 4095 - decay_v)
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
        yield Case(group, name, "dendrite", chip_network(dendrite, mantissa), played, quick=decay == 1)
        taps = ChipSrm.with_taps(
            NEURONS, decay=decay, threshold=THRESHOLD, delay=[0, 1, 62], mantissa=[-200, 100, -50], exponent=[1, 1, 0]
        )
        yield Case(group, f"decays {decay}", "delay-line", chip_network(taps, mantissa), played)
