"""One training of the study: its task, how it is run, and its row of the table."""

import csv
import json
import time
from collections.abc import Iterable, Mapping
from dataclasses import asdict, fields
from pathlib import Path

import numpy as np
from sense import Parts, Sense

import locsnn_compile as lc
from hw_model.values import Frozen

CALIBRATION = 16
"""Recordings of the train part for which the compiler rounds weights."""


class Task(Frozen, eq=True):
    """What a training is to be: everything that its result depends on, so a row has only one task.

    - ``purpose``: ``choose`` or ``report``
    - ``round``: the division into train and test part, 1 for sets whose authors divided them
    - ``fold``: the fold of the train part that is held out, 0 to report
    - ``options``: further training options as JSON text, keys sorted
    """

    sense: str
    purpose: str
    network: str
    walk: str
    delays: str
    hidden: int
    options: str
    round: int
    fold: int
    seed: int
    epochs: int

    def config(self, sense: Sense, data: Path) -> dict[str, object]:
        """Return the training options.

        All epochs are trained, so that nothing is chosen on the recordings that measure.
        """
        config: dict[str, object] = {
            "model": self.network,
            "seed": self.seed,
            "epochs": self.epochs,
            "validation_fraction": 0.0,
            "refit": False,
            **sense.sensor_options(data),
        }
        if sense.tie is not None:
            config["tie"] = sense.tie
        if self.walk:
            config["order"] = self.walk
        if self.delays:
            config["delays"] = self.delays
        if self.hidden:
            config["hidden"] = self.hidden
        return config | json.loads(self.options)


class Training(Frozen):
    """A task and its results: accuracies on recordings that were held out, and costs on the chip.

    ``counts`` and ``counts_in_bins`` are the baselines, ridge regression on numbers of events.
    ``seconds`` are those of one processor, for training, compiling and playing.
    """

    task: Task
    learned_from: int
    measured_on: int
    float_accuracy: float
    chip_accuracy: float
    counts: float
    counts_in_bins: float
    energy_nj: float
    cores: int
    seconds: float

    def row(self) -> dict[str, object]:
        """Return the cells of the table by name."""
        cells = {name: value for name, value in asdict(self).items() if name != "task"}
        return asdict(self.task) | cells


COLUMNS = (
    *(field.name for field in fields(Task)),
    *(field.name for field in fields(Training) if field.name != "task"),
)


def run(task: Task, sense: Sense, parts: Parts, data: Path, checkpoint_file: Path) -> Training:
    """Train a network, compile it for ``loihi-sim``, and play the recordings that it did not learn from."""
    seconds_before = time.process_time()
    checkpoint = lc.train(
        parts.learned, task.config(sense, data), test=parts.measured, name=task.sense, carried=0
    )
    checkpoint.save(checkpoint_file)
    calibration = parts.learned.subset(np.arange(min(CALIBRATION, len(parts.learned))))
    compiled = lc.compile(
        checkpoint, events=parts.measured, calibration=calibration, diagnosis=False
    )
    report = compiled.report
    figures = checkpoint.training
    return Training(
        task=task,
        learned_from=len(parts.learned),
        measured_on=len(parts.measured),
        float_accuracy=rounded(figures["test_accuracy"]),
        chip_accuracy=rounded(report["accuracy"]["chip"]),
        counts=rounded(figures["accuracy_of_counts"]),
        counts_in_bins=rounded(figures["accuracy_of_counts_in_bins"]),
        energy_nj=round(report["energy"]["per_sample_pj"] / 1000, 1),
        cores=report["resources"]["cores"],
        seconds=round(time.process_time() - seconds_before, 1),
    )


def rounded(accuracy: object) -> float:
    """Return an accuracy with four digits; NaN if it was not measured."""
    return float("nan") if accuracy is None else round(float(str(accuracy)), 4)


def read_rows(table: Path) -> list[dict[str, str]]:
    """Return the rows of a table, none if there is no such file."""
    if not table.exists():
        return []
    with table.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def write_rows(table: Path, rows: Iterable[Mapping[str, object]]) -> None:
    """Write all rows, in the order of the tasks' columns."""
    names = [field.name for field in fields(Task)]
    ordered = sorted(rows, key=lambda row: [str(row[name]) for name in names])
    with table.open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, COLUMNS, lineterminator="\n")
        writer.writeheader()
        writer.writerows(ordered)


def task_of(row: Mapping[str, str]) -> Task:
    """Return the task of a row of the table."""
    numbers = ("hidden", "round", "fold", "seed", "epochs")
    values: dict[str, str | int] = {field.name: row[field.name] for field in fields(Task)}
    values |= {name: int(row[name]) for name in numbers}
    return Task(**values)  # type: ignore[arg-type]  # the columns are the fields
