"""From a checkpoint of ``locsnn train`` to a Network.

A checkpoint describes one or more *branches*, whose class scores add up: layers that step over time, layers that step
over location, and *windows*, neurons that count the events of some channels during some steps. Its weights are in
float, or in the integers of the chip that it was trained for.
"""

import math
from collections.abc import Sequence
from dataclasses import astuple, replace
from itertools import pairwise

import numpy as np
from scipy import sparse

from hw_model.arithmetic import loihi
from hw_model.mapping.graph import Axis
from locsnn_compile.errors import TargetError
from locsnn_compile.frontends.parts import VIEW_NAMES, Parts
from locsnn_compile.frontends.xylo_checkpoint import add_xylo
from locsnn_compile.models.checkpoint import Checkpoint, Pack
from locsnn_compile.models.description import LifParameters
from locsnn_compile.models.graph_and_windows import spread_weights
from locsnn_compile.network.chip_neurons import ChipCuba
from locsnn_compile.network.committee import committee
from locsnn_compile.network.network import InputView, Network, Population
from locsnn_compile.network.neurons import Cuba, Neuron, SrmAlpha
from locsnn_compile.network.projections import ChipProjection, Matrix, Projection, matrix, row_sums

LAYERS = 2
"""Layers of the window branch (counting neurons and outputs), and so the steps from an event to the outputs."""
UNREACHED = 1.1
"""The threshold of an output of windows, as a multiple of the largest input of a step, so that it never spikes.

A tenth more leaves room for the rounding of weights, which may enlarge their sum.
"""
TWO_UNITS_MANTISSA = 128
"""With the exponent -6, a weight mantissa of 128 charges 128 * 64 / 2^6 = 128 units: twice the unit of thresholds."""


def _add_windows(parts: Parts, checkpoint: Checkpoint) -> None:
    """Add the branch that counts events in windows; it has a phase of its own, unless it is the location branch.

    It runs on the location axis in a single step with all events of a recording: its neurons compare counts with
    levels, so the order of the events does not matter.
    """
    description = checkpoint.description
    chip = checkpoint.chip
    branch = description.structure.window_branch
    weight, offset = description.window_names
    phase = "" if branch == "location" else branch
    layout = description.input
    windows = description.windows
    # All channels are visited in one step, each with a line for every time step.
    view = InputView(
        name="touch_windows" if phase else VIEW_NAMES["location"],
        axis="location",
        lines=layout.channels * layout.steps,
        walk=description.walk,
        together=layout.channels,
        silence=LAYERS,
        own_phase=phase,
        align_events=description.align_events,
    )
    synapses = windows.synapses(layout.steps, layout.channels)
    # The number of events from which a counting neuron spikes, (counting neurons,).
    levels = np.tile(windows.levels, synapses.shape[0] // len(windows.levels))
    first, *outputs = description.populations(branch)
    counting: Neuron
    neuron: Neuron
    onto: Projection | ChipProjection
    if chip is None:
        # Half an event below the level: a count at the level spikes, and rounding cannot change that.
        counting = Cuba.of(len(levels), decay_v=1.0, threshold=levels - 0.5)
        onto = Projection(view.name, first, matrix(synapses, np.float64))
    else:
        # An event weighs two units, which any format holds, and the threshold lies between two counts.
        counting = ChipCuba.of(
            len(levels), decay_u=loihi.FORGETS, decay_v=loihi.FORGETS, threshold=2 * levels - 1
        )
        onto = ChipProjection(
            view.name,
            first,
            matrix(TWO_UNITS_MANTISSA * synapses, np.int64),
            exponent=-6,
            weight_bits=1,
        )
    hidden = Population(first, "location", len(levels), counting, own_phase=phase)
    parts.views.append(view)
    parts.populations.append(hidden)
    parts.projections.append(onto)
    weights = checkpoint.weights[weight].astype(np.float64)
    # Several populations of outputs, each with the weights of a part of the counting neurons: their scores add up.
    for name, part in zip(outputs, description.output_parts, strict=True):
        weights_of_part = np.zeros_like(weights)
        weights_of_part[:, part] = weights[:, part]
        if chip is None:
            # Each population gets a share of the bias, so that no register has to hold all of it.
            bias = checkpoint.weights[offset].astype(np.float64) / len(outputs)
            largest = float(row_sums(weights_of_part).max() + np.abs(bias).max())
            threshold = UNREACHED * largest if largest > 0 else 1.0
            neuron = Cuba.of(len(bias), decay_v=1.0, threshold=threshold, bias=bias)
        else:
            neuron = chip.window_output((weight, offset), checkpoint.weights)
            # Potentials are integers: divided by their scale, they add to the spikes of other branches.
            parts.weights[name] = 1.0 / chip.populations[weight].scale
        parts.projections.append(
            _onto(checkpoint, first, name, sparse.csr_array(weights_of_part), of=weight)
        )
        parts.populations.append(
            replace(hidden, name=name, size=description.classes, neuron=neuron)
        )
        parts.outputs[name] = LAYERS


def network_of_models(content: Checkpoint | Pack, name: str) -> Network:
    """Return the network of a checkpoint, or of all members of a pack, joined under this name."""
    if isinstance(content, Checkpoint):
        return network_of(content)
    members = [network_of(member) for member in content.members]
    return replace(committee(members, content.weights, name), sha256=content.sha256)


def network_of(checkpoint: Checkpoint) -> Network:
    """Return the network of a checkpoint: one view, and its populations, for each of its branches.

    Raises ``TargetError`` for an artificial network, which has no spikes to compile.
    """
    description = checkpoint.description
    if not description.structure.spiking:
        what = f"a {description.architecture!r} has no spiking neurons, so no chip program can be made of it"
        fix = "Train a spiking network; for this one, only operations are counted."
        raise TargetError(f"model {description.name!r}", what, fix=fix)
    parts = Parts(tie_class=checkpoint.tie_class)
    if checkpoint.xylo is not None:
        add_xylo(parts, checkpoint, checkpoint.xylo)
    else:
        _add_branches(parts, checkpoint)
    if description.structure.window_branch:
        _add_windows(parts, checkpoint)
    chip = checkpoint.chip
    layout = description.input
    return parts.network(
        name=description.name,
        channels=layout.channels,
        steps=layout.steps,
        step_seconds=layout.step_seconds,
        sensor=layout.sensor,
        sha256=checkpoint.sha256,
        recordings=checkpoint.recordings,
        event_threshold=layout.event_threshold,
        class_names=description.class_names,
        psi=_psi(checkpoint),
        trained_on={} if chip is None else {chip.target: astuple(chip.registers)},
        event_times=checkpoint.event_times,
        recorded=checkpoint.recorded,
    )


def _psi(checkpoint: Checkpoint) -> float | None:
    """Return the psi of the time-weighted prediction that was used in training; None if the checkpoint has none."""
    psi = checkpoint.training.get("psi")
    return float(psi) if isinstance(psi, int | float) and 0 <= psi < math.inf else None


def _add_branches(parts: Parts, checkpoint: Checkpoint) -> None:
    """Add every branch that spikes, one after the other."""
    description = checkpoint.description
    for axis in VIEW_NAMES:
        if axis not in description.branches or axis == description.structure.window_branch:
            continue
        layout = description.input
        lines = layout.channels
        walk = None
        if axis == "location":
            lines = layout.steps
            walk = description.walk
        view = InputView(VIEW_NAMES[axis], axis, lines, walk, align_events=description.align_events)
        parts.views.append(view)
        for source, target in pairwise((view.name, *description.populations(axis))):
            population, onto = _layer(checkpoint, axis, source, target)
            parts.populations.append(population)
            parts.projections.extend(onto)
        parts.outputs[f"{axis}_output"] = None


def _layer(
    checkpoint: Checkpoint, axis: Axis, source: str, target: str
) -> tuple[Population, Sequence[Projection | ChipProjection]]:
    """Return a population and the weights onto it: in float, or in the integers that it was trained with.

    There is a projection for each delay, all from the same lines; their weights are side by side in the checkpoint.
    The shared weights of a graph convolution become one sparse matrix of all its neurons.
    """
    chip = checkpoint.chip
    description = checkpoint.description
    weights: Matrix = checkpoint.weights[target]
    if description.graph is not None and target == description.populations(axis)[0]:
        weights = spread_weights(weights, description.graph_of(axis))
    delays = description.delays_onto(target)
    by_delay = [weights]
    if delays != (0,):
        by_delay = np.split(np.asarray(weights), len(delays), axis=1)
    rows = zip(delays, by_delay, strict=True)
    onto = [_onto(checkpoint, source, target, part, of=target, delay=delay) for delay, part in rows]
    size = weights.shape[0]
    neuron: Neuron
    if chip is None:
        neuron = _neuron(checkpoint, axis, size)
    else:
        neuron = chip.populations[target].neurons(chip.strategy, size)
    return Population(target, axis, size, neuron), onto


def _onto(
    checkpoint: Checkpoint, source: str, target: str, weights: Matrix, *, of: str, delay: int = 0
) -> Projection | ChipProjection:
    """Return weights onto a population, in float or in the format of the weights ``of`` the checkpoint."""
    if checkpoint.chip is None:
        return Projection(source, target, matrix(weights, np.float64), delay)
    numbers = checkpoint.chip.populations[of]
    return ChipProjection(
        source,
        target,
        matrix(weights, np.int64),
        exponent=numbers.exponent,
        weight_bits=numbers.weight_bits,
        delay=delay,
    )


def _neuron(checkpoint: Checkpoint, axis: Axis, size: int) -> SrmAlpha | Cuba:
    """Return the float neuron of a branch.

    TLIF and LLIF neurons (leaky integrate-and-fire along time and location) have no current.
    """
    parameters = checkpoint.description.neuron_of(axis)
    if isinstance(parameters, LifParameters):
        # Their ``decay`` is the share that is kept.
        return Cuba.of(size, decay_v=1.0 - parameters.decay, threshold=parameters.threshold)
    srm = checkpoint.description.srm(axis)
    return SrmAlpha(
        theta=srm.theta, tau_sr=srm.tau_sr, tau_ref=srm.tau_ref, scale_ref=srm.scale_ref
    )
