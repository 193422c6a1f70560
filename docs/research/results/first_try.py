"""Train the thirteen made-up sensors with default options, and write the table of docs/research/first-try.md.

    python docs/research/results/first_try.py RECORDINGS docs/research/results/first-try.csv --seeds 0 1 2

RECORDINGS is a folder with ``NAME-train.npz`` and ``NAME-test.npz`` for each sensor, and ``options.txt``, which has a line
for each, of its name and the options that describe it. A row that the table has is not trained again, so a run that was
stopped goes on. The test part is played once, to the program of the chip; nothing is chosen by it.
"""

from __future__ import annotations

import argparse
import csv
import time
from dataclasses import asdict, dataclass
from pathlib import Path

import torch

import locsnn_compile as lc
from locsnn_compile.data.recordings import Recordings
from locsnn_compile.data.sensor import asked_layout

EPOCHS = 40
"""``--epochs`` of all trainings of the study."""


@dataclass(frozen=True)
class Row:
    """One training run and its figures.

    ``chip`` and ``trained``: accuracies on the test part, of the chip's program and of the network as trained. ``counts`` and
    ``counts_in_bins``: the baselines, ridge regression on numbers of events. ``hidden``: hidden neurons.
    """

    sensor: str
    model: str
    seed: int
    chip: float
    trained: float
    counts: float
    counts_in_bins: float
    windows: str
    hidden: int
    cores: int
    energy_nj: float
    cpu_seconds: float


def sensor_options(words: list[str]) -> dict[str, str | int]:
    """Return the training options of a line of ``options.txt``, which has flags and values in turn."""
    values: dict[str, str | int] = {}
    for flag, text in zip(words[::2], words[1::2], strict=True):
        values[flag.removeprefix("--")] = int(text) if text.isdigit() else text
    return values


def run(folder: Path, name: str, options: dict[str, str | int], model: str, seed: int) -> Row:
    """Train and compile one network; return its row."""
    cpu_before = time.process_time()
    config = {**options, "epochs": EPOCHS, "seed": seed}
    if model != "default":
        config["model"] = model
    train, test = (
        lc.read_recordings(str(folder / f"{name}-{part}.npz"), **reading(options))
        for part in ("train", "test")
    )
    checkpoint = lc.train(train, config, test=test, carried=0)
    figures = checkpoint.training
    compiled = lc.compile(checkpoint, events=test, calibration=calibration(train), diagnosis=False)
    report = compiled.report
    description = checkpoint.description
    windows = ""
    if description.structure.window_branch:
        window_structure = description.windows
        windows = f"{window_structure.steps} every {window_structure.stride}, levels {' '.join(map(str, window_structure.levels))}"
    return Row(
        sensor=name,
        model=model,
        seed=seed,
        chip=round(report["accuracy"]["chip"], 4),
        trained=round(float(figures["test_accuracy"] or 0), 4),
        counts=round(float(figures["accuracy_of_counts"] or 0), 4),
        counts_in_bins=round(float(figures["accuracy_of_counts_in_bins"] or 0), 4),
        windows=windows,
        hidden=sum(shape[-1] for shape in description.weight_shapes.values() if len(shape) > 1),
        cores=report["resources"]["cores"],
        energy_nj=round(report["energy"]["per_sample_pj"] / 1000, 1),
        cpu_seconds=round(time.process_time() - cpu_before, 1),
    )


def reading(options: dict[str, str | int]) -> dict[str, object]:
    """Return the arguments with which a sensor's recordings are read."""
    names = ("grid", "polarities", "channels", "layout")
    return {
        "sensor": asked_layout(*(options.get(name) for name in names)),
        "polarities": options.get("polarities"),
    }


def calibration(train: Recordings) -> Recordings:
    """Return the first 16 training recordings, for which the compiler rounds weights."""
    return train.subset(range(min(16, len(train))))


def main() -> None:
    """Train what the table lacks, and write each row when it is there."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("recordings", type=Path)
    parser.add_argument("table", type=Path)
    parser.add_argument("--seeds", type=int, nargs="+", default=[0, 1, 2])
    parser.add_argument("--models", nargs="+", default=["default"])
    parser.add_argument("--sensors", nargs="*", default=[])
    arguments = parser.parse_args()
    torch.set_num_threads(1)
    rows: list[dict[str, object]] = []
    if arguments.table.exists():
        rows = list(csv.DictReader(arguments.table.open(encoding="utf-8")))
    done = {(str(row["sensor"]), str(row["model"]), int(str(row["seed"]))) for row in rows}
    for seed in arguments.seeds:
        for line in (arguments.recordings / "options.txt").read_text("utf-8").splitlines():
            name, *words = line.split()
            for model in arguments.models:
                chosen = not arguments.sensors or name[:2] in arguments.sensors
                if not chosen or (name, model, seed) in done:
                    continue
                row = run(arguments.recordings, name, sensor_options(words), model, seed)
                print(row, flush=True)
                rows.append(asdict(row))
                write(arguments.table, rows)


def write(table: Path, rows: list[dict[str, object]]) -> None:
    """Write all rows, in the order of sensors, models and seeds."""
    ordered = sorted(rows, key=lambda row: (row["sensor"], row["model"], int(str(row["seed"]))))
    with table.open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, list(Row.__dataclass_fields__), lineterminator="\n")
        writer.writeheader()
        writer.writerows(ordered)


if __name__ == "__main__":
    main()
