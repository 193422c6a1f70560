"""One network on several chips, as files and as text."""

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
"""The figures of a chip on the terminal, by heading."""
NAMES = 2
"""The columns on the left: the chip and the strategy."""
WHAT_COSTS_MEAN = (
    "Energy and time are those of each chip's own table or clock: they tell what to expect of a "
    "chip, not which of two is more efficient."
)


def chips_files(document: ChipsDocument, events: str) -> dict[str, bytes]:
    """Return the files by name, with ``events`` in words; equal figures give equal bytes."""
    text = json.dumps(plain(document), indent=2, allow_nan=False, ensure_ascii=False)
    return {
        "explore.json": f"{text}\n".encode(),
        "explore.csv": csv_bytes([_table_row(tried) for tried in document.chips]),
        "explore.svg": _picture(document, events),
    }


def timings_file(points: Sequence[ChipPoint]) -> bytes:
    """Return timings.csv: seconds per recording of each row and engine, over how many recordings."""
    return csv_bytes(
        [
            {
                "target": point.setting.target,
                **point.setting.values,
                "engine": engine,
                "recordings": timing.recordings,
                "seconds_per_recording": timing.seconds,
            }
            for point in points
            for engine, timing in point.timings.items()
        ]
    )


def _table_row(tried: TriedChip) -> Document:
    """Return a row of explore.csv; figures say the strategy and the width that were taken."""
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
    if figures is None:
        return dict.fromkeys(keys_of(ChipFigures))
    cells: Document = plain(figures)
    return cells


def _picture(document: ChipsDocument, events: str) -> bytes:
    """Draw operations, and time and energy of the chips of which they are known, over errors."""
    panels = [
        _panel(
            document, "synaptic operations per recording", count, lambda each: each.synaptic_ops
        ),
        _panel(document, "time per recording on the chip", time, lambda each: each.chip_time_ns),
        _panel(document, "energy per recording", energy, lambda each: each.energy_pj),
    ]
    title = f"{document.model.name}: what each chip loses and takes"
    shown = [panel for panel in panels if panel.marks]
    return draw(title, events, document.runs_on, shown)


def _panel(
    document: ChipsDocument,
    title: str,
    text: Callable[[float], str],
    cost: Callable[[ChipFigures], float | None],
) -> Panel:
    marks: list[Mark] = []
    for tried in document.chips:
        if tried.figures is None:
            continue
        error = tried.figures.spike_error
        figure = cost(tried.figures)
        if error is None or figure is None:
            continue
        mark = Mark(
            x=error,
            y=figure,
            kind=document.runs_on.index(tried.target),
            label=tried.name,
            words=f"{tried.name}: {share(error)} of spikes differ, {text(figure)}",
            front=True,
            taken=tried.name in document.lose_least,
        )
        marks.append(mark)
    front = tuple(_on_front(mark, marks) for mark in marks)
    return Panel(title, X_LABEL, lambda error: f"{100 * error:g} %", text, front)


def _on_front(mark: Mark, marks: Sequence[Mark]) -> Mark:
    """Return a mark that says whether another is as good in both figures, and better in one."""
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

    ``events`` are the recordings in words, and ``reported_on`` those of ``--report-on``. Of
    ``points``, the times in the engines are shown.
    """
    name = plain_text(document.model.name)
    engines = _engines(points)
    timings = [
        [time(1e9 * point.timings[engine].seconds) for engine in engines]
        for point in points
        if point.figures is not None
    ]
    rows = [["", "chip", *COLUMNS, *engines]]
    with_figures = [tried for tried in document.chips if tried.figures is not None]
    for number, tried in enumerate(with_figures):
        seconds = timings[number] if engines else []
        rows.append([*_cells(document, tried, tried.figures), *seconds])
    timed = f"{' and '.join(engines)}: time per recording in the simulator's engines, here."
    shown_chips = dict.fromkeys(tried.target for tried in document.chips)
    return [
        f"{name} on {plural(len(shown_chips), 'chip')}, {plain_text(events)}",
        "",
        *aligned(rows, 1 + NAMES),
        *_refusals(document),
        f"> least is lost: the fewest changed classes, then spikes. {WHAT_COSTS_MEAN}",
        *([timed] if engines else []),
        *_profile_lines(document),
        "",
        *_reported(document, reported_on),
        _answer(document),
        *_kept(document),
        "",
        "Commands:",
        *(f"  {tried.command}" for tried in with_figures),
    ]


def _engines(points: Sequence[ChipPoint]) -> tuple[str, ...]:
    for point in points:
        if point.timings:
            return tuple(point.timings)
    return ()


def _cells(document: ChipsDocument, tried: TriedChip, figures: ChipFigures | None) -> list[str]:
    """Return a row of the table: whether least is lost, the name, and the figures."""
    sign = ">" if tried.name in document.lose_least else ""
    if figures is None:
        return [sign, tried.name, *(NONE for _ in COLUMNS)]
    return [sign, tried.name, *(shown(figures) for shown in COLUMNS.values())]


def _refusals(document: ChipsDocument) -> list[str]:
    """Return a line for each sentence by which a chip refuses some rows."""
    names: dict[tuple[str, str], list[str]] = {}
    for tried in document.chips:
        if tried.refused is not None:
            names.setdefault((tried.target, tried.refused), []).append(tried.name)
    lines: list[str] = []
    for (target, sentence), of_rows in names.items():
        rows_of_chip = [tried for tried in document.chips if tried.target == target]
        is_every_row = len(of_rows) == len(rows_of_chip)
        refusing = target if is_every_row else listed(of_rows)
        refuse = "refuses" if is_every_row or len(of_rows) == 1 else "refuse"
        lines.append(f"{refusing} {refuse} it: {sentence}")
    return lines


def _reported(document: ChipsDocument, reported_on: str) -> list[str]:
    if document.reported_on is None:
        return []
    rows = [["", "chip", *COLUMNS]]
    for tried in document.chips:
        if tried.figures is not None:
            rows.append(_cells(document, tried, tried.reported))
    return [f"On {plain_text(reported_on)}:", *aligned(rows, 1 + NAMES), ""]


def _profile_lines(document: ChipsDocument) -> list[str]:
    profiles = {
        tried.target: tried.figures.energy_profile
        for tried in document.chips
        if tried.figures is not None and tried.figures.energy_profile is not None
    }
    return [f"Energy of {target}: profile {profile}." for target, profile in profiles.items()]


def _answer(document: ChipsDocument) -> str:
    """Return which chips can run the network, and which of them loses least."""
    targets = dict.fromkeys(tried.target for tried in document.chips)
    refused = [target for target in targets if target not in document.runs_on]
    cannot = f"; {listed(refused)} cannot" if refused else ""
    lose = "lose" if len(document.lose_least) > 1 else "loses"
    return (
        f"{listed(document.runs_on)} can run {plain_text(document.model.name)}{cannot}. "
        f"{listed(document.lose_least)} {lose} least."
    )


def _kept(document: ChipsDocument) -> list[str]:
    """Return which rows keep the bounds, if there are any bounds."""
    if document.bounds is None:
        return []
    keeping = document.keep_bounds
    if not keeping:
        return [f"None keeps {document.bounds.words()}."]
    keep = "keep" if len(keeping) > 1 else "keeps"
    return [f"{listed(keeping)} {keep} {document.bounds.words()}."]
