"""The networks that ship, the strategies in which they are played on the open core, and the recordings of examples/."""

from __future__ import annotations

from pathlib import Path

ROOT = Path(__file__).parents[3]
STRATEGIES = ("dendrite", "delay-line", "reset")
HYBRIDS = ("objects-hybrid", "containers-hybrid")
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
"""By the first word of a model's name."""


def model_file(model: str) -> Path:
    return ROOT / f"examples/models/{model}.pt"


def example_files(model: str) -> list[Path]:
    return [ROOT / f"examples/recordings/{name}.npz" for name in EXAMPLES[model.split("-")[0]]]
