"""From a checkpoint of ours (``locsnn train``) to a Network."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from hw_model.graph import Axis, Readout
from locsnn_compile.data.sensor import channel_walk
from locsnn_compile.models.checkpoint import Checkpoint
from locsnn_compile.models.checkpoint_reader import read_checkpoint
from locsnn_compile.network import InputView, Network, Population, Projection, SrmAlpha

VIEW_NAMES: dict[Axis, str] = {"time": "touch", "location": "touch_transposed"}


def load_checkpoint(path: Path) -> Network:
    """Read a checkpoint and state its network; a file that is not one is an ``InputError``."""
    return network_of(read_checkpoint(path))


def network_of(checkpoint: Checkpoint) -> Network:
    """Return the network of a checkpoint: one view, and two populations, for each of its branches."""
    description = checkpoint.description
    n = description.neuron
    neuron = SrmAlpha(theta=n.theta, tau_sr=n.tau_sr, tau_ref=n.tau_ref, scale_ref=n.scale_ref)
    views, populations, projections = [], [], []
    for axis in _axes(description.branches):
        view = _view(axis, checkpoint)
        hidden, output = f"{axis}_hidden", f"{axis}_output"
        views.append(view)
        for source, target in ((view.name, hidden), (hidden, output)):
            weights = checkpoint.weights[target].astype(np.float64)
            weights.setflags(write=False)
            populations.append(Population(target, axis, len(weights), neuron))
            projections.append(Projection(source, target, weights))
    outputs = tuple(f"{view.axis}_output" for view in views)
    return Network(
        name=description.name,
        channels=description.input.channels,
        steps=description.input.steps,
        step_seconds=description.input.step_seconds,
        fingertips=description.input.fingertips,
        views=tuple(views),
        populations=tuple(populations),
        projections=tuple(projections),
        readout=Readout(outputs, (1.0,) * len(outputs)),
        sha256=checkpoint.sha256,
        recordings=checkpoint.recordings,
    )


def _axes(branches: tuple[str, ...]) -> tuple[Axis, ...]:
    return tuple(axis for axis in VIEW_NAMES if axis in branches)


def _view(axis: Axis, checkpoint: Checkpoint) -> InputView:
    layout = checkpoint.description.input
    if axis == "time":
        return InputView(VIEW_NAMES[axis], axis, layout.channels)
    taxels = checkpoint.description.location_taxels
    assert taxels is not None  # the description's own check: a location branch has an order
    return InputView(VIEW_NAMES[axis], axis, layout.steps, channel_walk(taxels, layout.fingertips))
