"""From a checkpoint of ours (``locsnn train``) to a Network."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from hw_model.mapping.graph import Axis, Readout
from locsnn_compile.errors import TargetError
from locsnn_compile.frontends.window_network import Parts, window_parts
from locsnn_compile.models.branch_graph import branch_graph, spread_weights
from locsnn_compile.models.checkpoint import Checkpoint
from locsnn_compile.models.description import LifParameters
from locsnn_compile.network.network import InputView, Network, Population
from locsnn_compile.network.neurons import Cuba, SrmAlpha
from locsnn_compile.network.projections import ChipProjection, Projection, matrix

VIEW_NAMES: dict[Axis, str] = {"time": "touch", "location": "touch_transposed"}


def network_of(checkpoint: Checkpoint) -> Network:
    """Return the network of a checkpoint: one view, and its populations, for each of its branches.

    Raises ``TargetError`` for an artificial network, which has no spikes to compile.
    """
    description = checkpoint.description
    if not description.structure.spiking:
        raise TargetError(
            f"model {description.name!r}",
            f"a {description.architecture!r} has no spiking neurons, so no chip program can be made of it",
            fix="Train a spiking network; of this one, operations are counted only.",
        )
    windows = description.structure.neurons == "windows"
    views, populations, projections, readout = window_parts(checkpoint) if windows else _branches(checkpoint)
    layout = description.input
    return Network(
        name=description.name,
        channels=layout.channels,
        steps=layout.steps,
        step_seconds=layout.step_seconds,
        fingertips=layout.fingertips,
        event_threshold=layout.event_threshold,
        psi=_psi(checkpoint),
        views=tuple(views),
        populations=tuple(populations),
        projections=tuple(projections),
        readout=readout,
        sha256=checkpoint.sha256,
        recordings=checkpoint.recordings,
    )


def _psi(checkpoint: Checkpoint) -> float | None:
    """Return what the training said of the time-weighted prediction, which checkpoints before it did not."""
    psi = checkpoint.training.get("psi")
    return float(psi) if isinstance(psi, int | float) and 0 <= psi < math.inf else None


def _branches(checkpoint: Checkpoint) -> Parts:
    """Return the parts of every branch, one after the other."""
    description = checkpoint.description
    views, populations = [], []
    projections: list[Projection | ChipProjection] = []
    for axis in VIEW_NAMES:
        if axis not in description.branches:
            continue
        view = _view(axis, checkpoint)
        views.append(view)
        for source, target in pairwise((view.name, *description.populations(axis))):
            population, onto = _layer(checkpoint, axis, source, target)
            populations.append(population)
            projections.extend(onto)
    outputs = tuple(f"{view.axis}_output" for view in views)
    return views, populations, projections, Readout(outputs, (1.0,) * len(outputs))


def _layer(
    checkpoint: Checkpoint, axis: Axis, source: str, target: str
) -> tuple[Population, Sequence[Projection | ChipProjection]]:
    """Return a population and the weights onto it: in float, or in the integers that it was trained with.

    There is a projection for each delay, all from the same lines; their weights lie side by side in the checkpoint.
    """
    description, chip = checkpoint.description, checkpoint.chip
    weights = _weights(checkpoint, axis, target)
    size = weights.shape[0]
    delays = description.delays if target == "time_hidden" else (0,)
    parts = [weights] if delays == (0,) else np.split(np.asarray(weights), len(delays), axis=1)
    if chip is None:
        return Population(target, axis, size, _neuron(checkpoint, size)), [
            Projection(source, target, matrix(part, np.float64), delay=delay)
            for delay, part in zip(delays, parts, strict=True)
        ]
    numbers = chip.populations[target]
    return Population(target, axis, size, numbers.neuron), [
        ChipProjection(source, target, matrix(part, np.int64), numbers.exponent, numbers.weight_bits, delay=delay)
        for delay, part in zip(delays, parts, strict=True)
    ]


def _weights(checkpoint: Checkpoint, axis: Axis, target: str) -> NDArray[Any] | sparse.csr_array:
    """Return the weights, or mantissas, of single neurons; a graph convolution becomes sparse."""
    weights, description = checkpoint.weights[target], checkpoint.description
    if description.graph is not None and target == description.populations(axis)[0]:
        return spread_weights(weights, branch_graph(description, axis))
    return weights


def _neuron(checkpoint: Checkpoint, size: int) -> SrmAlpha | Cuba:
    """Return the float neuron: TLIF and LLIF keep nothing of a current, and of the voltage what they do not lose."""
    n = checkpoint.description.neuron
    if isinstance(n, LifParameters):
        return Cuba.of(size, decay_v=1.0 - n.decay, threshold=n.threshold)
    n = checkpoint.description.srm
    return SrmAlpha(theta=n.theta, tau_sr=n.tau_sr, tau_ref=n.tau_ref, scale_ref=n.scale_ref)


def _view(axis: Axis, checkpoint: Checkpoint) -> InputView:
    layout = checkpoint.description.input
    if axis == "time":
        return InputView(VIEW_NAMES[axis], axis, layout.channels)
    return InputView(VIEW_NAMES[axis], axis, layout.steps, checkpoint.description.walk)
