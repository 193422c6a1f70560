"""Train networks for a Xylo and for a Loihi on the same inputs, and play them: a row each in ``accuracy.csv``.

    python docs/research/xylo/study.py FOLDER [--data NAME] [--purpose choose] [--xylosim PYTHON]

Rows that the table has are not run again. To choose, networks learn from two thirds of the train part and are measured
on the rest of it; to report, they learn from all of it and play the test part once.
"""

import argparse
import csv
import sys
import tempfile
from collections.abc import Iterator, Mapping
from dataclasses import asdict, fields, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

import locsnn_compile as lc
from hw_model.values import Frozen
from hw_model.xylo.playing import play_all, rows_of
from locsnn_compile.data.read import read_recordings, stratified_split
from locsnn_compile.data.recordings import Recordings
from locsnn_compile.data.sensor import asked_layout

HERE = Path(__file__).parent
TABLE = HERE / "accuracy.csv"
WITNESSED = 20
"""Recordings of a test part that xylosim, the vendor's simulator, plays as well; registers and spikes are compared."""
ROUNDS = 5
"""Rounds of recordings without a published test part; each tests on a fifth. Also the most seeds of the others."""


class Data(Frozen):
    """A set of recordings, reduced to the 16 inputs of a Xylo.

    - ``file``: below the folder of data; ``selection``: which channels of its sensor are read, and which are merged
    - ``tie``: the class that is predicted if no output spikes
    - ``has_parts``: whether its authors divided it; then seeds are compared, else rounds
    - ``classes``: how many of the first classes are read; None: all
    - ``xylo``: the chip on which it is played
    """

    name: str
    file: str
    grid: str
    selection: Mapping[str, Any]
    epochs: int
    tie: str | None = None
    has_parts: bool = True
    classes: int | None = None
    xylo: str = "xylo-audio3"


class Candidate(Frozen):
    """A network by name, the chip on which it is played, and the options that train it."""

    network: str
    chip: str
    options: Mapping[str, Any]


def candidates(data: Data) -> tuple[Candidate, ...]:
    """Return the networks that are compared on some data."""
    return (
        Candidate("xylo-snn", data.xylo, {"target": data.xylo}),
        Candidate("tactile-snn", "loihi-sim", {"model": "tactile-snn", "target": "loihi-sim"}),
        Candidate("tactile-snn-lif", "loihi-sim", {"model": "tactile-snn-lif"}),
        Candidate("window-snn", "loihi-sim", {"model": "window-snn"}),
    )


class Row(Frozen):
    """A training and its result on recordings that it did not learn from.

    ``hidden`` is what was asked for, and ``hidden_neurons`` what the network has: windows ask for as
    many as recordings need. ``unequal_spikes``: those of the chip that differ from the float
    network's, or from those of training on the chip's integers. ``xylosim_values`` and
    ``xylosim_unequal``: registers and spikes compared with the witness, if it was asked.
    """

    data: str
    purpose: str
    round: int
    seed: int
    network: str
    chip: str
    hidden: int
    epochs: int
    learned_from: int
    played: int
    accuracy: float
    unequal_spikes: int
    hidden_neurons: int = 0
    xylosim_values: int = 0
    xylosim_unequal: int = 0

    @property
    def key(self) -> tuple[str, ...]:
        """The cells that tell a row from all others."""
        return tuple(str(getattr(self, name)) for name in _KEYS)


_KEYS = ("data", "purpose", "round", "seed", "network", "hidden", "epochs")
DATA = (
    Data(
        "grasps, one finger",
        "icub_grasp/grasps.npz",
        "60x1",
        {"only_taxels": "1-12", "only_polarity": 0},
        epochs=100,
        tie="none",
        has_parts=False,
    ),
    Data(
        "digits, 16 bands",
        "fsdd/fsdd.zip",
        "32x1",
        {"merge_polarities": True, "merge_channels": 16},
        epochs=30,
    ),
    Data(
        "digits 0 to 7, 16 bands",
        "fsdd/fsdd.zip",
        "32x1",
        {"merge_polarities": True, "merge_channels": 16},
        epochs=30,
        classes=8,
        xylo="xylo-audio2",
    ),
    Data(
        "Braille",
        "braille/braille.zip",
        "12x1",
        {"merge_polarities": True},
        epochs=20,
        tie="Space",
    ),
)
NETWORKS = tuple(candidate.network for candidate in candidates(DATA[0]))


def parts(folder: Path, data: Data, purpose: str, division: int) -> tuple[Recordings, Recordings]:
    """Return the recordings that a network learns from, and those that it plays."""
    read = partial(
        read_recordings,
        folder / data.file,
        sensor=asked_layout(data.grid, polarities=None, channels=None, layout=None),
        **data.selection,
    )
    if data.has_parts:
        train, test = (_of_classes(read(split=part), data) for part in ("train", "test"))
    else:
        train, test = (
            read(split=part, test_share=1 / ROUNDS, fold=division) for part in ("train", "test")
        )
    if purpose == "choose":
        learned, held = stratified_split(train.needed_labels("learn"), 1 / 3, 0)
        return train.subset(learned), train.subset(held)
    steps = max(train.spikes.shape[1], test.spikes.shape[1])
    return train.with_steps(steps), test.with_steps(steps)


def _of_classes(recordings: Recordings, data: Data) -> Recordings:
    """Return the recordings of the classes that are read."""
    if data.classes is None:
        return recordings
    rows = np.flatnonzero(recordings.needed_labels("divide") < data.classes)
    names = recordings.class_names
    kept = None if names is None else names[: data.classes]
    return replace(recordings.subset(rows), class_names=kept)


def run(
    data: Data,
    learned: Recordings,
    played: Recordings,
    candidate: Candidate,
    row: Row,
    xylosim: str | None,
) -> Row:
    """Return a row with the result of its training."""
    # After the selection only channels are left, so the layout of the sensor is replaced by their number.
    options = {
        "channels": learned.spikes.shape[2],
        "hidden": row.hidden,
        "epochs": row.epochs,
        "seed": row.seed,
        "tie": data.tie,
        "validation_fraction": 0.0,
        **candidate.options,
    }
    plain = replace(learned, channels=None, recorded=None)
    with tempfile.TemporaryDirectory() as name:
        checkpoint = Path(name) / "model.pt"
        lc.train(plain, options, carried=0).save(checkpoint)
        network = lc.load(checkpoint)
    compiled = lc.compile(
        network, target=candidate.chip, events=played.spikes, labels=played.labels
    )
    populations = compiled.match.by_population.values()
    row = replace(
        row,
        learned_from=len(learned),
        played=len(played),
        accuracy=round(compiled.figures.accuracy.chip, 4),
        unequal_spikes=sum(population.mismatches for population in populations),
        hidden_neurons=sum(
            population_of_chip.size
            for population_of_chip in network.populations
            if "hidden" in population_of_chip.name
        ),
    )
    if xylosim is None or not candidate.chip.startswith("xylo"):
        return row
    values, unequal = witnessed(compiled.program.network, played.spikes[:WITNESSED], xylosim)
    return replace(row, xylosim_values=values, xylosim_unequal=unequal)


def witnessed(network: Any, recordings: np.ndarray, python: str) -> tuple[int, int]:
    """Play recordings in xylosim as well; return how many registers and spikes were compared, and how many differ."""
    sys.path.insert(0, str(HERE.parents[2]))
    from tests.xylo.record import ask_witness

    rows = [rows_of(recording) for recording in recordings]
    with tempfile.TemporaryDirectory() as name:
        answers = ask_witness(python, [(network, of_one) for of_one in rows], Path(name))
    values = unequal = 0
    for result, answer in zip(play_all(network, rows), answers, strict=True):
        for register, expected in answer.items():
            ours = getattr(result, register)
            values += expected.size
            unequal += int(np.count_nonzero(ours != expected.reshape(ours.shape)))
    return values, unequal


def asked_rows(
    data: Data, candidate: Candidate, purpose: str, hidden: int, most: int
) -> Iterator[Row]:
    """Yield the rows of a network, without their results: one to choose, ``most`` to report.

    Without a published test part they are rounds 1, 2, ... with seed 0, else seeds 0, 1, ... with the published parts.
    """
    for number in range(1 if purpose == "choose" else most):
        division, seed = (0, number) if data.has_parts else (1 + number, 0)
        yield Row(
            data.name, purpose, division, seed, candidate.network, candidate.chip, hidden,
            data.epochs, learned_from=0, played=0, accuracy=0.0, unequal_spikes=0,
        )  # fmt: skip


def known_rows() -> dict[tuple[str, ...], dict[str, str]]:
    """Return the rows of the table by their keys."""
    if not TABLE.exists():
        return {}
    with TABLE.open(newline="") as file:
        return {tuple(entry[name] for name in _KEYS): entry for entry in csv.DictReader(file)}


def append(row: Row) -> None:
    """Write a row at the end of the table."""
    is_new = not TABLE.exists()
    with TABLE.open("a", newline="") as file:
        writer = csv.DictWriter(file, [field.name for field in fields(Row)], lineterminator="\n")
        if is_new:
            writer.writeheader()
        writer.writerow(asdict(row))


def main() -> None:
    """Run the rows that the command line asks for and the table lacks."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path, help="folder of the recordings")
    parser.add_argument("--data", choices=[data.name for data in DATA])
    parser.add_argument("--network", choices=NETWORKS)
    parser.add_argument("--purpose", choices=("choose", "report"), default="report")
    parser.add_argument("--hidden", type=int, default=64)
    parser.add_argument("--epochs", type=int, help="other than those of the data")
    parser.add_argument(
        "--rows", type=int, default=ROUNDS, help="rounds or seeds of a network to report"
    )
    parser.add_argument("--xylosim", metavar="PYTHON", help="one that has xylosim")
    args = parser.parse_args()
    for data in DATA:
        for candidate in candidates(data):
            is_asked = args.data in (None, data.name)
            if is_asked and args.network in (None, candidate.network):
                run_missing(data, candidate, args)


def run_missing(data: Data, candidate: Candidate, args: argparse.Namespace) -> None:
    """Run the rows of a network that are not in the table."""
    for asked in asked_rows(data, candidate, args.purpose, args.hidden, args.rows):
        row = replace(asked, epochs=args.epochs or data.epochs)
        if row.key in known_rows():
            continue
        learned, played = parts(args.folder, data, args.purpose, row.round)
        measured = run(data, learned, played, candidate, row, args.xylosim)
        append(measured)
        print(measured, flush=True)


if __name__ == "__main__":
    main()
