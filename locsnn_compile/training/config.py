"""Everything that decides a training run, in one frozen value that a YAML file can hold."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import yaml

from hw_model.arithmetic.weights import WEIGHT_BITS
from hw_model.io.yaml_text import load_yaml
from locsnn_compile.data.taxel_graph import GRAPHS
from locsnn_compile.errors import InputError, did_you_mean
from locsnn_compile.models.architectures import ARCHITECTURES
from locsnn_compile.strategies import TRAINABLE

LOSSES = ("cross-entropy", "spike-count")
OPTIMIZERS = ("adamw", "rmsprop", "sgd")
SCHEDULES = ("cosine", "constant")
DEVICES = ("cpu", "cuda")

USUAL: dict[str, dict[str, Any]] = {
    "tactile-sgnet": {"hidden": 128},
    "hybrid-graph": {"hidden": 128},
    "gru-mlp": {"count_scale": 1.0},
    "cnn-3d": {"count_scale": 1.0},
    "window-snn": {"count_scale": 1.0, "optimizer": "sgd", "learning_rate": 0.005, "weight_decay": 0.0001},
}
"""Network -> options whose usual value is not that of :class:`TrainingConfig`."""

_CHOICES: dict[str, tuple[str | int, ...]] = {
    "model": tuple(ARCHITECTURES),
    "graph": GRAPHS,
    "loss": LOSSES,
    "optimizer": OPTIMIZERS,
    "schedule": SCHEDULES,
    "device": DEVICES,
    "strategy": TRAINABLE,
    "weight_bits": WEIGHT_BITS,
}
#: field -> (smallest, largest) accepted; whole numbers for fields annotated int.
_RANGES: dict[str, tuple[float, float]] = {
    "hidden": (1, 4096),
    "epochs": (1, 100_000),
    "batch_size": (1, 100_000),
    "seed": (0, 2**32 - 1),
    "smoothing_epochs": (1, 1_000),
    "step_seconds": (1e-6, 1e3),
    "steps": (1, 20_000),
    "event_threshold": (0, 20_000_000),
    "psi": (0.0, 1e6),
    "learning_rate": (1e-9, 1e3),
    "weight_decay": (0.0, 1e3),
    "location_weight": (0.0, 1e3),
    "target_right": (0.0, 1e6),
    "target_wrong": (0.0, 1e6),
    "count_scale": (1e-6, 1e3),
    "label_smoothing": (0.0, 0.999),
    "initial_scale": (1e-3, 1e3),
    "event_dropout": (0.0, 1.0),
    "channel_dropout": (0.0, 1.0),
    "taxel_dropout": (0.0, 1.0),
    "time_shift": (0, 20_000),
    "weight_average": (0.0, 0.99999),
    "validation_fraction": (0.0, 0.9),
    "theta": (1e-6, 1e6),
    "tau_sr": (1e-3, 1e5),
    "tau_ref": (1e-3, 1e5),
    "scale_ref": (0.0, 1e6),
    "tau_rho": (1e-6, 1e6),
    "scale_rho": (1e-6, 1e6),
    "decay": (0.0, 1.0),
    "threshold": (1e-6, 1e6),
    "window": (1e-6, 1e6),
    "window_steps": (1, 20_000),
    "window_stride": (1, 20_000),
    "neighbours": (1, 38),
    "nearer_mm": (0.0, 100.0),
    "hops": (1, 16),
    "features": (1, 1024),
    "step_features": (1, 1024),
    "weight_room": (1e-3, 1e3),
    "refractory": (1, 65_535),
    "pruned": (0.0, 0.999),
    "spike_cost": (0.0, 1e3),
}


@dataclass(frozen=True)
class TrainingConfig:
    """A training run, but for its data.

    - ``location_weight`` is lambda of the weighted loss. ``loss`` spike-count uses ``target_right`` and
      ``target_wrong`` (spikes a recording), cross-entropy uses ``count_scale`` and ``label_smoothing``.
    - ``event_dropout``: every recording of a batch loses each event with a probability drawn from 0 to this;
      ``channel_dropout``: likewise each channel, with all its events; ``taxel_dropout``: each taxel, both polarities.
      ``time_shift``: every recording of a batch is moved by up to so many steps to either side.
    - ``weight_average``: measure and keep a running average of the weights, which retains this share of itself at every
      step; 0 keeps the weights of the last step.
    - ``initial_scale``: weights start uniform within +-this / sqrt(inputs of their layer).
    - ``validation_fraction`` of the train part, class by class, chooses the epoch; 0 takes the last epoch.
      Accuracies are averaged over ``smoothing_epochs`` first, for a few dozen validation recordings make a single
      epoch's figure noisy; see :func:`locsnn_compile.training.schedule.choose_epoch`.
    - ``refit``: once the epoch is chosen, train afresh on the whole train part for as many epochs, on a
      schedule of that length.
    - ``device``: where matrix products run; the steps of spiking layers run on the processor.
    - ``step_seconds``: width of a time bin, where the data do not say it; None: single events have 0.02 s, of bins it
      is not known. ``event_threshold``: a bin is 1 where it has more single events (None: 0). ``steps`` of a recording:
      silence follows a shorter one, a longer one is cut (None: the longest one's). ``psi``: how late the time-weighted
      prediction turns to the location branch, which the checkpoint keeps (None: not said).
    - time constants in steps; ``theta`` to ``scale_rho`` are those of spike response neurons, ``decay``, ``threshold``
      and ``window`` those of integrate-and-fire ones.
    - ``delays``: of the synapses from the recording onto the time branch, in steps, separated by spaces: a neuron has a
      synapse of every delay from every channel.
    - ``hidden``: of a hidden layer; of networks with a graph of the first one, and the second has twice as many.
      ``graph`` joins the taxels (``neighbours`` and ``nearer_mm``: see
      :func:`locsnn_compile.data.taxel_graph.taxel_graph`); ``hops``, ``features`` and ``step_features``: see
      :class:`locsnn_compile.models.graph_parameters.GraphParameters`.
    - ``window_steps``, ``window_stride`` and ``window_levels`` (numbers of events, separated by spaces): see
      :class:`locsnn_compile.models.windows.WindowParameters`.
    - ``optimizer`` sgd has a momentum of 0.9.
    - ``target``: ``float``, or the chip whose integers the forward pass computes; there neurons are laid out by
      ``strategy``, weights have ``weight_bits``, and their range is ``weight_room`` times the largest weight of the
      network that the run starts from (from scratch: :data:`locsnn_compile.training.target.USUAL_LARGEST`).
      ``refractory`` is the chip's count, for strategy ``reset``.
    - ``pruned``: this share of each population's weights, the smallest of the start, is 0 and stays so.
    - ``spike_cost`` is added to the loss for every spike of a hidden neuron, averaged over neurons and recordings.
    """

    model: str = "hybrid"
    order: str = "loop"
    delays: str = "0"
    hidden: int = 32
    loss: str = "cross-entropy"
    location_weight: float = 1.0
    target_right: float = 60.0
    target_wrong: float = 3.0
    count_scale: float = 0.1
    label_smoothing: float = 0.05
    optimizer: str = "adamw"
    schedule: str = "cosine"
    learning_rate: float = 0.003
    weight_decay: float = 0.1
    epochs: int = 250
    batch_size: int = 16
    initial_scale: float = 3.0
    event_dropout: float = 0.5
    channel_dropout: float = 0.3
    taxel_dropout: float = 0.0
    time_shift: int = 0
    weight_average: float = 0.0
    validation_fraction: float = 0.125
    smoothing_epochs: int = 10
    refit: bool = True
    seed: int = 0
    device: str = "cpu"
    step_seconds: float | None = None
    steps: int | None = None
    event_threshold: int | None = None
    psi: float | None = None
    theta: float = 10.0
    tau_sr: float = 10.0
    tau_ref: float = 1.0
    scale_ref: float = 2.0
    tau_rho: float = 1.0
    scale_rho: float = 1.0
    decay: float = 0.2
    threshold: float = 0.5
    window: float = 0.5
    graph: str = "manual"
    neighbours: int = 3
    nearer_mm: float = 3.0
    hops: int = 3
    features: int = 64
    step_features: int = 8
    window_steps: int = 6
    window_stride: int = 3
    window_levels: str = "1 2"
    target: str = "float"
    strategy: str = "dendrite"
    weight_bits: int = 8
    weight_room: float = 1.25
    refractory: int = 1
    pruned: float = 0.0
    spike_cost: float = 0.0

    def __post_init__(self) -> None:
        for item in fields(self):
            _check(item.name, str(item.type), getattr(self, item.name))


def config_from_mapping(values: Mapping[str, Any], where: str = "training configuration") -> TrainingConfig:
    """Return the configuration of ``values``, others as usual for the network.

    Raises ``InputError`` for an unknown key or a value of the wrong kind.
    """
    known = {item.name: str(item.type) for item in fields(TrainingConfig)}
    clean: dict[str, Any] = dict(USUAL.get(str(values.get("model")), {}))
    for key, value in values.items():
        if key not in known:
            raise InputError(where, f"key {key!r} is not known", fix=did_you_mean(str(key), known))
        is_int = isinstance(value, int) and not isinstance(value, bool)
        clean[key] = float(value) if is_int and known[key].startswith("float") else value
    return TrainingConfig(**clean)


def read_config(path: Path | str) -> dict[str, Any]:
    """Return the mapping of a YAML file, its keys checked; options given elsewhere may be laid over it.

    Raises ``InputError`` for a missing file, what is not a YAML mapping, and keys or values that do not fit.
    """
    path = Path(path)
    where = f"config {path.name!r}"
    try:
        if path.stat().st_size > 1_000_000:
            raise InputError(where, "it is too large for a configuration", fix="Give the YAML file of a training run.")
        values = load_yaml(path.read_text(encoding="utf-8"), where)
    except OSError as error:
        raise InputError(where, "it cannot be read", measured=error.strerror or "", fix="Check the path.") from None
    except (yaml.YAMLError, ValueError):
        raise InputError(where, "it is not a YAML file", fix="Write one 'key: value' a line.") from None
    if not isinstance(values, dict):
        raise InputError(
            where, "it holds no mapping", measured=type(values).__name__, fix="Write one 'key: value' a line."
        )
    config_from_mapping(values, where)
    return values


def _check(name: str, kind: str, value: object) -> None:
    where = f"training option {name!r}"
    kind, _, optional = kind.partition(" | ")
    if optional and value is None:
        return
    wanted: dict[str, tuple[type, ...]] = {
        "int": (int,),
        "float": (float, int),
        "str": (str,),
        "bool": (bool,),
    }
    if not isinstance(value, wanted[kind]) or (isinstance(value, bool) and kind != "bool"):
        words = {"int": "a whole number", "float": "a number", "str": "text", "bool": "true or false"}
        fix = "Put it in quotes." if kind == "str" else "Correct the value."
        raise InputError(where, f"it must be {words[kind]}", measured=f"got {value!r}", fix=fix)
    if name in _CHOICES and value not in _CHOICES[name]:
        known = [str(choice) for choice in _CHOICES[name]]
        raise InputError(where, f"{value!r} is not known", fix=did_you_mean(str(value), known))
    if name in _RANGES:
        low, high = _RANGES[name]
        assert isinstance(value, int | float)
        if not (math.isfinite(value) and low <= value <= high):
            raise InputError(
                where,
                "it is out of range",
                measured=f"got {value!r} against {low:g}..{high:g}",
                fix="Correct the value.",
            )
