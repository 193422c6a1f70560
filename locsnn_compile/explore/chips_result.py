"""The results of ``locsnn explore`` for several chips: its files, and its lines on the terminal.

``explore.json``, ``explore.csv`` and ``explore.svg`` depend only on what was explored.
``timings.csv`` has the seconds that the simulator's engines took on this machine.
"""

import json
from collections.abc import Callable, Sequence
from dataclasses import replace

from locsnn_compile.errors import listed
from locsnn_compile.explore.chip_points import ChipFigures, ChipPoint
from locsnn_compile.explore.chips import ChipsDocument, TriedChip
from locsnn_compile.explore.result import X_LABEL, aligned
from locsnn_compile.report.content import Document
from locsnn_compile.report.figures.entries import keys_of, plain
from locsnn_compile.report.figures.flat import csv_bytes
from locsnn_compile.report.format import NONE, count, energy, known, plural, share, time
from locsnn_compile.report.format import plain as plain_text
from locsnn_compile.report.pictures.scatter import Mark, Panel, draw

NOT_KNOWN = "not known"
COLUMNS: dict[str, Callable[[ChipFigures], str]] = {
    "strategy": lambda figures: figures.strategy,
    "weight bits": lambda figures: str(figures.weight_bits),
    "spike error": lambda figures: known(figures.spike_error, share, "silent"),
    "class error": lambda figures: known(figures.prediction_error, share, "all tie"),
    "score error": lambda figures: known(figures.score_error, share, "all tie"),
    "accuracy": lambda figures: known(figures.accuracy, share),
    "cores": lambda figures: count(figures.cores),
    "synaptic operations": lambda figures: count(figures.synaptic_ops),
    "chip time": lambda figures: known(figures.chip_time_ns, time, NOT_KNOWN),
    "energy": lambda figures: known(figures.energy_pj, energy, NOT_KNOWN),
}
"""The figures of a chip on the terminal, by heading; a word stands for a figure that is None."""
NAME_COLUMNS = 2
"""The columns that are aligned to the left after that of the sign: the chip and the strategy."""
WHAT_COSTS_MEAN = (
    "Energy and time are those of each chip's own table or clock: they tell what to expect of a "
    "chip, not which of two is more efficient."
)


def chips_files(document: ChipsDocument, events: str) -> dict[str, bytes]:
    """Return the files by name; equal figures give equal bytes. ``events``: the recordings in words."""
    text = json.dumps(plain(document), indent=2, allow_nan=False, ensure_ascii=False)
    return {
        "explore.json": f"{text}\n".encode(),
        "explore.csv": csv_bytes([_table_row(tried) for tried in document.chips]),
        "explore.svg": _picture(document, events),
    }


def timings_file(points: Sequence[ChipPoint]) -> bytes:
    """Return timings.csv: seconds per recording of each point and engine, over how many recordings."""
    rows: list[Document] = []
    for point in points:
        for engine, timing in point.timings.items():
            row = {
                "target": point.setting.target,
                **point.setting.values,
                "engine": engine,
                "recordings": timing.recordings,
                "seconds_per_recording": timing.seconds,
            }
            rows.append(row)
    return csv_bytes(rows)


def _table_row(tried: TriedChip) -> Document:
    """Return a row of explore.csv.

    Columns that begin with ``asked_`` have the values that the user gave; the figures have the
    strategy and weight bits with which the network was compiled.
    """
    reported = _figure_cells(tried.reported)
    return {
        "target": tried.target,
        **{f"asked_{name}": value for name, value in tried.setting.items()},
        **_figure_cells(tried.figures),
        **{f"reported_{name}": figure for name, figure in reported.items()},
        "keeps_bounds": tried.keeps_bounds,
        "refused": tried.refused,
        "command": tried.command,
        "report_command": tried.report_command,
    }


def _figure_cells(figures: ChipFigures | None) -> Document:
    """Return figures by their columns, which are empty for a chip that has none."""
    if figures is None:
        return dict.fromkeys(keys_of(ChipFigures))
    cells: Document = plain(figures)
    return cells


def _picture(document: ChipsDocument, events: str) -> bytes:
    """Draw operations, time and energy over the spike error, each for the chips of which it is known."""
    operations_title = "synaptic operations per recording"
    panels = [
        _panel(document, operations_title, count, lambda figures: figures.synaptic_ops),
        _panel(
            document,
            "time per recording on the chip",
            time,
            lambda figures: figures.chip_time_ns,
        ),
        _panel(document, "energy per recording", energy, lambda figures: figures.energy_pj),
    ]
    title = f"{document.model.name}: what each chip loses and takes"
    panels_with_marks = [panel for panel in panels if panel.marks]
    return draw(title, events, document.runs_on, panels_with_marks)


def _panel(
    document: ChipsDocument,
    title: str,
    cost_text: Callable[[float], str],
    cost_of: Callable[[ChipFigures], float | None],
) -> Panel:
    """Return a panel with a mark for each row whose spike error and cost are known.

    Marks of one chip have one shape (``kind``), those of rows that lose least have a ring (``taken``),
    and those on the front of this panel are filled.
    """
    marks: list[Mark] = []
    for tried in document.chips:
        if tried.figures is None:
            continue
        error = tried.figures.spike_error
        cost = cost_of(tried.figures)
        if error is None or cost is None:
            continue
        mark = Mark(
            x=error,
            y=cost,
            kind=document.runs_on.index(tried.target),
            label=tried.name,
            words=f"{tried.name}: {share(error)} of spikes differ, {cost_text(cost)}",
            front=True,  # until it is compared with the others
            taken=tried.name in document.lose_least,
        )
        marks.append(mark)
    compared_marks = tuple(_with_front(mark, marks) for mark in marks)
    return Panel(title, X_LABEL, lambda error: f"{100 * error:g} %", cost_text, compared_marks)


def _with_front(mark: Mark, marks: Sequence[Mark]) -> Mark:
    """Return the mark; not on the front if another is as good in error and cost, and better in one."""
    for rival in marks:
        is_as_good = rival.x <= mark.x and rival.y <= mark.y
        is_better = rival.x < mark.x or rival.y < mark.y
        if is_as_good and is_better:
            return replace(mark, front=False)
    return mark


def chips_lines(
    document: ChipsDocument,
    events: str,
    reported_on: str = "",
    points: Sequence[ChipPoint] = (),
) -> list[str]:
    """Return the lines of the terminal.

    ``events`` are the recordings in words, and ``reported_on`` those of ``--report-on``. ``points``
    are those of the document, in the same order: the times of the engines are shown from them.
    """
    name = plain_text(document.model.name)
    chip_count = len(dict.fromkeys(tried.target for tried in document.chips))
    engines = _timed_engines(points)
    engine_lines = []
    if engines:
        engine_lines.append(
            f"{' and '.join(engines)}: time per recording in the simulator's engines, here."
        )
    return [
        f"{name} on {plural(chip_count, 'chip')}, {plain_text(events)}",
        "",
        *_table_lines(document, points, engines),
        *_refusal_lines(document),
        f"> least is lost: the fewest changed classes, then spikes. {WHAT_COSTS_MEAN}",
        *engine_lines,
        *_profile_lines(document),
        "",
        *_reported_lines(document, reported_on),
        _answer(document),
        *_bounds_lines(document),
        "",
        "Commands:",
        *(f"  {tried.command}" for tried in document.chips if tried.figures is not None),
    ]


def _table_lines(
    document: ChipsDocument, points: Sequence[ChipPoint], engines: Sequence[str]
) -> list[str]:
    """Return the table of all rows that have figures, with the times of the engines on the right."""
    points_with_figures = [point for point in points if point.figures is not None]
    rows_with_figures = [tried for tried in document.chips if tried.figures is not None]
    rows = [["", "chip", *COLUMNS, *engines]]
    for number, tried in enumerate(rows_with_figures):
        cells = _cells(document, tried, tried.figures)
        for engine in engines:
            seconds = points_with_figures[number].timings[engine].seconds
            cells.append(time(1e9 * seconds))  # ``time`` takes nanoseconds
        rows.append(cells)
    return aligned(rows, 1 + NAME_COLUMNS)


def _timed_engines(points: Sequence[ChipPoint]) -> tuple[str, ...]:
    """Return the engines that were timed: the same for all points that have figures."""
    for point in points:
        if point.timings:
            return tuple(point.timings)
    return ()


def _cells(document: ChipsDocument, tried: TriedChip, figures: ChipFigures | None) -> list[str]:
    """Return a row of the table: a sign if least is lost, the name, and the figures."""
    sign = ">" if tried.name in document.lose_least else ""
    if figures is None:
        return [sign, tried.name, *(NONE for _ in COLUMNS)]
    return [sign, tried.name, *(cell_text(figures) for cell_text in COLUMNS.values())]


def _refusal_lines(document: ChipsDocument) -> list[str]:
    """Return a line for each sentence by which a chip refuses some rows.

    The line names the chip if the sentence refuses all its rows, and otherwise the rows.
    """
    refused_names: dict[tuple[str, str], list[str]] = {}
    for tried in document.chips:
        if tried.refused is not None:
            refused_names.setdefault((tried.target, tried.refused), []).append(tried.name)
    lines: list[str] = []
    for (target, sentence), names in refused_names.items():
        rows_of_chip = [tried for tried in document.chips if tried.target == target]
        is_every_row = len(names) == len(rows_of_chip)
        subject = target if is_every_row else listed(names)
        verb = "refuses" if is_every_row or len(names) == 1 else "refuse"
        lines.append(f"{subject} {verb} it: {sentence}")
    return lines


def _reported_lines(document: ChipsDocument, reported_on: str) -> list[str]:
    """Return the table of the figures on the recordings of ``--report-on``."""
    if document.reported_on is None:
        return []
    rows = [["", "chip", *COLUMNS]]
    for tried in document.chips:
        if tried.figures is not None:
            rows.append(_cells(document, tried, tried.reported))
    return [f"On {plain_text(reported_on)}:", *aligned(rows, 1 + NAME_COLUMNS), ""]


def _profile_lines(document: ChipsDocument) -> list[str]:
    """Return, for each chip with energies, the profile of published costs that they come from."""
    profiles = {
        tried.target: tried.figures.energy_profile
        for tried in document.chips
        if tried.figures is not None and tried.figures.energy_profile is not None
    }
    return [f"Energy of {target}: profile {profile}." for target, profile in profiles.items()]


def _answer(document: ChipsDocument) -> str:
    """Return the sentences on which chips can run the network, and which rows lose least."""
    targets = dict.fromkeys(tried.target for tried in document.chips)
    refusing = [target for target in targets if target not in document.runs_on]
    cannot = f"; {listed(refusing)} cannot" if refusing else ""
    verb = "lose" if len(document.lose_least) > 1 else "loses"
    return (
        f"{listed(document.runs_on)} can run {plain_text(document.model.name)}{cannot}. "
        f"{listed(document.lose_least)} {verb} least."
    )


def _bounds_lines(document: ChipsDocument) -> list[str]:
    """Return a line on which rows keep the bounds; nothing without bounds."""
    if document.bounds is None:
        return []
    names = document.keep_bounds
    if not names:
        return [f"None keeps {document.bounds.words()}."]
    verb = "keep" if len(names) > 1 else "keeps"
    return [f"{listed(names)} {verb} {document.bounds.words()}."]
