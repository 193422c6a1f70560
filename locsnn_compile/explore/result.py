"""The results of ``locsnn explore`` for one chip: its files, and its lines on the terminal.

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
"""The figures of a point on the terminal, by heading; a word stands for a figure that is None."""
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
    rows: list[Document] = []
    for point in exploration.points:
        for engine, timing in point.timings.items():
            row = {
                **asdict(point.setting),
                "engine": engine,
                "recordings": timing.recordings,
                "seconds_per_recording": timing.seconds,
            }
            rows.append(row)
    return rows


def figures_picture(exploration: Exploration) -> bytes:
    """Draw energy and time on the chip over spike error; equal figures give equal bytes."""
    panels: list[Panel] = []
    # A chip with a profile has energies; the open core has none, but times of exact cycles.
    if exploration.profile:
        energy_title = f"energy per recording ({exploration.profile})"
        panels.append(
            _panel(
                exploration,
                energy_title,
                energy,
                lambda point, figures: figures.energy_pj or 0.0,
            )
        )
    source = exploration.profile or "cycles of the open core"
    time_title = f"time per recording on the chip ({source})"
    panels.append(
        _panel(exploration, time_title, time, lambda point, figures: figures.chip_time_ns)
    )
    return _picture(exploration, "speed, error and energy", panels)


def timings_picture(exploration: Exploration) -> bytes:
    """Draw the time of the simulator per recording, with a panel for each engine."""
    panels = [_engine_panel(exploration, engine) for engine in exploration.study.engines]
    return _picture(exploration, "time in the simulator", panels)


def _engine_panel(exploration: Exploration, engine: Engine) -> Panel:
    """Return the panel with the times of one engine."""
    together = max(
        point.timings[engine].recordings for point in exploration.points if point.figures
    )
    title = f"simulation time per recording, engine {engine}, {together} at a time"
    # ``time`` takes nanoseconds.
    return _panel(
        exploration, title, time, lambda point, figures: 1e9 * point.timings[engine].seconds
    )


def _picture(exploration: Exploration, subject: str, panels: Sequence[Panel]) -> bytes:
    title = f"{exploration.study.network.name} on {exploration.study.chip.name}: {subject}"
    kinds = [str(kind) for kind in _kinds(exploration)]
    return draw(title, exploration.events.words(), kinds, panels)


def _panel(
    exploration: Exploration,
    title: str,
    cost_text: Callable[[float], str],
    cost_of: Callable[[Point, Figures], float],
) -> Panel:
    """Return a panel with a mark for each point: its cost over its spike error.

    A point without a spike error, because no neuron spikes, has no place.
    """
    kinds = _kinds(exploration)
    marks: list[Mark] = []
    for point, is_on_front in zip(exploration.points, exploration.on_front, strict=True):
        figures = point.figures
        if figures is None or figures.spike_error is None:
            continue
        mark = Mark(
            x=figures.spike_error,
            y=cost_of(point, figures),
            kind=kinds.index(point.setting.values[0]),
            label=_label(exploration, point.setting),
            words=_mark_words(point.setting, figures),
            front=is_on_front,
            taken=point is exploration.recommendation.taken,
        )
        marks.append(mark)
    return Panel(title, X_LABEL, lambda error: f"{100 * error:g} %", cost_text, tuple(marks))


def _mark_words(setting: Setting, figures: Figures) -> str:
    """Return the words that are shown when the pointer is on a mark."""
    return (
        f"{setting}: {known(figures.spike_error, share, 'silent')} of spikes differ, "
        f"{known(figures.prediction_error, share, 'none')} of predictions, "
        f"{known(figures.energy_pj, energy, 'energy not known')}, {time(figures.chip_time_ns)}"
    )


def _kinds(exploration: Exploration) -> list[Value]:
    """Return the values of the first dial, the strategy: the marks of each have a shape of their own."""
    return list(dict.fromkeys(point.setting.values[0] for point in exploration.points))


def _label(exploration: Exploration, setting: Setting) -> str:
    """Return the values of those other dials in which points differ."""
    values_by_dial = list(zip(*(point.setting.values for point in exploration.points), strict=True))
    differing = [i for i in range(1, len(DIALS)) if len(set(values_by_dial[i])) > 1]
    return setting.name(differing)


def lines(exploration: Exploration) -> list[str]:
    """Return the lines of the terminal."""
    recommended_point = exploration.recommendation.taken
    recommended = "none" if recommended_point is None else str(recommended_point.setting)
    return [
        _heading(exploration),
        *_warnings(exploration),
        "",
        *_table_lines(exploration),
        "",
        *_reported_lines(exploration),
        f"Recommended: {recommended}, {exploration.recommendation.why}.",
        "",
        "Commands of the front:",
        *(f"  {exploration.command(setting)}" for setting in exploration.front),
    ]


def _heading(exploration: Exploration) -> str:
    """Return the line that names the network, chip, recordings, and the source of the costs."""
    study = exploration.study
    costs = f"profile {exploration.profile}" if exploration.profile else "by cycles"
    names = f"{plain_text(study.network.name)} on {plain_text(study.chip.name)}"
    return f"{names}, {plain_text(exploration.events.words())}, {costs}"


def _warnings(exploration: Exploration) -> list[str]:
    """Return a line for each way in which recordings that test the choice were used for choosing."""
    warnings: list[str] = []
    if exploration.events.part == "test":
        warnings.append("Chosen on test recordings: figures on these no longer test the choice.")
    if exploration.reported_on is not None:
        shared = exploration.reported_on.shared(exploration.events)
        if shared:
            recordings = plural(shared, "recording")
            warnings.append(f"Reported on {recordings} that settings were also chosen on.")
    return warnings


def _table_lines(exploration: Exploration) -> list[str]:
    """Return a row for each point; refused points come last, each with its reason."""
    engines = exploration.study.engines
    recommended_point = exploration.recommendation.taken
    rows = [["", *(dial.name.replace("_", " ") for dial in DIALS), *COLUMNS, *engines]]
    refusals: list[str] = []
    for point, is_on_front in zip(exploration.points, exploration.on_front, strict=True):
        if point.figures is None:
            if point.refused is not None:
                refusals.append(f"{point.setting}: {point.refused}")
            continue
        sign = "*" if is_on_front else ""
        if point is recommended_point:
            sign = ">"
        # ``time`` takes nanoseconds.
        timings = [time(1e9 * point.timings[engine].seconds) for engine in engines]
        rows.append([sign, *map(str, point.setting.values), *_cells(point), *timings])
    lines = [
        *aligned(rows, 1 + len(DIALS)),
        *refusals,
        f"* on the front, > recommended. {FRONT_RULE}",
    ]
    if engines:
        names = " and ".join(engines)
        lines.append(f"{names}: time per recording in the simulator's engines, on this machine.")
    return lines


def _reported_lines(exploration: Exploration) -> list[str]:
    """Return the table of the front on the recordings of ``--report-on``."""
    if exploration.reported_on is None:
        return []
    rows = [["", "front", *COLUMNS]]
    for point in exploration.reported:
        rows.append(["", str(point.setting), *_cells(point)])
    return [f"The front on {plain_text(exploration.reported_on.words())}:", *aligned(rows, 2), ""]


def _cells(point: Point) -> list[str]:
    """Return the figures of a point as texts; dashes for a point without figures."""
    if point.figures is None:
        return [NONE] * len(COLUMNS)
    return [cell_text(point.figures) for cell_text in COLUMNS.values()]


def aligned(rows: Sequence[Sequence[str]], name_columns: int) -> list[str]:
    """Return rows as lines with aligned columns: the first ``name_columns`` to the left, the others to the right."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    formats = [f"{'<' if i < name_columns else '>'}{width}" for i, width in enumerate(widths)]
    return ["  ".join(map(format, row, formats)).rstrip() for row in rows]
