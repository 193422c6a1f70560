"""Play every shipped model, in every strategy, on the open core's SystemVerilog, and compare it with the simulator.

    python tests/hardware/play_all.py [--data FOLDER] [--programs FOLDER]

``--data`` holds Ev-Objects.zip and Ev-Containers.zip, of which the first 20 test recordings are played; without it, the
recordings of examples/ are. Rows that played.csv has are left out: delete it to begin anew. ``--programs`` keeps what
was compiled.
"""

from __future__ import annotations

import argparse
import csv
from pathlib import Path

import numpy as np

import hw_model as hw
import locsnn_compile as lc
from hw_model.rtl.comparison import compare
from hw_model.rtl.simulators import sources
from locsnn_compile.api import recordings_for

ROOT = Path(__file__).parents[2]
FOUND = Path(__file__).parent / "played.csv"
COLUMNS = ("model", "strategy", "file", "recordings", "values", "different", "cycles different", "mean cycles")
MODELS = [
    (model, strategy)
    for model in ("objects-hybrid", "containers-hybrid")
    for strategy in ("dendrite", "delay-line", "reset")
] + [
    (model, "auto")
    for model in (
        "objects-hybrid-loihi",
        "containers-hybrid-loihi",
        "two-fingertips",
        "containers-best",
        "objects-best",
    )
]
EXAMPLES = {"objects": ["touches"], "containers": ["motions"], "two": ["two-fingertips"]}
SETS = {"objects": "Ev-Objects.zip", "containers": "Ev-Containers.zip"}
MOST = 20


def files_of(model: str, data: Path | None) -> list[Path]:
    kind = model.split("-")[0]
    examples = [ROOT / f"examples/recordings/{name}.npz" for name in EXAMPLES[kind]]
    return examples + ([data / SETS[kind]] if data and kind in SETS else [])


def program_of(model: str, strategy: str, network: lc.Network, kept: Path | None) -> hw.ChipProgram:
    folder = kept / f"{model}-{strategy}" if kept else None
    if folder and folder.exists():
        return hw.load_program(folder)
    program = lc.compile(network, target="loihi-sim", strategy=strategy).program
    if folder:
        program.save(folder)
    return program


def rows(data: Path | None, kept: Path | None, known: set[tuple[str, ...]]):
    for model, strategy in MODELS:
        network = lc.load(ROOT / f"examples/models/{model}.pt")
        for path in files_of(model, data):
            if (model, strategy, path.name) in known:
                continue
            program = program_of(model, strategy, network, kept)
            recordings = recordings_for(network, path)
            played = network.fit(recordings.spikes[:MOST], recordings.source)
            found = compare(program, played, sources())
            compared = (found["compared_values"], found["mismatches"], found["cycle_mismatches"])
            yield (model, strategy, path.name, len(played), *compared, round(np.mean(found["cycles"])))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path)
    parser.add_argument("--programs", type=Path)
    given = parser.parse_args()
    before = list(csv.reader(FOUND.open())) if FOUND.exists() else []
    with FOUND.open("a", newline="") as file:
        table = csv.writer(file, lineterminator="\n")
        if not before:
            table.writerow(COLUMNS)
        for row in rows(given.data, given.programs, {tuple(row[:3]) for row in before}):
            table.writerow(row)
            file.flush()
            print(*row, flush=True)
    found = list(csv.DictReader(FOUND.open()))
    totals = [
        sum(int(row[name]) for row in found) for name in ("recordings", "values", "different", "cycles different")
    ]
    print("{} recordings, {:,} values compared, {} different, cycles of {} different".format(*totals))


if __name__ == "__main__":
    main()
