"""What the studies of ``chip_studies.py`` share: the data, the networks that ship, and files of figures.

A figure takes minutes, so it is kept in a file under the work folder and read from there the next time.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

import hw_model as hw
import locsnn_compile as lc
from locsnn_compile.data.read import read_recordings
from locsnn_compile.data.recordings import Recordings

ROOT = Path(__file__).parents[3]
MODELS = ROOT / "examples/models"


@dataclass(frozen=True)
class Shipped:
    """A checkpoint of ``examples/models`` (or of the work folder), and the strategy with which its model card compiles it."""

    dataset: str
    label: str
    file: str
    strategy: str = "auto"


SHIPPED = (
    Shipped("objects", "Objects, best (three Window-SNNs and hybrid)", "objects-best.pt"),
    Shipped("objects", "Objects, Hybrid", "objects-hybrid.pt", "dendrite"),
    Shipped("containers", "Containers, best (Window-SNN, levels)", "containers-best.pt"),
    Shipped("containers", "Containers, Hybrid", "containers-hybrid.pt", "dendrite"),
)


class Study:
    """The data and the files of figures that all studies share.

    ``data``: the folder of the recordings. ``work``: networks and figures. ``tables``: the tables of the documentation.
    """

    def __init__(self, data: Path, work: Path, tables: Path) -> None:
        self.data, self.work, self.tables = data, work, tables

    @cache  # noqa: B019 - one study a run
    def part(self, dataset: str, split: str) -> Recordings:
        """Return the train or the test part of a data set."""
        return read_recordings(self.data / f"Ev-{dataset.title()}.zip", split=split)

    @cache  # noqa: B019
    def program(self, shipped: Shipped) -> hw.ChipProgram:
        """Return a network compiled for ``loihi-sim``, its weights rounded for 16 training recordings."""
        shipped_file = MODELS / shipped.file
        network = lc.load(shipped_file if shipped_file.exists() else self.work / shipped.file)
        events = self.part(shipped.dataset, "train").subset(np.arange(16))
        return lc.compile(
            network, strategy=shipped.strategy, events=events, diagnosis=False
        ).program

    def figures(self, name: str, make: Callable[[], Any]) -> Any:
        """Return the figures in file ``name``; if there is none, make them and write it.

        Both ways they come from JSON, so that a first run gives the same types as a later one.
        """
        path = self.work / f"{name}.json"
        if not path.exists():
            path.write_text(json.dumps(make()) + "\n", encoding="utf-8")
            print(f"{path.stem}: made", flush=True)
        return json.loads(path.read_text(encoding="utf-8"))
