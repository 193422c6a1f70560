"""The networks that ship, the strategies with which they are compiled for the open core, and the recordings of examples/."""

from __future__ import annotations

from pathlib import Path

ROOT = Path(__file__).parents[3]
STRATEGIES = ("dendrite", "delay-line", "reset")
HYBRIDS = ("objects-hybrid", "containers-hybrid")
# These have neurons of the chip, so `auto` has nothing to choose.
TRAINED = (
    *("objects-hybrid-loihi", "containers-hybrid-loihi", "two-fingertips"),
    *("containers-window-16", "containers-best", "objects-best"),
)
MODELS = [(model, strategy) for model in HYBRIDS for strategy in STRATEGIES] + [
    (model, "auto") for model in TRAINED
]
EXAMPLES = {
    "objects": ("touches",),
    "containers": ("motions", "touches-long"),
    "two": ("two-fingertips",),
}
"""Files of examples/recordings that fit a model, by the first word of the model's name."""


def model_file(model: str) -> Path:
    """Return the checkpoint of a model."""
    return ROOT / f"examples/models/{model}.pt"


def example_files(model: str) -> list[Path]:
    """Return the files of example recordings that fit a model."""
    return [ROOT / f"examples/recordings/{name}.npz" for name in EXAMPLES[model.split("-")[0]]]
