"""From a checkpoint of ours (``locsnn train``) to a Network."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np

from hw_model.mapping.graph import Axis, Readout
from locsnn_compile.errors import TargetError
from locsnn_compile.frontends.window_network import Parts, window_parts
from locsnn_compile.models.branch_graph import branch_graph, spread_weights
from locsnn_compile.models.checkpoint import Checkpoint
from locsnn_compile.models.checkpoint_reader import read_checkpoint
from locsnn_compile.models.chip_numbers import ChipPopulation, OwnSynapse
from locsnn_compile.models.description import LifParameters
from locsnn_compile.network.chip_neurons import ChipCuba, ChipNeuron, ChipProjection, ChipSrm
from locsnn_compile.network.matrices import Matrix, matrix
from locsnn_compile.network.network import InputView, Network, Population, Projection
from locsnn_compile.network.neurons import Cuba, SrmAlpha

VIEW_NAMES: dict[Axis, str] = {"time": "touch", "location": "touch_transposed"}


def load_checkpoint(path: Path) -> Network:
    """Read a checkpoint and state its network; a file that is not one is an ``InputError``."""
    return network_of(read_checkpoint(path))


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
    for axis in _axes(description.branches):
        view = _view(axis, checkpoint)
        views.append(view)
        for source, target in pairwise((view.name, *description.populations(axis))):
            population, projection = _layer(checkpoint, axis, source, target)
            populations.append(population)
            projections.extend(_by_delay(projection, description.delays if target == "time_hidden" else (0,)))
    outputs = tuple(f"{view.axis}_output" for view in views)
    return views, populations, projections, Readout(outputs, (1.0,) * len(outputs))


def _layer(
    checkpoint: Checkpoint, axis: Axis, source: str, target: str
) -> tuple[Population, Projection | ChipProjection]:
    """Return a population and the weights onto it: in float, or in the integers that it was trained with."""
    if checkpoint.chip is None:
        weights = _weights(checkpoint, axis, target)
        size = weights.shape[0]
        return Population(target, axis, size, _neuron(checkpoint, size)), Projection(source, target, weights)
    numbers = checkpoint.chip.populations[target]
    mantissa = matrix(checkpoint.weights[target], np.int64)
    projection = ChipProjection(source, target, mantissa, numbers.exponent, numbers.weight_bits)
    size = len(mantissa)
    return Population(target, axis, size, _chip_neuron(numbers, checkpoint.chip.strategy, size)), projection


def _by_delay(
    projection: Projection | ChipProjection, delays: tuple[int, ...]
) -> Iterator[Projection | ChipProjection]:
    """Yield a projection for each delay, whose weights lie side by side; all from the same lines."""
    if delays == (0,):
        yield projection
        return
    values = projection.mantissa if isinstance(projection, ChipProjection) else projection.weights
    for delay, part in zip(delays, np.split(np.asarray(values), len(delays), axis=1), strict=True):
        if isinstance(projection, ChipProjection):
            yield replace(projection, mantissa=matrix(part, np.int64), delay=delay)
        else:
            yield replace(projection, weights=matrix(part, np.float64), delay=delay)


def _weights(checkpoint: Checkpoint, axis: Axis, target: str) -> Matrix:
    """Return the float weights of single neurons; a graph convolution becomes sparse."""
    weights = checkpoint.weights[target]
    if checkpoint.description.graph is not None and target == checkpoint.description.populations(axis)[0]:
        return matrix(spread_weights(weights, branch_graph(checkpoint.description, axis)), np.float64)
    return matrix(weights, np.float64)


def _neuron(checkpoint: Checkpoint, size: int) -> SrmAlpha | Cuba:
    """Return the float neuron: TLIF and LLIF keep nothing of a current, and of the voltage what they do not lose."""
    n = checkpoint.description.neuron
    if isinstance(n, LifParameters):
        return Cuba.of(size, decay_v=1.0 - n.decay, threshold=n.threshold)
    n = checkpoint.description.srm
    return SrmAlpha(theta=n.theta, tau_sr=n.tau_sr, tau_ref=n.tau_ref, scale_ref=n.scale_ref)


def _chip_neuron(numbers: ChipPopulation, strategy: str, size: int) -> ChipNeuron:
    n = numbers
    if strategy == "reset":
        return ChipCuba.of(size, decay_u=n.decay, decay_v=n.decay, threshold=n.threshold, refractory=n.refractory)
    if strategy == "delay-line":
        delay, mantissa, exponent = ([getattr(s, name) for s in n.own] for name in ("delay", "mantissa", "exponent"))
        return ChipSrm.with_taps(
            size, decay=n.decay, threshold=n.threshold, delay=delay, mantissa=mantissa, exponent=exponent
        )
    own = n.own[0] if n.own else OwnSynapse(0, 0)
    return ChipSrm.with_dendrite(
        size,
        decay=n.decay,
        threshold=n.threshold,
        refractory_decay=n.refractory_decay,
        refractory_mantissa=own.mantissa,
        refractory_exponent=own.exponent,
    )


def _axes(branches: tuple[str, ...]) -> tuple[Axis, ...]:
    return tuple(axis for axis in VIEW_NAMES if axis in branches)


def _view(axis: Axis, checkpoint: Checkpoint) -> InputView:
    layout = checkpoint.description.input
    if axis == "time":
        return InputView(VIEW_NAMES[axis], axis, layout.channels)
    return InputView(VIEW_NAMES[axis], axis, layout.steps, checkpoint.description.walk)
