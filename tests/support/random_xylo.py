"""Random networks of Xylo: small ones in which all happens that its arithmetic distinguishes."""

from __future__ import annotations

import numpy as np

from hw_model.xylo.network import XyloNetwork, XyloPopulation

ROWS = 30


def _weights(r: np.random.Generator, shape: tuple[int, ...]) -> np.ndarray:
    end = int(r.choice([4, 30, 128]))
    weights = r.integers(-end, min(end, 127) + 1, shape)
    weights[r.random(shape) > r.uniform(0.1, 1.0)] = 0
    return weights


def _population(r: np.random.Generator, size: int, states: int, biased: bool) -> XyloPopulation:
    most = int(r.choice([40, 900, 32767]))
    lowest = int(r.choice([-150, -32768]))
    return XyloPopulation(
        dash_syn=r.integers(0, 16, (size, states)),
        dash_mem=r.integers(0, 16, size),
        threshold=r.integers(1, most + 1, size),
        bias=r.integers(lowest, 150, size) if biased else None,
    )


def random_xylo(seed: int) -> tuple[XyloNetwork, np.ndarray]:
    """A network, and rows of input events for it."""
    r = np.random.default_rng(seed)
    inputs, hidden, outputs = (int(r.integers(1, most)) for most in (17, 26, 9))
    states = int(r.integers(1, 3))
    biased = bool(r.integers(2))
    aliases = None
    if r.random() < 0.5:
        aliases = tuple(
            (int(r.integers(hidden)),) if r.random() < 0.25 else () for _ in range(hidden)
        )
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
