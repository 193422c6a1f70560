"""Train the networks of the study of touch, sight and sound, and add a row per training to its table.

    python docs/research/senses/run_senses.py --data FOLDER

FOLDER holds the sets ``icub_grasp``, ``fsdd``, ``braille`` and ``nmnist``. ``tasks.yaml`` lists the
networks in the order in which they are trained. A training whose row is in the table is not done
again, so a study that was stopped goes on where it was, from the table alone. Checkpoints go to
``--work``. ``--senses`` and ``--purpose`` run a part of the list.
"""

import argparse
import hashlib
import json
import os
from collections.abc import Iterator, Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any

import braille
import fsdd
import icub_grasp
import nmnist
import torch
import yaml
from sense import Parts
from trainings import Task, read_rows, run, task_of, write_rows

HERE = Path(__file__).parent
ROOT = HERE.parents[2]
SENSES = {module.SENSE.name: module.SENSE for module in (icub_grasp, fsdd, braille, nmnist)}


def entries_of(file: Path) -> list[Mapping[str, Any]]:
    """Return the entries of a list of networks."""
    entries: list[Mapping[str, Any]] = yaml.safe_load(file.read_text("utf-8"))
    return entries


def tasks(entries: list[Mapping[str, Any]]) -> Iterator[Task]:
    """Yield the trainings of a list of networks, entry after entry.

    An entry has the fields of a task; ``rounds``, ``folds`` and ``seeds`` are lists, by default of
    1, 1 and 0. To report, there is no fold.
    """
    for entry in entries:
        purpose = entry["purpose"]
        folds = entry.get("folds", [1]) if purpose == "choose" else [0]
        for round_number in entry.get("rounds", [1]):
            for fold in folds:
                for seed in entry.get("seeds", [0]):
                    yield Task(
                        sense=entry["sense"],
                        purpose=purpose,
                        network=entry["network"],
                        walk=entry.get("walk", ""),
                        delays=entry.get("delays", ""),
                        hidden=entry.get("hidden", 0),
                        options=json.dumps(entry.get("options", {}), sort_keys=True),
                        round=round_number,
                        fold=fold,
                        seed=seed,
                        epochs=entry.get("epochs", 1),
                    )


def parts_of(task: Task, data: Path) -> Parts:
    """Return the recordings of a task."""
    return read_parts(task.sense, task.purpose, task.round, task.fold, data)


@lru_cache(maxsize=1)
def read_parts(sense: str, purpose: str, round_number: int, fold: int, data: Path) -> Parts:
    """Return the recordings of a set for a purpose.

    The last ones are kept, because successive tasks mostly have the same.
    """
    if purpose == "report":
        return SENSES[sense].to_report(data, round_number)
    return SENSES[sense].to_choose(data, round_number, fold)


def checkpoint_name(task: Task) -> str:
    """Return the name of a task's checkpoint: what it is for, and a digest of all fields of the task."""
    digest = hashlib.sha256(str(task).encode()).hexdigest()[:8]
    return f"{task.sense}-{task.purpose}-{task.network}-{digest}.pt"


def main() -> None:
    """Train each network of the list that has no row in the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--data", type=Path, default=ROOT.parent / "shared/data")
    parser.add_argument("--work", type=Path, default=ROOT / "runs/senses")
    parser.add_argument("--table", type=Path, default=HERE / "trainings.csv")
    parser.add_argument("--tasks", type=Path, default=HERE / "tasks.yaml")
    parser.add_argument("--senses", nargs="*", choices=list(SENSES), default=list(SENSES))
    parser.add_argument("--purpose", choices=("choose", "report"))
    arguments = parser.parse_args()
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    torch.set_num_threads(1)
    arguments.work.mkdir(parents=True, exist_ok=True)
    while True:
        # The list is read anew after each training, so that it may change while a study runs.
        tasks_of_list = tasks(entries_of(arguments.tasks))
        tasks_to_run = [
            task for task in tasks_of_list if is_wanted(task, arguments.senses, arguments.purpose)
        ]
        task = first_missing(tasks_to_run, read_rows(arguments.table))
        if task is None:
            return
        checkpoint_file = arguments.work / checkpoint_name(task)
        parts = parts_of(task, arguments.data)
        training = run(task, SENSES[task.sense], parts, arguments.data, checkpoint_file)
        write_rows(arguments.table, [*read_rows(arguments.table), training.row()])
        print(training.row(), flush=True)


def is_wanted(task: Task, senses: Sequence[str], purpose: str | None) -> bool:
    """Return whether a task belongs to the part of the list that is run."""
    return task.sense in senses and purpose in (None, task.purpose)


def first_missing(wanted: Sequence[Task], rows: Sequence[Mapping[str, str]]) -> Task | None:
    """Return the first task without a row; None if all have one."""
    trained = {task_of(row) for row in rows}
    return next((task for task in wanted if task not in trained), None)


if __name__ == "__main__":
    main()
