"""One network on several chips, as files and as text."""

import json
from collections.abc import Callable, Sequence
from dataclasses import replace

from locsnn_compile.errors import listed
from locsnn_compile.explore.chips import ChipFigures, ChipsDocument, TriedChip
from locsnn_compile.explore.result import X_LABEL, aligned
from locsnn_compile.report.content import Document
from locsnn_compile.report.figures.entries import keys_of, plain
from locsnn_compile.report.figures.flat import csv_bytes
from locsnn_compile.report.format import count, energy, known, share, time
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


def _table_row(tried: TriedChip) -> Document:
    figures = dict.fromkeys(keys_of(ChipFigures))
    if tried.figures is not None:
        figures = plain(tried.figures)
    return {
        "target": tried.target,
        **figures,
        "refused": tried.refused,
        "command": tried.command,
    }


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
            label=tried.target,
            words=f"{tried.target}: {share(error)} of spikes differ, {text(figure)}",
            front=True,
            taken=tried.target in document.lose_least,
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


def chips_lines(document: ChipsDocument, events: str) -> list[str]:
    """Return the lines of the terminal; ``events`` are the recordings in words."""
    name = plain_text(document.model.name)
    rows = [["", "chip", *COLUMNS]]
    refused: list[str] = []
    for tried in document.chips:
        if tried.figures is None:
            refused.append(f"{tried.target} refuses it: {tried.refused}")
            continue
        figures = tried.figures
        sign = ">" if tried.target in document.lose_least else ""
        rows.append([sign, tried.target, *(shown(figures) for shown in COLUMNS.values())])
    return [
        f"{name} on {len(document.chips)} chips, {plain_text(events)}",
        "",
        *aligned(rows, 1 + NAMES),
        *refused,
        f"> least is lost: the fewest changed classes, then spikes. {WHAT_COSTS_MEAN}",
        *_profile_lines(document),
        "",
        _answer(document),
        "",
        "Commands:",
        *(f"  {tried.command}" for tried in document.chips if tried.figures is not None),
    ]


def _profile_lines(document: ChipsDocument) -> list[str]:
    lines: list[str] = []
    for tried in document.chips:
        if tried.figures is not None and tried.figures.energy_profile is not None:
            lines.append(f"Energy of {tried.target}: profile {tried.figures.energy_profile}.")
    return lines


def _answer(document: ChipsDocument) -> str:
    """Return which chips can run the network, and which of them loses least."""
    refused = [tried.target for tried in document.chips if tried.figures is None]
    cannot = f"; {listed(refused)} cannot" if refused else ""
    lose = "lose" if len(document.lose_least) > 1 else "loses"
    return (
        f"{listed(document.runs_on)} can run {plain_text(document.model.name)}{cannot}. "
        f"{listed(document.lose_least)} {lose} least."
    )
