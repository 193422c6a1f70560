"""Recorded networks of torch layers of several frameworks: their state dicts, and their spikes on an input.

The frameworks need not be installed: tests load the state dicts and compare with the recorded spikes.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

STEPS = 40

RECORDED = Path(__file__).parents[1] / "frontends/torch-layers"
"""The folder that ``tests/peers/record_torch_layers.py`` writes, which also describes its contents."""


def write_recorded(framework: str, folder: Path) -> tuple[Path, Path, dict[str, np.ndarray]]:
    """Write the state dict of a framework's network to a file.

    Returns:
        The path of the state dict, the path of its description, and the recorded arrays by name.
    """
    with np.load(RECORDED / f"{framework}.npz") as arrays:
        recorded = dict(arrays)
    state = folder / f"{framework}.pt"
    state.write_bytes(recorded.pop("state").tobytes())
    return state, RECORDED / f"{framework}.yaml", recorded
