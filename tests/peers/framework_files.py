"""What the export scripts of frameworks write next to a model file: the spikes that the model was given, and its own spikes."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

STEPS = 40
RATE = 0.2


def recording(shape, steps: int = STEPS) -> Any:
    """Return random spikes (steps, *shape), equal every time."""
    return (np.random.default_rng(3).random((steps, *shape)) < RATE).astype(np.float32)


def save_trace(folder: str, name: str, given: Any, layers: Mapping[str, Any]) -> None:
    """Write the input spikes (steps, n) and those of the framework's layers (steps, n), by module name."""
    rows = {
        f"out/{layer}": np.asarray(found).reshape(len(given), -1) for layer, found in layers.items()
    }
    np.savez_compressed(
        Path(folder) / f"{name}.npz", given=np.reshape(given, (len(given), -1)), **rows
    )


def save_played(folder: str, name: str, network: Any, layers: Mapping[str, Any], shape) -> None:
    """Play the recording to a torch network row by row, as batches of one, and write the outputs of its layers."""
    import torch

    outputs, input_spikes = heard(layers), recording(shape)
    with torch.no_grad():
        for row in input_spikes:
            network(torch.tensor(row)[None])
    save_trace(folder, name, input_spikes, outputs)


def heard(modules: Mapping[str, Any]) -> dict[str, list[Any]]:
    """Return lists to which the outputs of torch modules are appended at each call; of several values, the first."""
    found: dict[str, list[Any]] = {name: [] for name in modules}
    for name, module in modules.items():
        module.register_forward_hook(
            lambda _, __, given, name=name: found[name].append(
                (given[0] if isinstance(given, tuple) else given).detach().numpy().copy()
            )
        )
    return found
