"""The network that a training configuration asks for, on data of a shape."""

from __future__ import annotations

from locsnn_compile.data.recordings import Recordings
from locsnn_compile.data.sensor import POLARITIES, TAXELS, parse_location_order
from locsnn_compile.data.taxel_graph import taxel_graph
from locsnn_compile.errors import InputError
from locsnn_compile.models.architectures import ARCHITECTURES
from locsnn_compile.models.description import InputLayout, LifParameters, NetworkDescription, NeuronParameters
from locsnn_compile.models.graph_parameters import GraphParameters
from locsnn_compile.models.windows import WindowParameters
from locsnn_compile.training.config import TrainingConfig


def describe(recordings: Recordings, config: TrainingConfig, classes: int, name: str = "model") -> NetworkDescription:
    """Return the network that ``config`` asks for on data of this shape; ``InputError`` where it does not
    fit.
    """
    channels = recordings.spikes.shape[2]
    per_fingertip = TAXELS * POLARITIES
    if channels % per_fingertip:
        raise InputError(
            f"recordings {recordings.source!r}",
            "their channels are not those of whole fingertips",
            measured=f"{channels} channels against multiples of {per_fingertip}",
            fix="Give recordings of one or two NeuTouch fingertips.",
        )
    order: str | None = None
    taxels: tuple[int, ...] | None = None
    structure = ARCHITECTURES[config.model]
    if "location" in structure.branches:
        order, taxels = parse_location_order(config.order)
    return NetworkDescription(
        architecture=config.model,
        input=InputLayout(
            fingertips=channels // per_fingertip,
            steps=recordings.spikes.shape[1],
            step_seconds=recordings.step_seconds or config.step_seconds,
            event_threshold=recordings.threshold,
        ),
        classes=classes,
        hidden=config.hidden,
        neuron=_neuron(config),
        location_order=order,
        location_taxels=taxels,
        name=name,
        graph=_graph(config) if structure.graph else None,
        delays=_whole_numbers("delays", config.delays, "0 20 40 60"),
    )


def _whole_numbers(option: str, text: str, example: str) -> tuple[int, ...]:
    """Return the numbers of an option, separated by spaces or commas; ``InputError`` for what are none."""
    parts = text.replace(",", " ").split()
    if not all(part.isascii() and part.isdigit() and len(part) < 9 for part in parts):
        raise InputError(
            f"training option {option!r}",
            "it must be whole numbers",
            measured=f"got {text[:60]!r}",
            fix=f"Give, for example, {example!r}.",
        )
    return tuple(int(part) for part in parts)


def _neuron(config: TrainingConfig) -> NeuronParameters | LifParameters | WindowParameters | None:
    neurons = ARCHITECTURES[config.model].neurons
    if neurons == "srm":
        return NeuronParameters(
            config.theta, config.tau_sr, config.tau_ref, config.scale_ref, config.tau_rho, config.scale_rho
        )
    if neurons == "windows":
        levels = _whole_numbers("window_levels", config.window_levels, "1 2")
        return WindowParameters(config.window_steps, config.window_stride, levels)
    return LifParameters(config.decay, config.threshold, config.window) if neurons == "lif" else None


def _graph(config: TrainingConfig) -> GraphParameters:
    edges = taxel_graph(config.graph, neighbours=config.neighbours, nearer_mm=config.nearer_mm)
    return GraphParameters(config.graph, edges, config.hops, config.features, config.step_features)
