"""An exploration as lines of text: every point, what is recommended and why, and the commands of the front."""

from __future__ import annotations

from collections.abc import Sequence

from locsnn_compile.explore.exploration import Exploration
from locsnn_compile.explore.point import Figures, Point
from locsnn_compile.explore.recommend import FRONT_RULE
from locsnn_compile.report.format import NONE, agreed, count, energy, known, plain, share, time
from locsnn_compile.settings import AXES

FIGURES = ("spike error", "class error", "accuracy", "energy", "chip time", "synapses")


def lines(found: Exploration) -> list[str]:
    """Return the lines of the terminal."""
    profile = next(point.figures.energy_profile for point in found.points if point.figures)
    study = found.study
    first = f"{plain(study.network.name)} on {plain(study.chip.name)}, {plain(found.events.words())}, profile {profile}"
    return [first, *warnings(found), "", *_table(found), "", *_reported(found), *_recommended(found), *_commands(found)]


def warnings(found: Exploration) -> list[str]:
    """Return what must be known before the figures are used."""
    if found.events.part == "test":
        return ["Chosen on test recordings: figures on these no longer test the choice."]
    return []


def figure_cells(figures: Figures) -> list[str]:
    """Return the cells of :data:`FIGURES`."""
    return [
        agreed(figures.spike_error),
        agreed(figures.prediction_error, "all tie"),
        known(figures.accuracy, share),
        energy(figures.energy_pj),
        time(figures.chip_time_ns),
        count(figures.synapses),
    ]


def _table(found: Exploration) -> list[str]:
    """Return a row for each point; refused ones come last, each with its reason."""
    engines = found.study.engines
    rows = [["", *(axis.name.replace("_", " ") for axis in AXES), *FIGURES, *engines]]
    refused = []
    for point, mark in zip(found.points, found.on_front, strict=True):
        if point.figures:
            sign = ">" if point is found.recommendation.taken else "*" if mark else ""
            timings = [time(1e9 * point.timings[name].seconds) for name in engines]
            rows.append([sign, *map(str, point.setting.values), *figure_cells(point.figures), *timings])
        elif point.refusal:
            refused.append(f"{point.setting}: {point.refusal.error()}")
    timed = (
        [f"{' and '.join(engines)}: time per recording in the simulator's engines, on this machine."] if engines else []
    )
    return [*_aligned(rows, 1 + len(AXES)), *refused, f"* on the front, > recommended. {FRONT_RULE}", *timed]


def _reported(found: Exploration) -> list[str]:
    if found.reported_on is None:
        return []
    rows = [["", "front", *FIGURES], *(["", *_reported_row(point)] for point in found.reported)]
    return [f"The front on {plain(found.reported_on.words())}:", *_aligned(rows, 2), ""]


def _reported_row(point: Point) -> list[str]:
    return [str(point.setting), *(figure_cells(point.figures) if point.figures else [NONE] * len(FIGURES))]


def _recommended(found: Exploration) -> list[str]:
    taken, why = found.recommendation.taken, found.recommendation.why
    return [f"Recommended: {taken.setting if taken else 'none'}, {why}.", ""]


def _commands(found: Exploration) -> list[str]:
    return ["Commands of the front:", *(f"  {found.command(setting)}" for setting in found.front)]


def _aligned(rows: Sequence[Sequence[str]], names: int) -> list[str]:
    """Return rows with columns of equal width: the first ``names`` of them to the left, figures to the right."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return [
        "  ".join(
            cell.ljust(width) if i < names else cell.rjust(width)
            for i, (cell, width) in enumerate(zip(row, widths, strict=True))
        ).rstrip()
        for row in rows
    ]
