"""Small networks for the tests, made without torch."""

import numpy as np

from hw_model.graph import Readout
from locsnn_compile.network import InputView, Network, Population, Projection
from locsnn_compile.neurons import SrmAlpha

NEURON = SrmAlpha(theta=10.0, tau_sr=10.0, tau_ref=1.0, scale_ref=2.0)


def hybrid(seed=0, *, channels=4, steps=12, hidden=3, classes=2, neuron=NEURON, scale=8.0, fingertips=None):
    """A hybrid with random weights, and a walk that visits the channels backwards."""
    r = np.random.default_rng(seed)
    views = (
        InputView("touch", "time", channels),
        InputView("touch_transposed", "location", steps, np.arange(channels)[::-1].copy()),
    )
    populations, projections = [], []
    for view in views:
        names = (f"{view.axis}_hidden", f"{view.axis}_output")
        sizes = (hidden, classes)
        sources = (view.name, names[0])
        for name, size, source, fan_in in zip(names, sizes, sources, (view.lines, hidden), strict=True):
            populations.append(Population(name, view.axis, size, neuron))
            projections.append(Projection(source, name, np.round(r.normal(0, scale, (size, fan_in)), 3)))
    return Network(
        name="small-hybrid",
        channels=channels,
        steps=steps,
        step_seconds=0.02,
        fingertips=fingertips,
        views=views,
        populations=tuple(populations),
        projections=tuple(projections),
        readout=Readout(("time_output", "location_output"), (1.0, 1.0)),
        sha256="0" * 64,
    )


def recordings(network, samples=3, seed=0, rate=0.3):
    r = np.random.default_rng(seed)
    return (r.random((samples, network.steps, network.channels)) < rate).astype(np.uint8)
