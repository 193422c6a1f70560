"""Energy against accuracy of windows, hybrids and committees: ``docs/research/results/front.csv``.

Points come from three sources: networks that are compiled and played here, rows of ``chip.csv``, and the table of hybrids trained
for the chip. ``paper_pictures.py`` draws them.
"""

from __future__ import annotations

import statistics
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from result_rows import SEEDS
from study import MODELS, Study
from tables import Table, read_table, seeds_of, spread

import locsnn_compile as lc


@dataclass(frozen=True)
class Point:
    """A point of the picture: the networks of a seed, joined if there are several, and how they are compiled.

    ``{}`` in a file's name stands for the seed; a file without it is a network that ships with the project.
    """

    dataset: str
    label: str
    kind: str
    files: tuple[str, ...]
    strategy: str = "auto"
    bits: int = 8


WINDOWS, JOINED, COMMITTEE = "windows", "windows and hybrid", "committee"
PROTOTYPES, LEVELS = "Window-SNN, prototypes", "Window-SNN, neighbouring levels"
THREE, TRAINED = (
    "Three Window-SNNs and hybrid, joined",
    "Three Window-SNNs and hybrid, trained for the chip",
)
TWO_BITS = (f"{LEVELS}, trained with 2 bits", "Window-SNN, trained with 2 bits")
POINTS = (
    Point("objects", "Window-SNN and hybrid, joined", JOINED, ("objects-windows-and-hybrid-{}.pt",), "dendrite"),
    Point("objects", "Window-SNN and hybrid, joined", JOINED, ("objects-windows-and-hybrid-{}.pt",), "reset"),
    Point("objects", THREE, JOINED, ("objects-three-windows-and-hybrid-{}.pt",), "reset"),
    Point("objects", TRAINED, JOINED, ("objects-three-windows-and-trained-hybrid-{}.pt",), "reset"),
    *(Point("objects", PROTOTYPES, WINDOWS, ("objects-window-prototypes-{}.pt",), bits=bits) for bits in (8, 4, 2)),
    *(Point("containers", LEVELS, WINDOWS, ("containers-window-snn-levels-{}.pt",), bits=bits) for bits in (8, 4, 2)),
    *(Point("containers", PROTOTYPES, WINDOWS, ("containers-window-prototypes-{}.pt",), bits=bits) for bits in (8, 4)),
    Point(
        "containers", f"{LEVELS}, and Hybrid trained for the chip", COMMITTEE,
        ("containers-window-snn-levels-{}.pt", "containers-hybrid-loihi.pt"),
    ),
)  # fmt: skip
KNOWN = {
    "Hybrid, lambda 1, loop": "hybrid",
    "Hybrid, lambda 0.5, loop": "hybrid",
    "Tactile-SNN": "hybrid",
    "Window-SNN": WINDOWS,
    "Window-SNN, windows of 16 steps": WINDOWS,
    **dict.fromkeys(TWO_BITS, WINDOWS),
}
"""Rows of ``chip.csv`` that are points as well, and their kind; those in :data:`TWO_BITS` have 2 weight bits, all others 8."""


def front(study: Study) -> Table:
    """Return energy and accuracy on the chip of windows, hybrids and committees, down to 2 bits, over five seeds."""
    rows = []
    for point in POINTS:
        figures_of_seeds = []
        for seed in SEEDS:
            names = [name.format(seed) for name in point.files]
            paths = [
                study.work / name if "{}" in template else MODELS / name
                for template, name in zip(point.files, names, strict=True)
            ]
            if all(path.exists() for path in paths):
                stem = (
                    f"front-{'+'.join(path.stem for path in paths)}-{point.strategy}-{point.bits}"
                )
                figures_of_seeds.append(
                    study.figures(
                        stem, lambda point=point, paths=paths: of_point(study, point, paths)
                    )
                )
        if figures_of_seeds:
            accuracy, pj = (
                spread([figures["right"] for figures in figures_of_seeds]),
                statistics.mean(figures["pj"] for figures in figures_of_seeds),
            )
            compiled_as = f"{point.strategy}, {point.bits} bits"
            cores = f"{statistics.mean(figures['cores'] for figures in figures_of_seeds):.0f}"
            rows.append(
                [
                    point.dataset.title(),
                    point.label,
                    point.kind,
                    compiled_as,
                    accuracy,
                    f"{pj / 1e6:.2f}",
                    cores,
                ]
            )
    chip_rows = read_table(study.tables / "chip.csv")
    for row in chip_rows[1] if chip_rows else ():
        label, _, dataset = row[0].rpartition(", ")
        if label in KNOWN and dataset in ("Objects", "Containers"):
            compiled_as = f"{'auto' if KNOWN[label] == WINDOWS else 'dendrite'}, {2 if label in TWO_BITS else 8} bits"
            rows.append([dataset, label, KNOWN[label], compiled_as, row[2], row[5], ""])
    for dataset, strategy, bits, accuracy, energy in trained_for_the_chip(study.tables):
        rows.append(
            [
                dataset,
                "Hybrid, trained for the chip",
                "hybrid",
                f"{strategy}, {bits} bits",
                accuracy,
                energy,
                "",
            ]
        )
    table_before = read_table(study.tables / "front.csv")
    head = ["set", "network", "kind", "compiled", "accuracy on the chip", "energy, µJ", "cores"]
    return head, over(table_before[1] if table_before else (), rows)


def over(before: Sequence[Sequence[str]], rows: Sequence[Sequence[str]]) -> list[Sequence[str]]:
    """Lay points over those of the table before, where points from more seeds stay, and points whose networks are not here."""
    row_of_point = {tuple(row[:4]): row for row in before}
    for row in rows:
        row_before = row_of_point.get(tuple(row[:4]))
        if row_before is None or seeds_of(row[4]) >= seeds_of(row_before[4]):
            row_of_point[tuple(row[:4])] = row
    return list(row_of_point.values())


def of_point(study: Study, point: Point, paths: Sequence[Path]) -> dict[str, float]:
    """Compile the networks of a seed, check them on the test part, and return accuracy, energy and cores."""
    networks, events = [lc.load(path) for path in paths], study.part(point.dataset, "test")
    model = networks if len(networks) > 1 else networks[0]
    # A committee adds class scores. Windows and hybrids have scores of other sizes; `count_scale` of their training brings each
    # to logarithms of probabilities.
    weights = None if len(networks) == 1 else [1.0, 0.1]
    compiled = lc.compile(
        model,
        strategy=point.strategy,
        weight_bits=point.bits,
        events=events,
        diagnosis=False,
        weights=weights,
    )
    report = compiled.report
    return {
        "right": report["accuracy"]["chip"],
        "pj": report["energy"]["per_sample_pj"],
        "cores": report["resources"]["cores"],
        "members": report["model"].get("members", []),
    }


def trained_for_the_chip(tables: Path) -> list[list[str]]:
    """Return (set, strategy, bits, accuracy, energy) of the hybrids that ``tests/benchmarks/target_aware.py`` trained.

    They are read from the section that it writes into a page. Rows without energy are float networks.
    """
    points = []
    for path in sorted(tables.parent.rglob("*.md")):
        text = path.read_text(encoding="utf-8")
        if "<!-- target-aware: begin -->" in text:
            section = text.partition("<!-- target-aware: begin -->")[2].partition(
                "<!-- target-aware: end -->"
            )[0]
            cells = [
                [cell.strip() for cell in line.strip("|").split("|")]
                for line in section.splitlines()
                if line[:1] == "|"
            ]
            points += [[row[0], row[1], row[2], row[3], row[6]] for row in cells[2:] if row[6]]
    return points
