"""Small networks of leaky neurons with random weights that fit on a Xylo, and recordings for them."""

from __future__ import annotations

import numpy as np

import locsnn_compile as lc

INPUTS = 16
STEPS = 40
TIME = "time"


def soft(size: int, decay_u: float, decay_v: float, threshold: float) -> lc.SoftCuba:
    """Return neurons whose spikes subtract the threshold in the same step.

    ``drop`` is subtracted one step later, when a potential has decayed once, hence the factor.
    """
    drop = (1 - decay_v) * threshold
    return lc.SoftCuba.of(size, decay_u=decay_u, decay_v=decay_v, threshold=threshold, drop=drop)


def network(
    populations: tuple[lc.Population, ...],
    projections: tuple[lc.Projection, ...],
    **changes: object,
) -> lc.Network:
    """Return a network of these populations with one input; the last population is read out."""
    parts: dict[str, object] = {
        "name": "small",
        "channels": INPUTS,
        "steps": STEPS,
        "views": (lc.InputView("touch", TIME, INPUTS),),
        "populations": populations,
        "projections": projections,
        "readout": lc.Readout((populations[-1].name,), (1.0,)),
        "step_seconds": 0.001,
    }
    return lc.Network(**parts | changes)


def small_network(threshold: float = 5.0, **changes: object) -> lc.Network:
    """Return 16 inputs, hidden layers of 12 neurons (with recurrence) and 8, and 4 outputs."""
    r = np.random.default_rng(5)
    populations = (
        lc.Population(
            "first", TIME, 12, soft(size=12, decay_u=0.25, decay_v=0.125, threshold=threshold)
        ),
        lc.Population("second", TIME, 8, soft(size=8, decay_u=0.5, decay_v=0.25, threshold=2.0)),
        lc.Population(
            "classes", TIME, 4, soft(size=4, decay_u=0.25, decay_v=0.0625, threshold=1.0)
        ),
    )
    projections = (
        lc.Projection("touch", "first", r.normal(0.08, 0.25, (12, INPUTS))),
        lc.Projection("first", "first", r.normal(0.0, 0.1, (12, 12))),
        lc.Projection("first", "second", r.normal(0.2, 0.4, (8, 12))),
        lc.Projection("second", "classes", r.normal(0.1, 0.4, (4, 8))),
    )
    return network(populations, projections, **changes)


def busy_network() -> lc.Network:
    """Return the small network with a low threshold, at which neurons would spike more than once in a step.

    On Xylo they do, and registers saturate.
    """
    return small_network(threshold=1.0)


def memoryless_network() -> lc.Network:
    """Return neurons whose potential keeps nothing (a decay of 1), as NIR's LIF nodes become, with biases."""
    r = np.random.default_rng(6)
    hidden = lc.Cuba.of(
        10, decay_u=0.25, decay_v=1.0, threshold=1.0, bias=np.linspace(-0.2, 0.4, 10)
    )
    populations = (
        lc.Population("hidden", TIME, 10, hidden),
        lc.Population("classes", TIME, 3, soft(size=3, decay_u=0.3, decay_v=0.1, threshold=1.0)),
    )
    projections = (
        lc.Projection("touch", "hidden", r.normal(0.1, 0.3, (10, INPUTS))),
        lc.Projection("hidden", "hidden", -0.75 * np.eye(10)),
        lc.Projection("hidden", "classes", r.normal(0.1, 0.4, (3, 10))),
    )
    return network(populations, projections)


NETWORKS = {
    "two layers": small_network,
    "saturating": busy_network,
    "memoryless, biased": memoryless_network,
}


def touches(samples: int = 6, rate: float = 0.15) -> np.ndarray:
    """Return random recordings (samples, steps, channels)."""
    r = np.random.default_rng(7)
    return (r.random((samples, STEPS, INPUTS)) < rate).astype(np.uint8)
