"""Small random networks of Xylo that reach every case of its arithmetic: saturation, rounding, many spikes in a step."""

from __future__ import annotations

import numpy as np

from hw_model.xylo.network import XyloNetwork, XyloPopulation

ROWS = 30
"""Steps of a recording."""


def _weights(r: np.random.Generator, shape: tuple[int, ...]) -> np.ndarray:
    """Draw weights of 8 bits (-128 to 127), small, middle or of the whole range, some of them 0."""
    end = int(r.choice([4, 30, 128]))
    weights = r.integers(-end, min(end, 127) + 1, shape)
    weights[r.random(shape) > r.uniform(0.1, 1.0)] = 0
    return weights


def _population(r: np.random.Generator, size: int, states: int, biased: bool) -> XyloPopulation:
    """Draw neurons with ``states`` synaptic currents each; ends of ranges are those of 16 bits."""
    largest_threshold = int(r.choice([40, 900, 32767]))
    lowest_bias = int(r.choice([-150, -32768]))
    return XyloPopulation(
        dash_syn=r.integers(0, 16, (size, states)),
        dash_mem=r.integers(0, 16, size),
        threshold=r.integers(1, largest_threshold + 1, size),
        bias=r.integers(lowest_bias, 150, size) if biased else None,
    )


def random_xylo(seed: int) -> tuple[XyloNetwork, np.ndarray]:
    """Draw a network, and counts of input events (rows, inputs) for it; a row may have several events of an input."""
    r = np.random.default_rng(seed)
    inputs = int(r.integers(1, 17))
    hidden = int(r.integers(1, 26))
    outputs = int(r.integers(1, 9))
    states = int(r.integers(1, 3))
    biased = bool(r.integers(2))
    # A neuron with an alias makes the alias spike as well.
    aliases = None
    if r.random() < 0.5:
        drawn: list[tuple[int, ...]] = []
        for _ in range(hidden):
            has_alias = r.random() < 0.25
            drawn.append((int(r.integers(hidden)),) if has_alias else ())
        aliases = tuple(drawn)
    network = XyloNetwork(
        hidden=_population(r, hidden, states, biased),
        outputs=_population(r, outputs, 1, biased),
        weights_in=_weights(r, (inputs, hidden, states)),
        weights_hidden=_weights(r, (hidden, hidden, states)),
        weights_out=_weights(r, (hidden, outputs)),
        shift_in=int(r.choice([0, 1, 3, 5, 8, 10])),
        shift_hidden=int(r.choice([0, 1, 3, 5, 8, 10])),
        shift_out=int(r.choice([0, 1, 3, 5, 8, 10])),
        aliases=aliases,
    )
    events = r.integers(0, int(r.choice([2, 5, 20])), (ROWS, inputs))
    events[r.random(events.shape) > r.uniform(0.05, 0.7)] = 0
    return network, events
