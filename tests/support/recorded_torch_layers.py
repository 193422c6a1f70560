"""State dicts of networks of torch layers, and what was recorded of them."""

from __future__ import annotations

from pathlib import Path

import numpy as np

STEPS = 40


RECORDED = Path(__file__).parents[1] / "frontends/torch-layers"
"""``tests/peers/record_torch_layers.py`` says what it holds and writes it."""


def write_recorded(framework: str, folder: Path) -> tuple[Path, Path, dict[str, np.ndarray]]:
    """Write the state dict of a framework's network; return it, its description, and what was recorded."""
    with np.load(RECORDED / f"{framework}.npz") as held:
        recorded = dict(held)
    state = folder / f"{framework}.pt"
    state.write_bytes(recorded.pop("state").tobytes())
    return state, RECORDED / f"{framework}.yaml", recorded
