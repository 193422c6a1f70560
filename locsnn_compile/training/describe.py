"""Describe the network that the options of a run ask for.

And the other way round, for fine-tuning: which options an existing network, the one to start from, determines, and
whether the options and recordings of a run fit it.
"""

from collections.abc import Mapping, Sequence
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
    """Return the network that ``config`` asks for on such recordings; ``InputError`` if they do not fit."""
    channels = recordings.spikes.shape[2]
    # The sensor that options describe, else the grid that the recordings state, else NeuTouch.
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
    neuron = _neuron(config)
    location_neuron = None
    order = None
    taxels = None
    if "location" in structure.branches:
        order, taxels = location_order(order_text(config.order), sensor)
        location_neuron = _neuron(config, location=True)
        if location_neuron == neuron:
            location_neuron = None
    return NetworkDescription(
        architecture=config.model,
        input=InputLayout(
            sensor=sensor,
            steps=steps,
            step_seconds=recordings.step_seconds or config.step_seconds,
            event_threshold=recordings.threshold,
        ),
        classes=classes,
        **picked(config, "hidden", "align_events"),
        neuron=neuron,
        location_neuron=location_neuron,
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
    """Return the constants of the neurons, which are options of the same names; None if there are no such neurons.

    With ``location``, options such as ``location_theta`` take precedence, if they are given.
    """
    neurons = ARCHITECTURES[config.model].neurons
    if neurons == "xylo":
        dash_syn = _whole_numbers("dash_syn", config.dash_syn, "2 4")
        dash_mem = _whole_numbers("dash_mem", config.dash_mem, "2 4")
        return XyloParameters(dash_syn, dash_mem, config.window)
    if neurons not in LOCATION_CONSTANTS:
        return None
    kind = NeuronParameters if neurons == "srm" else LifParameters
    values = {constant.name: getattr(config, constant.name) for constant in fields(kind)}
    if location:
        for name in LOCATION_CONSTANTS[neurons]:
            location_value = getattr(config, f"location_{name}")
            if location_value is not None:
                values[name] = location_value
    return kind(**values)


def _windows(config: TrainingConfig) -> WindowParameters:
    """Return the windows that options ask for."""
    levels = _whole_numbers("window_levels", config.window_levels, "1 2")
    return WindowParameters(config.window_steps, config.window_stride, levels)


def _graph(config: TrainingConfig, sensor: SensorLayout) -> GraphParameters:
    """Return the graph convolutions that options ask for, on the taxels of a sensor."""
    edges = taxel_graph(
        config.graph, sensor, neighbours=config.neighbours, nearer_mm=config.nearer_mm
    )
    return GraphParameters(config.graph, edges, config.hops, config.features, config.step_features)


FINE_TUNING: dict[str, Any] = {"epochs": 60, "learning_rate": 0.001, "validation_fraction": 0.0}
"""Defaults of fine-tuning that differ from those of a run from scratch; the first two were chosen by hand. Nothing is
held out for validation, because the network to start from has been trained on the whole train part, so its accuracy on
any share of it says nothing."""


def fixed_by(start: NetworkDescription) -> dict[str, Any]:
    """Return the options, name -> value, that the network to start from determines."""
    options: dict[str, Any] = {
        "model": start.architecture,
        "hidden": start.hidden,
        "align_events": start.align_events,
    }
    for constants in LOCATION_CONSTANTS.values():
        for name in constants:
            options[f"location_{name}"] = getattr(start.location_neuron, name, None)
    options["delays"] = _option_text(start.delays)
    options["location_delays"] = _option_text(start.location_delays)
    if start.location_order is not None:
        options["order"] = start.location_order
    if start.structure.window_branch:
        options["window_steps"] = start.windows.steps
        options["window_stride"] = start.windows.stride
        options["window_levels"] = _option_text(start.windows.levels)
    if start.neuron is not None:
        options |= asdict(start.neuron)
    if isinstance(start.neuron, XyloParameters):
        options["dash_syn"] = _option_text(start.neuron.dash_syn)
        options["dash_mem"] = _option_text(start.neuron.dash_mem)
    if start.graph is not None:
        options["graph"] = start.graph.name
        options |= picked(start.graph, "hops", "features", "step_features")
    return options


def _option_text(numbers: Sequence[int]) -> str:
    """Return numbers as an option that takes several has them, separated by spaces."""
    return " ".join(map(str, numbers))


_OF_SENSOR = ("grid", "polarities", "channels", "layout", "columns", *SELECTING)
"""Options that describe the sensor, or select which of its channels the network gets."""


def check_fits_start(values: Mapping[str, Any], start: NetworkDescription) -> None:
    """Raise ``InputError`` for a given option that contradicts the network to start from."""
    of_sensor = {name: value for name, value in values.items() if name in _OF_SENSOR}
    option_sensor = config_from_mapping(of_sensor).sensor
    start_sensor = start.input.sensor
    if option_sensor is not None and option_sensor != start_sensor:
        what = "the network to start from has another layout"
        raise InputError(
            f"sensor {option_sensor.name!r}",
            what,
            measured=f"sensor {start_sensor.name!r}",
            fix="Leave the option out.",
        )
    for name, start_value in fixed_by(start).items():
        if name in values and values[name] != start_value:
            what = "the network to start from has another value"
            measured = f"got {values[name]!r} against {start_value!r}"
            raise InputError(
                f"training option {name!r}", what, measured=measured, fix="Leave the option out."
            )


def fine_tuning_config(config: TrainingConfig, start: NetworkDescription) -> TrainingConfig:
    """Return ``config`` with the options that are determined by the network to start from."""
    return replace(config, **fixed_by(start))


def class_for_ties(
    config: TrainingConfig, description: NetworkDescription, start: Checkpoint | None
) -> int | None:
    """Return the class that is predicted if the scores of all classes are equal; None for no class.

    It is the option ``tie``, or else that of the network to start from. The option is looked up among the names of the
    classes before it is taken for a number. Raises ``InputError`` if it is neither.
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
    choices = f"{', '.join(names)[:80]}; " if names else ""
    raise InputError(
        "training option 'tie'",
        f"no class is called {config.tie[:40]!r}",
        fix=f"Give a class: {choices}numbers from 0 to {description.classes - 1}.",
    )


def check_recordings(start: NetworkDescription, recordings: Recordings, classes: int) -> None:
    """Raise ``InputError`` for recordings of another shape than the network takes, or with more classes."""
    layout = start.input
    _, steps, channels = recordings.spikes.shape
    where = f"recordings {recordings.source!r}"
    fix = "Give recordings like those that it was trained on."
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
