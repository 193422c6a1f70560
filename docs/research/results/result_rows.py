"""What `make results` trains: the rows of the published tables, their options, and the published figures."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

SEEDS = range(5)
SIX_DELAYS = "0,12,24,36,48,60"


@dataclass(frozen=True)
class Dataset:
    """A data set of the results.

    ``archive``: its file, None for synthetic recordings. ``config``: the configuration of its hybrid. ``psi``: the published
    constant of time-weighted predictions. ``published_steps``: the steps of recordings of two fingertips.
    """

    name: str
    title: str
    archive: str | None
    config: str
    psi: float
    published_steps: int
    published_classes: int


DATASETS: Mapping[str, Dataset] = {
    "objects": Dataset(
        "objects",
        "Objects",
        archive="Ev-Objects.zip",
        config="objects-hybrid.yaml",
        psi=15.0,
        published_steps=325,
        published_classes=36,
    ),
    "containers": Dataset(
        "containers",
        "Containers",
        archive="Ev-Containers.zip",
        config="containers-hybrid.yaml",
        psi=10.0,
        published_steps=325,
        published_classes=20,
    ),
    "slip": Dataset(
        "slip",
        "Slip (synthetic)",
        archive=None,
        config="objects-hybrid.yaml",
        psi=2.0,
        published_steps=150,
        published_classes=2,
    ),
}


@dataclass(frozen=True)
class Row:
    """A network of the table: its options over the configuration of its data set, and published accuracies.

    - ``published``: data set -> accuracy (Kang et al. 2022, two fingertips)
    - ``config`` replaces that of the data set; in it ``{recipe}`` stands for the data set whose recipe is taken (Slip takes that
      of Objects), ``{dataset}`` for the data set itself
    - ``parts``: networks that are trained apart and joined, a hybrid and windows; before joining, the hybrid is trained further
      with configuration ``further``
    - ``strategy``: how spike response neurons are built on the chip
    - ``only``: the one data set of the row; None: all
    - ``minutes``: about how long one seed takes on one core, by data set, for the list of what has not been run
    - ``on_page``: whether the row is on the page, or only in the files of the tables
    """

    name: str
    label: str
    options: Mapping[str, Any]
    published: Mapping[str, str] = field(default_factory=dict)
    config: str | None = None
    parts: tuple[str, ...] = ()
    further: str | None = None
    strategy: str = "dendrite"
    only: str | None = None
    minutes: Mapping[str, int] = field(default_factory=dict)
    on_page: bool = True

    def config_for(self, dataset: Dataset) -> str:
        """Return the file in ``examples/configs`` with which the row is trained."""
        if self.config is None:
            return dataset.config
        recipe = dataset.config.partition("-")[0]
        return self.config.format(recipe=recipe, dataset=dataset.name)

    @property
    def model(self) -> str:
        return str(self.options.get("model", "hybrid"))


def _published(objects: str, containers: str, slip: str) -> dict[str, str]:
    return {"objects": objects, "containers": containers, "slip": slip}


def _published_orders() -> Iterator[Row]:
    """The published training with the other orders of taxels."""
    for order in ("arch", "whorl"):
        yield Row(
            f"hybrid-{order}-published",
            f"Hybrid, published training, {order}",
            {"order": order},
            config="{dataset}-hybrid-published.yaml",
            minutes={"objects": 3, "containers": 2, "slip": 1},
            on_page=False,
        )


ROWS = (
    Row("tactile-snn", "Tactile-SNN", {"model": "tactile-snn"}, _published("0.75", "0.57", "0.82")),
    Row(
        "tactile-sgnet",
        "TactileSGNet",
        {"model": "tactile-sgnet"},
        _published("0.79", "0.58", "0.97"),
        "tactile-sgnet.yaml",
        minutes={"objects": 18, "containers": 12, "slip": 1},
    ),
    Row(
        "gru-mlp",
        "GRU-MLP",
        {"model": "gru-mlp"},
        _published("0.72", "0.46", "0.87"),
        "gru-mlp.yaml",
        minutes={"objects": 5, "containers": 3},
    ),
    Row("cnn-3d", "CNN-3D", {"model": "cnn-3d"}, _published("0.90", "0.67", "0.44"), "cnn-3d.yaml"),
    Row(
        "location-tactile-snn",
        "Location Tactile-SNN",
        {"model": "location-tactile-snn"},
        _published("0.89", "0.88", "0.82"),
    ),
    Row("hybrid", "Hybrid, lambda 1, loop", {}, _published("0.91", "0.86", "1.0")),
    Row(
        "hybrid-half",
        "Hybrid, lambda 0.5, loop",
        {"location_weight": 0.5},
        _published("0.92", "0.89", "0.98"),
    ),
    Row(
        "hybrid-arch",
        "Hybrid, lambda 1, arch",
        {"order": "arch"},
        _published("0.91", "0.86", "0.99"),
    ),
    Row(
        "hybrid-whorl",
        "Hybrid, lambda 1, whorl",
        {"order": "whorl"},
        _published("0.92", "0.86", "0.98"),
    ),
    Row(
        "hybrid-published",
        "Hybrid, published training",
        {},
        config="{dataset}-hybrid-published.yaml",
    ),
    Row(
        "hybrid-half-published",
        "Hybrid, published training, lambda 0.5",
        {"location_weight": 0.5},
        config="{dataset}-hybrid-half-published.yaml",
        minutes={"objects": 3, "containers": 2, "slip": 1},
    ),
    *_published_orders(),
    Row(
        "tactile-snn-delays",
        "Tactile-SNN, synapses of six delays",
        {"model": "tactile-snn", "delays": SIX_DELAYS},
        minutes={"objects": 3},
    ),
    Row("hybrid-delays", "Hybrid, synapses of six delays", {"delays": SIX_DELAYS}),
    Row(
        "tactile-snn-lif",
        "Tactile-SNN of TLIF neurons",
        {"model": "tactile-snn-lif"},
        config="tactile-snn-lif.yaml",
    ),
    Row(
        "location-tactile-snn-lif",
        "Location Tactile-SNN of LLIF neurons",
        {"model": "location-tactile-snn-lif"},
        config="location-tactile-snn-lif.yaml",
    ),
    Row(
        "hybrid-lif",
        "Hybrid of TLIF and LLIF neurons",
        {"model": "hybrid-lif"},
        config="hybrid-lif.yaml",
    ),
    Row("window-snn", "Window-SNN", {"model": "window-snn"}, config="{recipe}-window-snn.yaml"),
    Row(
        "window-prototypes",
        "Window-SNN, prototypes",
        {"model": "window-snn"},
        config="{recipe}-window-snn-prototypes.yaml",
    ),
    Row(
        "window-early",
        "Window-SNN, ends cut",
        {"model": "window-snn"},
        config="objects-window-snn-early.yaml",
        only="objects",
    ),
    Row(
        "window-quarter",
        "Window-SNN, three quarters cut",
        {"model": "window-snn"},
        config="objects-window-snn-quarter.yaml",
        only="objects",
    ),
    Row(
        "windows-and-hybrid",
        "Window-SNN and hybrid, joined",
        {},
        parts=("hybrid", "window-snn"),
        only="objects",
    ),
    Row(
        "three-windows-and-hybrid",
        "Three Window-SNNs and hybrid, joined",
        {},
        parts=("hybrid", "window-snn", "window-snn-quarter", "window-snn-prototypes"),
        strategy="reset",
        only="objects",
    ),
    Row(
        "three-windows-and-trained-hybrid",
        "Three Window-SNNs and hybrid, trained for the chip",
        {},
        parts=("hybrid", "window-snn", "window-snn-quarter", "window-snn-prototypes"),
        further="hybrid-reset",
        strategy="reset",
        only="objects",
    ),
    Row(
        "window-snn-levels",
        "Window-SNN, neighbouring levels",
        {"model": "window-snn"},
        config="containers-window-snn-levels.yaml",
        only="containers",
    ),
    Row(
        "window-snn-2-bits",
        "Window-SNN, trained with 2 bits",
        {"model": "window-snn"},
        config="objects-window-snn-2-bits.yaml",
        only="objects",
    ),
    Row(
        "window-snn-levels-2-bits",
        "Window-SNN, neighbouring levels, trained with 2 bits",
        {"model": "window-snn"},
        config="containers-window-snn-levels-2-bits.yaml",
        only="containers",
    ),
    Row(
        "window-snn-16-steps",
        "Window-SNN, windows of 16 steps",
        {"model": "window-snn"},
        config="{recipe}-window-snn-16-steps.yaml",
    ),
    Row(
        "hybrid-graph",
        "Hybrid of graphs",
        {"model": "hybrid-graph"},
        config="hybrid-graph.yaml",
        minutes={"objects": 21, "containers": 14, "slip": 1},
    ),
)
ROW_NAMES = tuple(row.name for row in ROWS)
FLAGS = {
    "model": "--model",
    "order": "--order",
    "location_weight": "--lambda",
    "delays": "--delays",
}
"""Option of a row -> the flag of ``locsnn train`` that gives it."""


def command(row: Row, dataset: Dataset, seed: int) -> str:
    """Return what trains a network of the table; of synthetic recordings, what makes them comes first."""
    data = dataset.archive or "slip.npz"
    begin = f"locsnn train --data {data} --config examples/configs"
    if row.parts:
        whole = f"--validation-fraction 0 --seed {seed}"
        made = [f"{begin}/{dataset.name}-{part}.yaml {whole} -o {part}.pt" for part in row.parts]
        joined = list(row.parts)
        if row.further is not None:
            made.append(
                f"{begin}/{dataset.name}-{row.further}.yaml --from {joined[0]}.pt {whole} -o {row.further}.pt"
            )
            joined[0] = row.further
        files = " ".join(f"{part}.pt" for part in joined)
        return " && ".join(
            [
                *made,
                f"python docs/research/results/join_branches.py {files} -o {row.name}.pt --test {data}",
            ]
        )
    flags = [f"{FLAGS[name]} {value}" for name, value in row.options.items()]
    return " ".join(
        [f"{begin}/{row.config_for(dataset)}", *flags, f"--seed {seed}", f"-o {row.name}.pt"]
    )
