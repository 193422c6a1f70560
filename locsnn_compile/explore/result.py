"""An exploration as files and as text.

``explore.json``, ``explore.csv`` and ``explore.svg`` hold figures, front and recommendation. They depend only on what
was explored: they have the same bytes wherever the points were measured. ``timings.csv`` and ``timings.svg`` hold the
seconds that the engines took there.
"""

import json
from collections.abc import Callable, Sequence
from dataclasses import asdict

from hw_model.simulation import Engine
from locsnn_compile.explore.document import ExploreDocument, table_row
from locsnn_compile.explore.exploration import FRONT_RULE, Exploration
from locsnn_compile.explore.point import Figures, Point
from locsnn_compile.report.content import Document
from locsnn_compile.report.figures.entries import plain
from locsnn_compile.report.figures.flat import csv_bytes
from locsnn_compile.report.format import NONE, count, energy, known, plural, share, time
from locsnn_compile.report.format import plain as plain_text
from locsnn_compile.report.pictures.scatter import Mark, Panel, draw
from locsnn_compile.settings import DIALS, Setting, Value

COLUMNS: dict[str, Callable[[Figures], str]] = {
    "spike error": lambda figures: known(figures.spike_error, share, "silent"),
    "class error": lambda figures: known(figures.prediction_error, share, "all tie"),
    "score error": lambda figures: known(figures.score_error, share, "all tie"),
    "accuracy": lambda figures: known(figures.accuracy, share),
    "energy": lambda figures: known(figures.energy_pj, energy),
    "chip time": lambda figures: time(figures.chip_time_ns),
    "synapses": lambda figures: count(figures.synapses),
}
"""The figures of a point on the terminal, by heading."""
X_LABEL = "spikes that differ from the float network's"


def exploration_files(exploration: Exploration) -> dict[str, bytes]:
    """Return the files by name."""
    document = ExploreDocument.of(exploration)
    text = json.dumps(plain(document), indent=2, allow_nan=False, ensure_ascii=False)
    return {
        "explore.json": f"{text}\n".encode(),
        "explore.csv": csv_bytes([table_row(point) for point in document.points]),
        "explore.svg": figures_picture(exploration),
        "timings.csv": csv_bytes(timing_rows(exploration)),
        "timings.svg": timings_picture(exploration),
    }


def timing_rows(exploration: Exploration) -> list[Document]:
    """Return a row for each point and engine: seconds per recording, over how many recordings."""
    return [
        asdict(point.setting)
        | {
            "engine": engine,
            "recordings": timing.recordings,
            "seconds_per_recording": timing.seconds,
        }
        for point in exploration.points
        for engine, timing in point.timings.items()
    ]


def figures_picture(exploration: Exploration) -> bytes:
    """Draw energy and time on the chip over spike error; equal figures give equal bytes."""
    timed = f"time per recording on the chip ({exploration.profile or 'cycles of the open core'})"
    panels = [_panel(exploration, timed, time, lambda point, figures: figures.chip_time_ns)]
    if exploration.profile:
        priced = f"energy per recording ({exploration.profile})"
        panels.insert(
            0, _panel(exploration, priced, energy, lambda point, figures: figures.energy_pj or 0.0)
        )
    return _picture(exploration, "speed, error and energy", panels)


def timings_picture(exploration: Exploration) -> bytes:
    """Draw the time of the simulator per recording, with a panel for each engine."""
    return _picture(
        exploration,
        "time in the simulator",
        [_timed_panel(exploration, engine) for engine in exploration.study.engines],
    )


def _timed_panel(exploration: Exploration, engine: Engine) -> Panel:
    many = max(point.timings[engine].recordings for point in exploration.points if point.figures)
    title = f"simulation time per recording, engine {engine}, {many} at a time"
    return _panel(
        exploration, title, time, lambda point, figures: 1e9 * point.timings[engine].seconds
    )


def _picture(exploration: Exploration, what: str, panels: Sequence[Panel]) -> bytes:
    title = f"{exploration.study.network.name} on {exploration.study.chip.name}: {what}"
    return draw(
        title, exploration.events.words(), [str(kind) for kind in _kinds(exploration)], panels
    )


def _panel(
    exploration: Exploration,
    title: str,
    text: Callable[[float], str],
    y: Callable[[Point, Figures], float],
) -> Panel:
    kinds = _kinds(exploration)
    marks = tuple(
        Mark(
            x=error,
            y=y(point, point.figures),
            kind=kinds.index(point.setting.values[0]),
            label=_label(exploration, point.setting),
            words=_mark_words(point.setting, point.figures),
            front=mark,
            taken=point is exploration.recommendation.taken,
        )
        for point, mark in zip(exploration.points, exploration.on_front, strict=True)
        # If no neuron spikes, the mark has no place.
        if point.figures and (error := point.figures.spike_error) is not None
    )
    return Panel(title, X_LABEL, lambda share: f"{100 * share:g} %", text, marks)


def _mark_words(setting: Setting, figures: Figures) -> str:
    return (
        f"{setting}: {known(figures.spike_error, share, 'silent')} of spikes differ, "
        f"{known(figures.prediction_error, share, 'none')} of predictions, "
        f"{known(figures.energy_pj, energy, 'energy not known')}, {time(figures.chip_time_ns)}"
    )


def _kinds(exploration: Exploration) -> list[Value]:
    """Return the values of the first dial; each has a shape of its own."""
    return list(dict.fromkeys(point.setting.values[0] for point in exploration.points))


def _label(exploration: Exploration, setting: Setting) -> str:
    """Return the values on the other dials on which points differ."""
    columns = list(zip(*(point.setting.values for point in exploration.points), strict=True))
    differing = [i for i in range(1, len(DIALS)) if len(set(columns[i])) > 1]
    return setting.name(differing)


def lines(exploration: Exploration) -> list[str]:
    """Return the lines of the terminal."""
    study = exploration.study
    by = f"profile {exploration.profile}" if exploration.profile else "by cycles"
    names = f"{plain_text(study.network.name)} on {plain_text(study.chip.name)}"
    first = f"{names}, {plain_text(exploration.events.words())}, {by}"
    taken, why = exploration.recommendation.taken, exploration.recommendation.why
    recommended = [f"Recommended: {taken.setting if taken else 'none'}, {why}.", ""]
    commands = [
        "Commands of the front:",
        *(f"  {exploration.command(setting)}" for setting in exploration.front),
    ]
    warned = "Chosen on test recordings: figures on these no longer test the choice."
    warnings = [warned] if exploration.events.part == "test" else []
    if exploration.reported_on and (shared := exploration.reported_on.shared(exploration.events)):
        warnings.append(
            f"Reported on {plural(shared, 'recording')} that settings were also chosen on."
        )
    return [
        first,
        *warnings,
        "",
        *_table(exploration),
        "",
        *_reported(exploration),
        *recommended,
        *commands,
    ]


def _table(exploration: Exploration) -> list[str]:
    """Return a row for each point; refused ones come last, each with its reason."""
    engines = exploration.study.engines
    rows = [["", *(dial.name.replace("_", " ") for dial in DIALS), *COLUMNS, *engines]]
    refused = []
    for point, mark in zip(exploration.points, exploration.on_front, strict=True):
        if point.figures:
            sign = ">" if point is exploration.recommendation.taken else "*" if mark else ""
            timings = [time(1e9 * point.timings[name].seconds) for name in engines]
            rows.append([sign, *map(str, point.setting.values), *_cells(point), *timings])
        elif point.refused:
            refused.append(f"{point.setting}: {point.refused}")
    timed = (
        [
            f"{' and '.join(engines)}: time per recording in the simulator's engines, on this machine."
        ]
        if engines
        else []
    )
    return [
        *aligned(rows, 1 + len(DIALS)),
        *refused,
        f"* on the front, > recommended. {FRONT_RULE}",
        *timed,
    ]


def _reported(exploration: Exploration) -> list[str]:
    if exploration.reported_on is None:
        return []
    rows = [
        ["", "front", *COLUMNS],
        *(["", str(point.setting), *_cells(point)] for point in exploration.reported),
    ]
    return [f"The front on {plain_text(exploration.reported_on.words())}:", *aligned(rows, 2), ""]


def _cells(point: Point) -> list[str]:
    if point.figures is None:
        return [NONE] * len(COLUMNS)
    return [shown(point.figures) for shown in COLUMNS.values()]


def aligned(rows: Sequence[Sequence[str]], names: int) -> list[str]:
    """Return rows with aligned columns: the first ``names`` columns to the left, the others to the right."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    forms = [f"{'<' if i < names else '>'}{width}" for i, width in enumerate(widths)]
    return ["  ".join(map(format, row, forms)).rstrip() for row in rows]
