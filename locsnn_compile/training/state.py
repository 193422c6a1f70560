"""What a run keeps: a state from which a killed run goes on to the same bits, its chosen epoch, averaged weights."""

import hashlib
import io
import math
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from hw_model.io.files import replace_file
from locsnn_compile.data.recordings import Recordings
from locsnn_compile.errors import InputError
from locsnn_compile.models.checkpoint import Checkpoint
from locsnn_compile.training.config import EpochRecord, TrainingConfig

_FORMAT, _VERSION = "locsnn-training-state", 2


@dataclass
class TrainingState:
    """What a run needs to go on: its phase (``select`` or ``refit``), epochs done there, and what was best."""

    phase: str = "select"
    epoch: int = 0
    weights: dict[str, Tensor] = field(default_factory=dict)
    averages: dict[str, Tensor] = field(default_factory=dict)
    optimizer: dict[str, Any] = field(default_factory=dict)
    history: list[EpochRecord] = field(default_factory=list)
    chosen_epoch: int = 0
    chosen_weights: dict[str, Tensor] = field(default_factory=dict)


def run_key(config: TrainingConfig, recordings: Recordings, start: Checkpoint | None = None) -> str:
    """Return the sha256 over configuration, recordings and the checkpoint at the start: a state belongs to one key."""
    digest = hashlib.sha256(repr(sorted(asdict(config).items())).encode())
    if start is not None:
        digest.update(start.sha256.encode())
    digest.update(repr(recordings.spikes.shape).encode())
    digest.update(np.ascontiguousarray(recordings.spikes).tobytes())
    if recordings.labels is not None:
        digest.update(recordings.labels.tobytes())
    return digest.hexdigest()


def save_state(path: Path, state: TrainingState, key: str) -> None:
    """Write ``state`` whole or not at all."""
    history = [asdict(record) for record in state.history]
    values = {"format": _FORMAT, "version": _VERSION, "key": key, **vars(state), "history": history}
    content = io.BytesIO()
    torch.save(values, content)
    replace_file(path, content.getvalue(), f"training state {path.name!r}")


def load_state(path: Path, key: str) -> TrainingState | None:
    """Return the state at ``path`` or None where there is none.

    Raises ``InputError`` for a file that is no such state and for the state of another run.
    """
    if not path.exists():
        return None
    where, fix = f"training state {path.name!r}", "Delete it, or train without --resume."
    try:
        values = torch.load(path, map_location="cpu", weights_only=True)
        if values["format"] != _FORMAT or values["version"] != _VERSION:
            raise InputError(where, "it was written by another version", fix=fix)
        if values["key"] != key:
            raise InputError(where, "it belongs to a run with other options or other data", fix=fix)
        held = {name: values[name] for name in TrainingState.__dataclass_fields__}
        return TrainingState(**held | {"history": [EpochRecord(**record) for record in held["history"]]})
    except InputError:
        raise
    # Torch meets damaged bytes, or a part of a file, with many kinds of exception; each means the same to the user.
    except Exception:
        raise InputError(where, "it is damaged", fix=fix) from None


def learning_rate(config: TrainingConfig, epoch: int, epochs: int) -> float:
    """Return the rate of epoch 1..``epochs``: constant, or half a cosine, lr * (1 + cos(pi (epoch - 1) / epochs)) / 2.

    A refit has as many ``epochs`` as were chosen, so that it, too, ends with settled weights.
    """
    if config.schedule == "constant":
        return config.learning_rate
    return config.learning_rate * 0.5 * (1.0 + math.cos(math.pi * (epoch - 1) / epochs))


def choose_epoch(history: list[EpochRecord], smoothing_epochs: int, held: int) -> int:
    """Return the epoch that validation on ``held`` recordings chooses; the last one where there is no validation.

    Accuracies are averaged over ``smoothing_epochs`` epochs up to each; chosen is the latest epoch whose average is
    within one standard error, sqrt(p (1 - p) / held), of the best p: a smaller difference is chance, and a later epoch
    has the more settled weights of the lower learning rate (the rule of Breiman et al. 1984, sec. 3.4.3).
    """
    rows = [row for row in history if row.phase == "select"]
    accuracy = np.array([row.validation_accuracy for row in rows if row.validation_accuracy is not None])
    if not len(accuracy):
        return rows[-1].epoch
    sums = np.concatenate([[0.0], np.cumsum(accuracy)])
    ends = np.arange(1, len(accuracy) + 1)
    starts = np.maximum(ends - smoothing_epochs, 0)
    averages = (sums[ends] - sums[starts]) / (ends - starts)
    best = min(float(averages.max()), 1.0)
    # The slack keeps equal averages equal, whatever the order their sums were rounded in.
    near = averages >= best - math.sqrt(best * (1 - best) / held) - 1e-9
    return rows[int(np.flatnonzero(near)[-1])].epoch


class WeightAverage:
    """average = decay * average + (1 - decay) * weights after every step; with decay 0 it is the weights themselves.

    ``values`` are by parameter name, to go on from; without them it begins at the network's weights.
    """

    def __init__(self, network: nn.Module, decay: float, values: Mapping[str, Tensor]) -> None:
        self._weights = dict(network.named_parameters())
        self._decay = decay
        self.values: dict[str, Tensor] = {}
        if decay:
            begin = values or {name: weight.detach() for name, weight in self._weights.items()}
            self.values = {name: value.to(self._weights[name].device, copy=True) for name, value in begin.items()}

    def update(self) -> None:
        """Take the weights of a step in."""
        if self.values:
            with torch.no_grad():
                weights: list[Tensor] = [self._weights[name] for name in self.values]
                torch._foreach_lerp_(list(self.values.values()), weights, 1.0 - self._decay)

    @contextmanager
    def in_place(self) -> Iterator[None]:
        """Let the network hold the averages for a while."""
        own = {name: self._weights[name].detach().clone() for name in self.values}
        self._put(self.values)
        try:
            yield
        finally:
            self._put(own)

    def _put(self, values: Mapping[str, Tensor]) -> None:
        with torch.no_grad():
            for name, value in values.items():
                self._weights[name].copy_(value)
