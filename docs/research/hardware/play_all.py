"""Play every shipped model, in every strategy, and the networks of ``make peers``, on the open core's SystemVerilog.

Everything is compared with the simulator.

    python docs/research/hardware/play_all.py [--data FOLDER] [--programs FOLDER]

``--data`` holds Ev-Objects.zip and Ev-Containers.zip, of which the first 20 test recordings are played; without it, the
recordings of examples/ are. Rows that played.csv has are left out: delete it to begin anew. ``--programs`` keeps what
was compiled.
"""

from __future__ import annotations

import argparse
import csv
import sys
from itertools import chain
from pathlib import Path

import numpy as np
from shipped import MODELS, ROOT, example_files, model_file

import hw_model as hw
import locsnn_compile as lc
from hw_model.rtl.comparison import compare
from hw_model.rtl.simulators import sources
from locsnn_compile.request.recordings import recordings_for

sys.path.insert(0, str(ROOT / "tests/peers"))
from peer_runs import networks_of
from quirks import PEERS

TABLE = Path(__file__).parent / "played.csv"
COLUMNS = (
    "model",
    "strategy",
    "file",
    "recordings",
    "values",
    "different",
    "cycles different",
    "mean cycles",
)
SETS = {"objects": "Ev-Objects.zip", "containers": "Ev-Containers.zip"}
MOST = 20
"""Recordings of a file that are played."""


def files_of(model: str, data: Path | None) -> list[Path]:
    """Return the files of recordings for a model: those of examples/, and the public set if there is one and it is here."""
    kind = model.split("-")[0]
    return example_files(model) + ([data / SETS[kind]] if data and kind in SETS else [])


def program_of(model: str, strategy: str, network: lc.Network, kept: Path | None) -> hw.ChipProgram:
    """Return a model compiled with a strategy, from folder ``kept`` if it was compiled before."""
    folder = kept / f"{model}-{strategy}" if kept else None
    if folder and folder.exists():
        return hw.load_program(folder)
    program = lc.compile(network, target="loihi-sim", strategy=strategy).program
    if folder:
        program.save(folder)
    return program


def rows(data: Path | None, kept: Path | None, known: set[tuple[str, ...]]):
    """Yield a row for each model, strategy and file of recordings that is not ``known`` already."""
    for model, strategy in MODELS:
        network = lc.load(model_file(model))
        for path in files_of(model, data):
            if (model, strategy, path.name) in known:
                continue
            program = program_of(model, strategy, network, kept)
            recordings = recordings_for(network, path)
            played = network.fit(recordings.spikes[:MOST], recordings.source)
            comparison = compare(program, played, sources())
            counts = (
                comparison["compared_values"],
                comparison["mismatches"],
                comparison["cycle_mismatches"],
            )
            yield (
                model,
                strategy,
                path.name,
                len(played),
                *counts,
                round(np.mean(comparison["cycles"])),
            )


def peer_rows(known: set[tuple[str, ...]]):
    """Yield a row per public simulator: the random networks that ``make peers`` gives to it, with one recording each."""
    for peer in PEERS:
        name = f"random networks of {peer.name}"
        if (name, "", "") in known:
            continue
        comparisons = [
            compare(network.program(), network.spikes[None], sources())
            for network in networks_of(peer)
        ]
        counts = [
            sum(comparison[key] for comparison in comparisons)
            for key in ("compared_values", "mismatches", "cycle_mismatches")
        ]
        yield (
            name,
            "",
            "",
            len(comparisons),
            *counts,
            round(np.mean([comparison["cycles"] for comparison in comparisons])),
        )


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--data", type=Path)
    parser.add_argument("--programs", type=Path)
    arguments = parser.parse_args()
    rows_before = list(csv.reader(TABLE.open())) if TABLE.exists() else []
    with TABLE.open("a", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        if not rows_before:
            writer.writerow(COLUMNS)
        known = {tuple(row[:3]) for row in rows_before}
        for row in chain(peer_rows(known), rows(arguments.data, arguments.programs, known)):
            writer.writerow(row)
            file.flush()
            print(*row, flush=True)
    all_rows = list(csv.DictReader(TABLE.open()))
    totals = [
        sum(int(row[name]) for row in all_rows)
        for name in ("recordings", "values", "different", "cycles different")
    ]
    print(
        "{} recordings, {:,} values compared, {} different, cycles of {} different".format(*totals)
    )


if __name__ == "__main__":
    main()
