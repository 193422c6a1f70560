"""What the steps of a recording cost, one after the other: energy and time a step, by branch."""

from __future__ import annotations

from collections.abc import Callable

from locsnn_compile.report.content import Block, Curve, Document, Plot, Table
from locsnn_compile.report.format import energy, time
from locsnn_compile.report.pictures.ticks import round_numbers
from locsnn_compile.report.words import words

_PARTS = (0.2, 0.4, 0.6, 0.8, 1.0)
"""Parts of a branch's steps after which the table has a figure."""


def courses(document: Document) -> tuple[Block, ...]:
    """Return the course of energy and of time, each drawn and added up in a table."""
    its_energy, its_time = document["energy"], document["latency"]
    return (
        *_course("Energy", its_energy["by_step_pj"], its_energy["profile"], energy),
        *_course("Time", its_time["by_step_ns"], its_time["profile"], time),
    )


def _course(what: str, by_step: Document, profile: str, shown: Callable[[float], str]) -> tuple[Block, ...]:
    """Draw means over a few steps each in their middles; the last of a branch may be of fewer and is left out."""
    whole = {branch: found["bins"][:-1] or found["bins"] for branch, found in by_step.items()}
    a_step = {branch: [value / by_step[branch]["bin_steps"] for value in bins] for branch, bins in whole.items()}
    most = max((value for values in a_step.values() for value in values), default=0.0) or 1.0
    curves = tuple(
        Curve(
            words(branch),
            tuple(((i + 0.5) / len(by_step[branch]["bins"]), value / most) for i, value in enumerate(values)),
        )
        for branch, values in a_step.items()
    )
    return (
        Plot(
            title=f"{what} of a step, mean over the recordings, profile {profile}",
            x_label="part of the branch's steps",
            x_ticks=tuple((part, f"{100 * part:.0f} %") for part in (0.0, *_PARTS)),
            y_ticks=tuple((value / most, shown(value)) for value in round_numbers(0.0, most, 4) if value),
            curves=curves,
        ),
        Table(
            f"{what} up to about there, mean per recording, profile {profile}",
            ("branch", *(f"{100 * part:.0f} % of its steps" for part in _PARTS)),
            tuple(
                (words(branch), *(shown(sum(found["bins"][: round(part * len(found["bins"]))])) for part in _PARTS))
                for branch, found in by_step.items()
            ),
        ),
    )
