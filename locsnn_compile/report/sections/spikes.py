"""The section that shows spikes: the input, and both sides of every population, of one recording."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

import numpy as np

from hw_model.engine.trace import ByteArray
from locsnn_compile.report.content import Block, Document, Paragraph, Raster, Section, Strokes, Table
from locsnn_compile.report.format import NONE, count, plural
from locsnn_compile.report.pictures.ticks import step_ticks
from locsnn_compile.report.words import words

if TYPE_CHECKING:
    from locsnn_compile.verification.excerpt import Excerpt, InputSpikes, PopulationSpikes

_AXIS_LABELS = {"time": "time step", "location": "location step"}


def spikes(document: Document, excerpt: Excerpt | None) -> Section | None:
    """Rasters of input and populations with every difference marked; None where nothing was kept to show."""
    if excerpt is None:
        return None
    side = "network" if document["match"]["reference"] == "integers" else "float"
    blocks: list[Block] = [Paragraph(_shown(excerpt))]
    for axis in excerpt.steps:
        blocks += [_input(item, excerpt) for item in excerpt.inputs if item.axis == axis]
        blocks += [_population(item, excerpt, side) for item in excerpt.populations if item.axis == axis]
    blocks.append(_table(excerpt, side))
    lead = (
        "One recording, a row a neuron, the first at the top. A ring marks the first spike that is on one side only; "
        "without a reset the sides may stay apart from there, spike after spike, by a step or two."
    )
    return Section("spikes", "Spikes", lead, tuple(blocks))


def _shown(excerpt: Excerpt) -> str:
    """Return which recording and steps are shown, and what had to be left out."""
    parts = [
        f"Recording {excerpt.recording}, "
        + ("the first in which a spike differs." if excerpt.first else "the first; no spike of any recording differs.")
    ]
    for axis, steps in excerpt.steps.items():
        if len(steps) < excerpt.all_steps[axis]:
            parts.append(
                f"Of {count(excerpt.all_steps[axis])} {axis} steps, {count(steps[0])} to {count(steps[-1])} are drawn."
            )
    thinned = [item.name for item in excerpt.populations if len(item.neurons) < item.size]
    if thinned:
        parts.append("Of a large population, the neurons with the most differences in the recording are drawn.")
    if excerpt.populations_left_out:
        parts.append(f"{plural(excerpt.populations_left_out, 'further population is', 'further populations are')} not.")
    return " ".join(parts)


def _input(item: InputSpikes, excerpt: Excerpt) -> Raster:
    steps, rows = item.spikes.shape
    together = "" if item.lines_a_row == 1 else f", {item.lines_a_row} to a row"
    return Raster(
        title=f"Input of the {words(item.axis)}: {plural(item.lines, 'line')}{together}",
        description=f"{plural(int(item.spikes.sum(dtype=np.int64)), 'event')} drawn.",
        columns=steps,
        rows=rows,
        x_label=_AXIS_LABELS[item.axis],
        x_ticks=step_ticks(excerpt.steps[item.axis], centred=True),
        strokes=(
            _strokes(
                "event", item.spikes, "input events" if item.lines_a_row == 1 else "strokes, each one event or more"
            ),
        ),
    )


def _population(item: PopulationSpikes, excerpt: Excerpt, side: str) -> Raster:
    steps, rows = item.reference.shape
    equal, reference, chip = _sides(item)
    of = plural(item.size, "neuron") if rows == item.size else f"{count(rows)} of {plural(item.size, 'neuron')}"
    first = excerpt.first
    here = first is not None and first.population == item.name
    return Raster(
        title=f"{item.name}: {of}",
        description=(
            f"{plural(int(equal.sum()), 'spike')} on both sides, {count(int(reference.sum()))} only in the {side} "
            f"network, {count(int(chip.sum()))} only on the chip."
        ),
        columns=steps,
        rows=rows,
        x_label=_AXIS_LABELS[item.axis],
        x_ticks=step_ticks(excerpt.steps[item.axis], centred=True),
        strokes=(
            _strokes("equal", equal, "on both sides"),
            _strokes("reference", reference, f"only in the {side} network"),
            _strokes("chip", chip, "only on the chip"),
        ),
        flag=(first.step - excerpt.steps[item.axis].start, item.neurons.tolist().index(first.neuron))
        if first and here
        else None,
        flag_label=f"neuron {first.neuron}, step {first.step}" if first and here else "",
    )


def _table(excerpt: Excerpt, side: str) -> Table:
    rows = []
    for item in excerpt.populations:
        equal, reference, chip = _sides(item)
        differs = np.flatnonzero((reference | chip).any(axis=1))
        first = count(int(differs[0]) + excerpt.steps[item.axis].start) if len(differs) else NONE
        rows.append((item.name, *(count(int(found.sum())) for found in (equal, reference, chip)), first))
    columns = ("population", "on both sides", f"only {side}", "only chip", "first difference at step")
    return Table(f"Spikes drawn, recording {excerpt.recording}", columns, tuple(rows))


def _sides(item: PopulationSpikes) -> tuple[ByteArray, ByteArray, ByteArray]:
    """Return the spikes of both sides, of the reference alone and of the chip alone."""
    equal = item.reference & item.chip
    return equal, item.reference ^ equal, item.chip ^ equal


def _strokes(kind: Literal["equal", "reference", "chip", "event"], found: ByteArray, label: str) -> Strokes:
    """Return the (column, row) of every spike, row by row."""
    rows, columns = np.nonzero(found.T)
    return Strokes(kind, f"{count(len(rows))} {label}", tuple(zip(columns.tolist(), rows.tolist(), strict=True)))
