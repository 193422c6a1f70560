"""Going on from a trained network: what it fixes, and what must fit it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, replace
from typing import Any

from locsnn_compile.data.recordings import Recordings
from locsnn_compile.errors import InputError
from locsnn_compile.models.description import NetworkDescription
from locsnn_compile.models.windows import WindowParameters
from locsnn_compile.training.config import TrainingConfig

FINE_TUNING: dict[str, Any] = {"epochs": 60, "learning_rate": 0.001, "validation_fraction": 0.0}
"""Options that differ from a run from scratch. A network that was refitted has seen all of the train part, so that
nothing of it could choose an epoch."""


def fixed_by(start: NetworkDescription) -> dict[str, Any]:
    """Return the options that a network to start from decides."""
    order = {} if start.location_order is None else {"order": start.location_order}
    delays = {} if start.delays == (0,) else {"delays": " ".join(map(str, start.delays))}
    return {"model": start.architecture, "hidden": start.hidden} | order | delays | _neuron(start) | _graph(start)


def _neuron(start: NetworkDescription) -> dict[str, Any]:
    if isinstance(start.neuron, WindowParameters):
        windows = asdict(start.neuron) | {"levels": " ".join(map(str, start.neuron.levels))}
        return {f"window_{name}": value for name, value in windows.items()}
    return {} if start.neuron is None else asdict(start.neuron)


def _graph(start: NetworkDescription) -> dict[str, Any]:
    graph = start.graph
    if graph is None:
        return {}
    sizes = {"hops": graph.hops, "features": graph.features, "step_features": graph.step_features}
    return {"graph": graph.name} | sizes


def check_fits_start(values: Mapping[str, Any], start: NetworkDescription) -> None:
    """Refuse given options that contradict the network to start from with an ``InputError``."""
    for name, wanted in fixed_by(start).items():
        if name in values and values[name] != wanted:
            raise InputError(
                f"training option {name!r}",
                "the network to start from has another value",
                measured=f"got {values[name]!r} against {wanted!r}",
                fix="Leave the option out.",
            )


def fine_tuning_config(config: TrainingConfig, start: NetworkDescription) -> TrainingConfig:
    """Return ``config`` with everything that the network to start from decides taken from it."""
    return replace(config, **fixed_by(start))


def check_recordings(start: NetworkDescription, recordings: Recordings, classes: int) -> None:
    """Refuse recordings of another shape, or of more classes, with an ``InputError``."""
    layout, (_, steps, channels) = start.input, recordings.spikes.shape
    for what, got, wanted, fits in (
        ("their steps are not those of", steps, layout.steps, steps == layout.steps),
        ("their channels are not those of", channels, layout.channels, channels == layout.channels),
        ("they have more classes than", classes, start.classes, classes <= start.classes),
    ):
        if not fits:
            raise InputError(
                f"recordings {recordings.source!r}",
                f"{what} the network to start from",
                measured=f"{got} against {wanted}",
                fix="Give recordings like those that it was trained on.",
            )
