"""The state of an unfinished training run in a file, so that a killed run can continue and reach the same bits."""

import hashlib
import io
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from hw_model.io.files import parsing, replace_file
from locsnn_compile.data.recordings import Recordings
from locsnn_compile.errors import InputError, check_same
from locsnn_compile.models.checkpoint import Checkpoint
from locsnn_compile.training.config import EpochRecord, TrainingConfig

_FORMAT, _VERSION = "locsnn-training-state", 2
_FIX = "Delete it, or train without --resume."


@dataclass
class TrainingState:
    """What a run needs to continue after an epoch.

    - ``phase``: ``select``, which trains on a part and chooses the epoch by validation, or ``refit``, which trains
      afresh on all training recordings; ``epoch``: the epochs done in it
    - ``weights``: those of the network; ``averages``: their running averages, empty if the run has none;
      ``optimizer``: the state of torch's optimizer
    - ``history``: a record of every epoch of all phases
    - ``chosen_epoch``, ``chosen_weights``: the epoch that validation would choose so far, and its weights
    """

    phase: str = "select"
    epoch: int = 0
    weights: dict[str, Tensor] = field(default_factory=dict)
    averages: dict[str, Tensor] = field(default_factory=dict)
    optimizer: dict[str, Any] = field(default_factory=dict)
    history: list[EpochRecord] = field(default_factory=list)
    chosen_epoch: int = 0
    chosen_weights: dict[str, Tensor] = field(default_factory=dict)


def run_key(config: TrainingConfig, recordings: Recordings, start: Checkpoint | None = None) -> str:
    """Return the sha256 over configuration, recordings and the checkpoint to start from, which identifies a run."""
    digest = hashlib.sha256(repr(sorted(asdict(config).items())).encode())
    if start is not None:
        digest.update(start.sha256.encode())
    digest.update(repr(recordings.spikes.shape).encode())
    digest.update(np.ascontiguousarray(recordings.spikes).tobytes())
    if recordings.labels is not None:
        digest.update(recordings.labels.tobytes())
    return digest.hexdigest()


def save_state(path: Path, state: TrainingState, key: str) -> None:
    """Write ``state`` of the run with this :func:`run_key`, whole or not at all."""
    history = [asdict(record) for record in state.history]
    values = {"format": _FORMAT, "version": _VERSION, "key": key, **vars(state), "history": history}
    content = io.BytesIO()
    torch.save(values, content)
    replace_file(path, content.getvalue(), f"training state {path.name!r}")


def load_state(path: Path, key: str, weights: Mapping[str, Tensor]) -> TrainingState | None:
    """Return the state at ``path``, or None if there is no file.

    ``key`` identifies the run. ``weights`` are those of its network, with whose names and shapes the file must agree.
    Raises ``InputError`` for a file that is not a state, for the state of another run, and for other weights.
    """
    if not path.exists():
        return None
    where = f"training state {path.name!r}"
    # Torch raises many kinds of exception on damaged bytes or partial files; each means the same to the user.
    with parsing(where, "it is damaged", fix=_FIX):
        # weights_only: nothing in the file is run.
        values = torch.load(path, map_location="cpu", weights_only=True)
        if values["format"] != _FORMAT or values["version"] != _VERSION:
            raise InputError(where, "it was written by another version", fix=_FIX)
        if values["key"] != key:
            raise InputError(
                where, "it belongs to a run with other options or other data", fix=_FIX
            )
        entries = {name: values[name] for name in TrainingState.__dataclass_fields__}
        entries["history"] = [EpochRecord(**record) for record in entries["history"]]
        state = TrainingState(**entries)
        # A run without averages has none to check; the network's own entries stand for missing names.
        averages = dict(weights) | state.averages
        for stored_weights in (state.weights, state.chosen_weights, averages):
            _check_weights(where, stored_weights, weights)
        return state


def _check_weights(
    where: str, stored: Mapping[str, Tensor], expected: Mapping[str, Tensor]
) -> None:
    """Refuse stored weights, if there are any, whose names or shapes are not the expected ones."""
    if stored and stored.keys() != expected.keys():
        raise InputError(
            where, "an earlier version wrote it, with other names of weights", fix=_FIX
        )
    for name, weight in stored.items():
        shape = tuple(weight.shape)
        expected_shape = tuple(expected[name].shape)
        check_same(shape, expected_shape, where, f"weights {name!r} have another shape", fix=_FIX)
