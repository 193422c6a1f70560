"""Ways of training that ``try_training.py`` compares, as ``tried_settings.yaml`` names them, and the folds that they share.

Every way learns from some recordings of the train part and returns a scorer: log-probabilities (samples, classes) of spikes
(samples, steps, channels).
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
Floats = NDArray[np.float64]
Rows = NDArray[np.int64]
Scorer = Callable[[NDArray[np.uint8]], Floats]


def folds(labels: Rows, repeat: int) -> Rows:
    """Return the fold 0..3 of each recording, every class spread evenly, (samples,)."""
    rng = epoch_generator(repeat, 77)
    found = np.empty(len(labels), dtype=np.int64)
    for label in np.unique(labels):
        rows = rng.permutation(np.flatnonzero(labels == label))
        found[rows] = (np.arange(len(rows)) + rng.integers(FOLDS)) % FOLDS
    return found


@dataclass(frozen=True)
class Division:
    """The train part of a data set, divided into folds the ``repeat``-th time.

    ``work``: the folder of what was made, ``data``: that of the recordings, ``known``: all ways by their names.
    """

    dataset: str
    recordings: Recordings
    repeat: int
    work: Path
    data: Path
    known: Mapping[str, Way] = field(default_factory=dict)

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

    ``begin``: the setting whose network, of the same recordings, it begins with.
    """

    label: str
    options: Mapping[str, Any] = field(default_factory=dict)
    config: str = "window-snn"
    begin: str | None = None

    def config_of(self, dataset: str, repeat: int) -> TrainingConfig:
        """Return what it trains with: no validation part, one phase, a seed for each repeat."""
        values = read_config(ROOT / f"examples/configs/{dataset}-{self.config}.yaml") | dict(
            self.options
        )
        return config_from_mapping(
            values | {"seed": repeat, "validation_fraction": 0.0, "refit": False}
        )

    def trained(self, of: Division, rows: Rows) -> tuple[TrainingConfig, TouchModel]:
        from fold_networks import learned

        config = self.config_of(of.dataset, of.repeat)
        start = None if self.begin is None else learned(self.begin, of, rows)
        return config, train(
            of.recordings.subset(rows), config, classes=of.classes, start=start
        ).network

    def learn(self, of: Division, rows: Rows) -> Scorer:
        config, network = self.trained(of, rows)
        return lambda spikes: log_probabilities(config.count_scale * class_scores(network, spikes))


@dataclass(frozen=True)
class Committee:
    """Settings whose log-probabilities are added, each times its weight: nothing is trained."""

    label: str
    members: Mapping[str, float]


@dataclass(frozen=True)
class Distilled:
    """A setting that learns as much from what ``teachers`` say of a recording as ``weight`` says, the rest from its label."""

    label: str
    teachers: tuple[str, ...]
    student: str = "base"
    weight: float = 0.5

    def learn(self, of: Division, rows: Rows) -> Scorer:
        from distilling import distilled

        return distilled(self, of, rows)


@dataclass(frozen=True)
class Nearest:
    """The nearest prototype, the mean of the recordings of a class and of copies ``moved`` in time; see ``nearest.py``."""

    label: str
    smooth: float | None = None
    both_sets: bool = False
    moved: int = 0

    def learn(self, of: Division, rows: Rows) -> Scorer:
        from nearest import nearest_prototype

        return nearest_prototype(self, of, rows)


@dataclass(frozen=True)
class Coarse:
    """A setting of windows whose weights have so many ``bits`` on the chip, rounded after or in training; see ``coarse.py``.

    ``room``: the range of weights that are trained on the chip's integers, over the usual one.
    """

    label: str
    setting: str
    bits: int
    in_training: bool = False
    room: float = 1.25

    def learn(self, of: Division, rows: Rows) -> Scorer:
        from coarse import coarse

        return coarse(self, of, rows)


@dataclass(frozen=True)
class Joined:
    """A hybrid and windows, one or several (``parts``), as one network on the chip by a ``strategy``; see ``joining.py``."""

    label: str
    parts: tuple[str, ...]
    strategy: str

    def learn(self, of: Division, rows: Rows) -> Scorer:
        from joining import joined_on_chip

        return joined_on_chip(self, of, rows)


Way = Setting | Committee | Distilled | Nearest | Coarse | Joined
KINDS: Mapping[str, type[Any]] = {
    "members": Committee,
    "teachers": Distilled,
    "smooth": Nearest,
    "bits": Coarse,
    "parts": Joined,
}
"""The key that only ways of a kind have; the others are settings."""


def settings_of(path: Path) -> dict[str, Way]:
    """Return the ways of a YAML file by their short names."""
    import yaml

    found: dict[str, Way] = {}
    for name, entry in yaml.safe_load(path.read_text(encoding="utf-8")).items():
        kind = next((kind for key, kind in KINDS.items() if key in entry), Setting)
        found[name] = kind(**entry)
    return found


def log_probabilities(logits: Floats) -> Floats:
    """Return the logarithms of the softmax over the last axis."""
    top = logits.max(axis=-1, keepdims=True)
    return np.asarray(logits - top - np.log(np.exp(logits - top).sum(axis=-1, keepdims=True)))
