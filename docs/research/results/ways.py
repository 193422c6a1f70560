"""Ways of training that ``try_training.py`` compares, as ``tried_settings.yaml`` names them, and the folds that they share.

Every way has a method ``learn``: it learns from some recordings of the train part and returns a scorer, which gives
log-probabilities (samples, classes) of spikes (samples, steps, channels). So networks, committees and prototypes are compared
alike. Some ways import their modules when they are used, because these modules import this one.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from locsnn_compile.data.recordings import Recordings
from locsnn_compile.models.touch_model import TouchModel
from locsnn_compile.training.batches import epoch_generator
from locsnn_compile.training.config import TrainingConfig, config_from_mapping, read_config
from locsnn_compile.training.measure import class_scores
from locsnn_compile.training.train import train

ROOT = Path(__file__).parents[3]
FOLDS = 4
FOLDS_STREAM = 77
"""The purpose of these random numbers, as :func:`epoch_generator` takes it: another number than for any other purpose."""
Floats = NDArray[np.float64]
Rows = NDArray[np.int64]
"""Numbers of recordings of the train part, or one value for each of them."""
Scorer = Callable[[NDArray[np.uint8]], Floats]


def folds(labels: Rows, repeat: int) -> Rows:
    """Return the fold 0..3 of each recording, every class spread evenly, (samples,)."""
    rng = epoch_generator(repeat, FOLDS_STREAM)
    fold_of_recording = np.empty(len(labels), dtype=np.int64)
    for label in np.unique(labels):
        rows = rng.permutation(np.flatnonzero(labels == label))
        # Each class begins with another fold, or fold 0 would get the odd recordings of all of them.
        fold_of_recording[rows] = (np.arange(len(rows)) + rng.integers(FOLDS)) % FOLDS
    return fold_of_recording


@dataclass(frozen=True)
class Division:
    """The train part of a data set, divided into folds in its ``repeat``-th way.

    ``work``: the folder of networks and scores, ``data``: that of the recordings. ``way_of_name``: all ways, because a way may
    name others.
    """

    dataset: str
    recordings: Recordings
    repeat: int
    work: Path
    data: Path
    way_of_name: Mapping[str, Way] = field(default_factory=dict)

    @property
    def labels(self) -> Rows:
        assert self.recordings.labels is not None
        return self.recordings.labels

    @property
    def classes(self) -> int:
        return 1 + int(self.labels.max())

    @property
    def fold(self) -> Rows:
        return folds(self.labels, self.repeat)


@dataclass(frozen=True)
class Setting:
    """Training with options over ``examples/configs/DATASET-CONFIG.yaml``.

    ``begin``: a setting; its network, trained on the same recordings, is the one to begin with.
    """

    label: str
    options: Mapping[str, Any] = field(default_factory=dict)
    config: str = "window-snn"
    begin: str | None = None

    def config_of(self, dataset: str, repeat: int) -> TrainingConfig:
        """Return the training options: no validation part and one phase, so that nothing is chosen; a seed for each repeat."""
        values = read_config(ROOT / f"examples/configs/{dataset}-{self.config}.yaml") | dict(
            self.options
        )
        return config_from_mapping(
            values | {"seed": repeat, "validation_fraction": 0.0, "refit": False}
        )

    def trained(self, division: Division, rows: Rows) -> tuple[TrainingConfig, TouchModel]:
        from fold_networks import learned

        config = self.config_of(division.dataset, division.repeat)
        start = None if self.begin is None else learned(self.begin, division, rows)
        return config, train(
            division.recordings.subset(rows), config, classes=division.classes, start=start
        ).network

    def learn(self, division: Division, rows: Rows) -> Scorer:
        config, network = self.trained(division, rows)
        return lambda spikes: log_probabilities(config.count_scale * class_scores(network, spikes))


@dataclass(frozen=True)
class Committee:
    """Settings whose log-probabilities are added, each times its weight: nothing is trained."""

    label: str
    members: Mapping[str, float]


@dataclass(frozen=True)
class Distilled:
    """A setting, ``student``, that learns from labels and from what ``teachers`` predict, which has ``weight`` in its loss."""

    label: str
    teachers: tuple[str, ...]
    student: str = "base"
    weight: float = 0.5

    def learn(self, division: Division, rows: Rows) -> Scorer:
        from distilling import distilled

        return distilled(self, division, rows)


@dataclass(frozen=True)
class Nearest:
    """The nearest prototype, the mean of a class's recordings and of copies ``moved`` by so many steps; see ``nearest.py``.

    ``smooth`` and ``both_sets``: the distance, see :func:`nearest.metric`.
    """

    label: str
    smooth: float | None = None
    both_sets: bool = False
    moved: int = 0

    def learn(self, division: Division, rows: Rows) -> Scorer:
        from nearest import nearest_prototype

        return nearest_prototype(self, division, rows)


@dataclass(frozen=True)
class Coarse:
    """A setting of windows whose weights have so many ``bits`` on the chip; see ``coarse.py``.

    They are rounded after training, or ``in_training``. ``room``: the range of weights that are trained on the chip's integers,
    as a multiple of the usual one.
    """

    label: str
    setting: str
    bits: int
    in_training: bool = False
    room: float = 1.25

    def learn(self, division: Division, rows: Rows) -> Scorer:
        from coarse import coarse

        return coarse(self, division, rows)


@dataclass(frozen=True)
class Joined:
    """A hybrid and one or several networks of windows (``parts``, settings), joined to one network; see ``joining.py``.

    ``strategy``: how the hybrid's neurons are built on the chip.
    """

    label: str
    parts: tuple[str, ...]
    strategy: str

    def learn(self, division: Division, rows: Rows) -> Scorer:
        from joining import joined_on_chip

        return joined_on_chip(self, division, rows)


Way = Setting | Committee | Distilled | Nearest | Coarse | Joined
KINDS: Mapping[str, type[Any]] = {
    "members": Committee,
    "teachers": Distilled,
    "smooth": Nearest,
    "bits": Coarse,
    "parts": Joined,
}
"""The kind of a way, by a key that only entries of this kind have; entries with none of these keys are settings."""


def settings_of(path: Path) -> dict[str, Way]:
    """Return the ways of a YAML file by their short names."""
    import yaml

    ways: dict[str, Way] = {}
    for name, entry in yaml.safe_load(path.read_text(encoding="utf-8")).items():
        kind = next((kind for key, kind in KINDS.items() if key in entry), Setting)
        ways[name] = kind(**entry)
    return ways


def log_probabilities(logits: Floats) -> Floats:
    """Return the logarithms of the softmax over the last axis."""
    largest = logits.max(axis=-1, keepdims=True)
    return np.asarray(
        logits - largest - np.log(np.exp(logits - largest).sum(axis=-1, keepdims=True))
    )
