"""The trained checkpoint of this project: ``locsnn-checkpoint`` version 1, a plain dict in torch's own file
format.

    {"format", "version", "name", "architecture", "neuron": {...}, "input": {...}, "hidden", "classes",
     "location_order": None or {"name", "taxels"}, "weights": {population: float32 tensor [out, in]},
     "recordings": None or {"spikes": uint8 (samples, steps, channels), "labels": int64 (samples,) or None},
     "training": {plain numbers and strings}}

Written here, read by :mod:`locsnn_compile.models.checkpoint_reader`, which never runs code of the file.
"""

from __future__ import annotations

import io
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hw_model.files import replace_file
from locsnn_compile.data.recordings import Recordings
from locsnn_compile.errors import InputError
from locsnn_compile.models.description import NetworkDescription

FORMAT = "locsnn-checkpoint"
VERSION = 1

#: What a training entry may be.
Plain = str | int | float | bool | None


@dataclass(frozen=True, eq=False)
class Checkpoint:
    """A trained network as read from a file.

    ``weights``: population name -> float32 [out, in], read-only, in evaluation order; ``recordings``: the
    ones the checkpoint carries for checks, or None; ``training``: how it came about, plain values; ``sha256``
    of the file.
    """

    description: NetworkDescription
    weights: dict[str, NDArray[np.float32]]
    recordings: Recordings | None
    training: dict[str, Plain]
    sha256: str


def save_checkpoint(
    path: Path | str,
    description: NetworkDescription,
    weights: Mapping[str, NDArray[np.floating[Any]]],
    *,
    recordings: Recordings | None = None,
    training: Mapping[str, Plain] | None = None,
) -> None:
    """Write a checkpoint whole or not at all; equal arguments give equal bytes under one version of torch.

    Raises ``InputError`` for weights that do not fit the description or are not finite, and where the folder
    cannot be written.
    """
    import torch

    path = Path(path)
    tensors = {}
    for name, shape in description.weight_shapes.items():
        if name not in weights or tuple(weights[name].shape) != shape:
            got = tuple(weights[name].shape) if name in weights else "none"
            raise InputError(
                f"population {name!r}",
                "its weights do not fit the network",
                measured=f"got {got} against {shape}",
                fix="Save the weights of a network of this description.",
            )
        check_finite(f"population {name!r}", weights[name])
        tensors[name] = torch.from_numpy(np.array(weights[name], dtype=np.float32, order="C"))
    values = {
        "format": FORMAT,
        "version": VERSION,
        "name": description.name,
        "architecture": description.architecture,
        "neuron": asdict(description.neuron),
        "input": asdict(description.input),
        "location_order": _order_entry(description),
        "hidden": description.hidden,
        "classes": description.classes,
        "weights": tensors,
        "recordings": _recordings_entry(recordings),
        "training": dict(training or {}),
    }
    content = io.BytesIO()
    torch.save(values, content)
    replace_file(path, content.getvalue(), f"checkpoint {path.name!r}")


def check_finite(where: str, weights: NDArray[np.floating[Any]]) -> None:
    """Raise ``InputError`` naming the first weight that is NaN or infinite."""
    bad = np.argwhere(~np.isfinite(weights))
    if len(bad):
        row, column = (int(index) for index in bad[0])
        raise InputError(
            where,
            f"weight [{row}, {column}] is not finite",
            measured=f"got {weights[row, column]}, {len(bad)} such weights",
            fix="Train the network again.",
        )


def _order_entry(description: NetworkDescription) -> dict[str, Any] | None:
    if description.location_taxels is None:
        return None
    return {"name": description.location_order, "taxels": list(description.location_taxels)}


def _recordings_entry(recordings: Recordings | None) -> dict[str, Any] | None:
    import torch

    if recordings is None:
        return None
    labels = None if recordings.labels is None else torch.from_numpy(recordings.labels.copy())
    return {"spikes": torch.from_numpy(recordings.spikes.copy()), "labels": labels}
