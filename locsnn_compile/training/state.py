"""The state of an unfinished training run, so that a killed run can continue and reach the same bits."""

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
    """What a run needs to continue: its phase (``select`` or ``refit``), the epochs done in it, and the best so far."""

    phase: str = "select"
    epoch: int = 0
    weights: dict[str, Tensor] = field(default_factory=dict)
    averages: dict[str, Tensor] = field(default_factory=dict)
    optimizer: dict[str, Any] = field(default_factory=dict)
    history: list[EpochRecord] = field(default_factory=list)
    chosen_epoch: int = 0
    chosen_weights: dict[str, Tensor] = field(default_factory=dict)


def run_key(config: TrainingConfig, recordings: Recordings, start: Checkpoint | None = None) -> str:
    """Return the sha256 over configuration, recordings and starting checkpoint, which identifies a run."""
    digest = hashlib.sha256(repr(sorted(asdict(config).items())).encode())
    if start is not None:
        digest.update(start.sha256.encode())
    digest.update(repr(recordings.spikes.shape).encode())
    digest.update(np.ascontiguousarray(recordings.spikes).tobytes())
    if recordings.labels is not None:
        digest.update(recordings.labels.tobytes())
    return digest.hexdigest()


def save_state(path: Path, state: TrainingState, key: str) -> None:
    """Write ``state``, whole or not at all."""
    history = [asdict(record) for record in state.history]
    values = {"format": _FORMAT, "version": _VERSION, "key": key, **vars(state), "history": history}
    content = io.BytesIO()
    torch.save(values, content)
    replace_file(path, content.getvalue(), f"training state {path.name!r}")


def load_state(path: Path, key: str, weights: Mapping[str, Tensor]) -> TrainingState | None:
    """Return the state at ``path``, or None if there is no file; ``weights`` are those that its network has.

    Raises ``InputError`` for a file that is not a state, for the state of another run, and for other weights.
    """
    if not path.exists():
        return None
    where = f"training state {path.name!r}"
    # Torch raises many kinds of exception on damaged bytes or partial files; each means the same to the user.
    with parsing(where, "it is damaged", fix=_FIX):
        values = torch.load(path, map_location="cpu", weights_only=True)
        if values["format"] != _FORMAT or values["version"] != _VERSION:
            raise InputError(where, "it was written by another version", fix=_FIX)
        if values["key"] != key:
            raise InputError(
                where, "it belongs to a run with other options or other data", fix=_FIX
            )
        held = {name: values[name] for name in TrainingState.__dataclass_fields__}
        state = TrainingState(
            **held | {"history": [EpochRecord(**record) for record in held["history"]]}
        )
        for found in (state.weights, state.chosen_weights, dict(weights) | state.averages):
            _check_weights(where, found, weights)
        return state


def _check_weights(where: str, found: Mapping[str, Tensor], usual: Mapping[str, Tensor]) -> None:
    """Refuse weights, if there are any, whose names or shapes are not the ``usual`` ones."""
    if found and found.keys() != usual.keys():
        raise InputError(
            where, "an earlier version wrote it, with other names of weights", fix=_FIX
        )
    for name, weight in found.items():
        shape, wanted = tuple(weight.shape), tuple(usual[name].shape)
        check_same(shape, wanted, where, f"weights {name!r} have another shape", fix=_FIX)
