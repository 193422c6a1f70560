"""Small random networks of SpiNNaker that reach every case of its arithmetic: wraps, saturation, exact thresholds.

Parameters are stored in s16.15: 32 bits with a sign, in units of 2^-15.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from hw_model.arithmetic.spinnaker import HALF_SPAN, LATENESS_MAX, ONE, Parameters
from hw_model.mapping.graph import Input, Phase
from hw_model.spinnaker.network import (
    RECEPTORS,
    SpinnakerNetwork,
    SpinnakerPopulation,
    SpinnakerProjection,
)

ROWS = 40
PHASE = "run"
LARGEST = HALF_SPAN / ONE
"""The first magnitude that s16.15 does not reach."""


class Case(NamedTuple):
    """A network of one phase, and its input.

    ``spikes`` are (rows, lines); ``lateness`` (rows, sources) is by how many steps a core is behind with the spikes of a
    source, a line or a neuron.
    """

    network: SpinnakerNetwork
    spikes: np.ndarray
    lateness: np.ndarray


def random_case(seed: int) -> Case:
    """Draw a network of up to three populations, spikes of its lines, and how late they come."""
    r = np.random.default_rng(seed)
    lines = int(r.integers(1, 9))
    populations = tuple(_population(r, f"cells{n}") for n in range(r.integers(1, 4)))
    network = SpinnakerNetwork(
        phases=(Phase(PHASE, "time", steps=None),),
        inputs=(Input("lines", lines, PHASE, "touches"),),
        populations=populations,
        projections=tuple(_projections(r, lines, populations)),
    )
    spikes = (r.random((ROWS, lines)) < r.choice([0.05, 0.3, 0.9])).astype(np.uint8)
    sources = lines + network.neurons_of(PHASE)
    lateness = r.integers(0, LATENESS_MAX + 1, (ROWS, sources))
    lateness[r.random(lateness.shape) < r.choice([0.3, 0.8, 1.0])] = 0
    return Case(network, spikes, lateness)


def _population(r: np.random.Generator, name: str) -> SpinnakerPopulation:
    """Draw a population; sizes are below, between and above the neurons that a core holds."""
    size = int(r.choice([1, 3, 17, 40]))
    draw = r.choice([_usual, _wide, _integers])
    return SpinnakerPopulation(
        name=name,
        phase=PHASE,
        parameters=draw(r, size),
        shifts=(int(r.integers(0, 17)), int(r.integers(0, 17))),
        slots=int(2 ** r.integers(1, 7)),
        neurons_per_core=int(r.choice([5, 16, 128])),
    )


def _usual(r: np.random.Generator, size: int) -> Parameters:
    """Draw parameters as PyNN scripts have them."""
    return Parameters(
        tau_m=_stored(r.uniform(1, 100, size)),
        c_m=_stored(r.uniform(0.1, 5, size)),
        tau_syn=_stored(r.uniform(0.5, 50, (size, 2))),
        v_rest=_stored(r.choice([0.0, -65.0], size)),
        v_reset=_stored(r.choice([0.0, -70.0], size)),
        v_thresh=_stored(r.uniform(1, 3000, size)),
        v_init=_stored(r.choice([0.0, -65.0], size)),
        i_offset=_stored(r.choice([0.0, 0.5, 4.0], size)),
        tau_refrac=_stored(r.choice([0.0, 0.1, 1.0, 3.7], size)),
    )


def _wide(r: np.random.Generator, size: int) -> Parameters:
    """Draw parameters from all that a core can store, so that constants and sums wrap."""
    most = LARGEST - 1
    # On either side of the time constants at which a decay, or the factor of a synapse, becomes 0, 1 or wraps.
    synaptic_times = [1e-4, 0.09, 0.2, 5.0, 900.0, 5450.0, 32768.0, 40000.0]
    return Parameters(
        tau_m=_stored(10 ** r.uniform(-4, 4.8, size)),
        c_m=_stored(10 ** r.uniform(-4, 3, size)),
        tau_syn=_stored(r.choice(synaptic_times, (size, 2))),
        v_rest=_stored(r.uniform(-most, most, size)),
        v_reset=_stored(r.uniform(-most, most, size)),
        v_thresh=_stored(r.uniform(-most, most, size)),
        v_init=_stored(r.uniform(-most, most, size)),
        i_offset=_stored(r.uniform(-most, most, size)),
        tau_refrac=_stored(r.uniform(0, 40, size)),
    )


def _integers(r: np.random.Generator, size: int) -> Parameters:
    """Draw neurons that keep nothing and move by whole units, so that thresholds are met exactly."""
    fast = 3151  # the longest time constant, s16.15, that keeps nothing
    return Parameters(
        tau_m=np.full(size, fast),
        c_m=np.full(size, fast),
        tau_syn=np.full((size, 2), fast),
        v_rest=r.integers(-3, 4, size),
        v_reset=r.integers(-3, 4, size),
        v_thresh=r.integers(0, 12, size),
        v_init=r.integers(-3, 4, size),
        i_offset=r.integers(-2, 6, size),
        tau_refrac=_stored(r.choice([0.0, 1.0, 2.0], size)),
    )


def _stored(values: np.ndarray) -> np.ndarray:
    """Return numbers as SpiNNaker stores them, in units of 2^-15; positive numbers stay positive."""
    lowest = np.where(values > 0, 1, -HALF_SPAN)
    return np.maximum(np.rint(values * ONE), lowest).astype(np.int64)


def _projections(
    r: np.random.Generator, lines: int, populations: tuple[SpinnakerPopulation, ...]
) -> list[SpinnakerProjection]:
    """Draw synapses of both receptors from the lines, and among the populations."""
    sources = {"lines": lines} | {item.name: item.size for item in populations}
    heaviest = int(r.choice([50, 2000, 65535]))
    projections = []
    for target in populations:
        for source, size in sources.items():
            if source != "lines" and r.random() < 0.4:
                continue
            for receptor in RECEPTORS:
                count = int(r.integers(1, 4 * target.size + 2))
                projections.append(
                    SpinnakerProjection(
                        source=source,
                        target=target.name,
                        receptor=receptor,
                        source_index=np.sort(r.integers(0, size, count)),
                        target_index=r.integers(0, target.size, count),
                        weight=r.integers(0, heaviest + 1, count),
                        delay=r.integers(1, target.slots + 1, count),
                    )
                )
    return projections
