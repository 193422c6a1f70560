"""From a configuration to a network, and from a network to start from to the options that it determines."""

from collections.abc import Mapping
from dataclasses import asdict, fields, replace
from typing import Any

from hw_model.values import picked
from locsnn_compile.data.orders import location_order, order_text
from locsnn_compile.data.recordings import MAX_STEPS, Recordings
from locsnn_compile.data.selection import SELECTING
from locsnn_compile.data.sensor import (
    POLARITIES,
    TAXELS,
    SensorLayout,
    grid_layout,
    neutouch,
)
from locsnn_compile.data.taxel_graph import taxel_graph
from locsnn_compile.errors import InputError, check_most, check_same
from locsnn_compile.models.architectures import ARCHITECTURES
from locsnn_compile.models.checkpoint import Checkpoint
from locsnn_compile.models.description import (
    InputLayout,
    LifParameters,
    NetworkDescription,
    Neuron,
    NeuronParameters,
    XyloParameters,
)
from locsnn_compile.models.graph_and_windows import GraphParameters, WindowParameters
from locsnn_compile.training.config import LOCATION_CONSTANTS, TrainingConfig, config_from_mapping


def describe(
    recordings: Recordings, config: TrainingConfig, classes: int, name: str = "model"
) -> NetworkDescription:
    """Return the network that ``config`` asks for on data of this shape; ``InputError`` if they do not fit."""
    channels = recordings.spikes.shape[2]
    sensor = config.sensor or grid_layout(recordings.channels)
    sensor = sensor or neutouch(max(1, channels // (TAXELS * POLARITIES)))
    sensor.check_channels(channels, f"recordings {recordings.source!r}")
    steps = recordings.spikes.shape[1]
    fix = "Cut them with --steps, use wider bins, or allow more with --max-steps."
    check_most(
        steps,
        max(MAX_STEPS, config.steps or 0, config.max_steps or 0),
        f"recordings {recordings.source!r}",
        "they are too long",
        unit="steps",
        fix=fix,
    )
    structure = ARCHITECTURES[config.model]
    neuron, location_neuron = _neuron(config), _neuron(config, location=True)
    located = "location" in structure.branches
    order, taxels = location_order(order_text(config.order), sensor) if located else (None, None)
    return NetworkDescription(
        architecture=config.model,
        input=InputLayout(
            sensor, steps, recordings.step_seconds or config.step_seconds, recordings.threshold
        ),
        classes=classes,
        **picked(config, "hidden", "align_events"),
        neuron=neuron,
        location_neuron=location_neuron if located and location_neuron != neuron else None,
        location_order=order,
        location_taxels=taxels,
        name=name,
        graph=_graph(config, sensor) if structure.graph else None,
        delays=_whole_numbers("delays", config.delays, "0 20 40 60"),
        location_delays=_whole_numbers("location_delays", config.location_delays, "0 20 40 60"),
        class_names=recordings.class_names,
        window=_windows(config) if structure.window_branch else None,
    )


def _whole_numbers(option: str, text: str, example: str) -> tuple[int, ...]:
    """Return the numbers of an option, separated by spaces or commas; ``InputError`` for anything else."""
    parts = text.replace(",", " ").split()
    if not all(part.isascii() and part.isdigit() and len(part) < 9 for part in parts):
        measured, fix = f"got {text[:60]!r}", f"Give, for example, {example!r}."
        raise InputError(
            f"training option {option!r}", "it must be whole numbers", measured=measured, fix=fix
        )
    return tuple(int(part) for part in parts)


def _neuron(config: TrainingConfig, *, location: bool = False) -> Neuron | None:
    """Return the constants of the neurons, which have the names of options; location constants take precedence."""
    neurons = ARCHITECTURES[config.model].neurons
    if neurons == "xylo":
        dash_syn = _whole_numbers("dash_syn", config.dash_syn, "2 4")
        dash_mem = _whole_numbers("dash_mem", config.dash_mem, "2 4")
        return XyloParameters(dash_syn, dash_mem, config.window)
    if neurons not in LOCATION_CONSTANTS:
        return None
    kind = NeuronParameters if neurons == "srm" else LifParameters
    values = {item.name: getattr(config, item.name) for item in fields(kind)}
    own = {
        name: getattr(config, f"location_{name}")
        for name in (LOCATION_CONSTANTS[neurons] if location else ())
    }
    return kind(**values | {name: value for name, value in own.items() if value is not None})


def _windows(config: TrainingConfig) -> WindowParameters:
    levels = _whole_numbers("window_levels", config.window_levels, "1 2")
    return WindowParameters(config.window_steps, config.window_stride, levels)


def _graph(config: TrainingConfig, sensor: SensorLayout) -> GraphParameters:
    edges = taxel_graph(
        config.graph, sensor, neighbours=config.neighbours, nearer_mm=config.nearer_mm
    )
    return GraphParameters(config.graph, edges, config.hops, config.features, config.step_features)


FINE_TUNING: dict[str, Any] = {"epochs": 60, "learning_rate": 0.001, "validation_fraction": 0.0}
"""Options that differ from a run from scratch. A network that was refitted has seen the whole train part, so no share
of it could choose an epoch."""


def fixed_by(start: NetworkDescription) -> dict[str, Any]:
    """Return the options that are determined by the network to start from."""
    found: dict[str, Any] = {
        "model": start.architecture,
        "hidden": start.hidden,
        "align_events": start.align_events,
    }
    names = (name for kind in LOCATION_CONSTANTS.values() for name in kind)
    found |= {f"location_{name}": getattr(start.location_neuron, name, None) for name in names}
    found |= {
        name: " ".join(map(str, getattr(start, name))) for name in ("delays", "location_delays")
    }
    if start.location_order is not None:
        found["order"] = start.location_order
    if start.structure.window_branch:
        windows = asdict(start.windows) | {"levels": " ".join(map(str, start.windows.levels))}
        found |= {f"window_{name}": value for name, value in windows.items()}
    if start.neuron is not None:
        found |= asdict(start.neuron)
    if isinstance(start.neuron, XyloParameters):
        found |= {
            name: " ".join(map(str, getattr(start.neuron, name)))
            for name in ("dash_syn", "dash_mem")
        }
    if (graph := start.graph) is not None:
        found |= {"graph": graph.name} | {
            key: getattr(graph, key) for key in ("hops", "features", "step_features")
        }
    return found


_OF_SENSOR = ("grid", "polarities", "channels", "layout", "columns", *SELECTING)
"""Options that say what the sensor is, and what the network gets of it."""


def check_fits_start(values: Mapping[str, Any], start: NetworkDescription) -> None:
    """Raise ``InputError`` for a given option that contradicts the network to start from."""
    of_sensor = {name: value for name, value in values.items() if name in _OF_SENSOR}
    asked = config_from_mapping(of_sensor).sensor
    own = start.input.sensor
    if asked is not None and asked != own:
        what = "the network to start from has another layout"
        raise InputError(
            f"sensor {asked.name!r}",
            what,
            measured=f"sensor {own.name!r}",
            fix="Leave the option out.",
        )
    for name, wanted in fixed_by(start).items():
        if name in values and values[name] != wanted:
            what, measured = (
                "the network to start from has another value",
                f"got {values[name]!r} against {wanted!r}",
            )
            raise InputError(
                f"training option {name!r}", what, measured=measured, fix="Leave the option out."
            )


def fine_tuning_config(config: TrainingConfig, start: NetworkDescription) -> TrainingConfig:
    """Return ``config`` with the options that are determined by the network to start from."""
    return replace(config, **fixed_by(start))


def class_for_ties(
    config: TrainingConfig, description: NetworkDescription, start: Checkpoint | None
) -> int | None:
    """Return the class that ties predict: as asked for, else that of the network to start from; None for no class.

    A name is looked for among the classes before a number.
    """
    if config.tie is None:
        return None if start is None else start.tie_class
    names = description.class_names or ()
    if config.tie in names:
        return names.index(config.tie)
    if config.tie.isascii() and config.tie.isdigit() and len(config.tie) < 9:
        number = int(config.tie)
        if number < description.classes:
            return number
    known = f"{', '.join(names)[:80]}; " if names else ""
    raise InputError(
        "training option 'tie'",
        f"no class is called {config.tie[:40]!r}",
        fix=f"Give a class: {known}numbers from 0 to {description.classes - 1}.",
    )


def check_recordings(start: NetworkDescription, recordings: Recordings, classes: int) -> None:
    """Raise ``InputError`` for recordings of another shape, or with more classes."""
    layout, (_, steps, channels) = start.input, recordings.spikes.shape
    where, fix = (
        f"recordings {recordings.source!r}",
        "Give recordings like those that it was trained on.",
    )
    check_same(
        steps,
        layout.steps,
        where,
        "their steps are not those of the network to start from",
        fix=fix,
    )
    check_same(
        channels,
        layout.channels,
        where,
        "their channels are not those of the network to start from",
        fix=fix,
    )
    check_most(
        classes,
        start.classes,
        where,
        "they have more classes than the network to start from",
        fix=fix,
    )
