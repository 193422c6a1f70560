"""Sections on one recording: its input, the spikes of both sides, and the potential that differs first.

An excerpt is the part of one recording that is shown: some steps, neurons and input lines. It is taken around
the first spike that differs between the network and the chip, or from the first recording if none does.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Literal, NamedTuple

import numpy as np

from hw_model.values import ByteArray
from locsnn_compile.report.content import Curve, Folded, Plot, Raster, Section, Strokes, Table
from locsnn_compile.report.figures.match import MatchFigures, ReadoutFigures
from locsnn_compile.report.format import NONE, SILENT, count, plural, told_apart
from locsnn_compile.report.pictures.axis import step_axis, value_axis
from locsnn_compile.report.sections.accuracy import no_spikes
from locsnn_compile.report.words import words
from locsnn_compile.verification.excerpt import Excerpt, NeuronPotential, SpikeRows

_STEPS_AROUND = 3
"""Steps before and after the central one in the table of potentials."""
_SPIKES = (
    "One recording, one row per neuron, the first at the top. A ring marks the first spike that only "
    "one side has; without a reset, later spikes may stay a step or two apart."
)
_AN_EXAMPLE = "No spike differs; this neuron of the readout is an example."
_ITS_DIFFERENCE = "Its first spike that differs is marked."


def spikes(match: MatchFigures, excerpt: Excerpt | None) -> Section | None:
    """Return the section on spikes: rasters of inputs and populations with every difference marked.

    None without an excerpt. One raster is shown at first sight, and the others are folded.
    """
    if excerpt is None:
        return None
    excerpt = _without_silent_readouts(excerpt, match.readout)
    side = _network_side(match)
    rasters: list[Raster] = []
    for phase in excerpt.steps:
        for rows in excerpt.inputs:
            if rows.phase == phase:
                rasters.append(_input(rows, excerpt))
        for rows in excerpt.populations:
            if rows.phase == phase:
                rasters.append(_population(rows, excerpt, side))
    at_first_sight = _with_flag_or_last(rasters)
    others = [raster for raster in rasters if raster is not at_first_sight]
    return Section.of(
        "spikes",
        "Spikes",
        _SPIKES,
        _extent(excerpt),
        at_first_sight,
        Folded.of(
            "Inputs, other populations, and the spikes in figures",
            *others,
            _spike_table(excerpt, side),
        ),
    )


def _with_flag_or_last(rasters: Sequence[Raster]) -> Raster | None:
    """Return the raster of the first spike that differs, or the last one, which is an output."""
    flagged = [raster for raster in rasters if raster.flag is not None]
    candidates = flagged or rasters
    return candidates[-1] if candidates else None


def _network_side(match: MatchFigures) -> str:
    """Return what the network's side is called: ``float``, or ``network`` if it is in integers itself."""
    return "network" if match.reference == "integers" else "float"


def _without_silent_readouts(excerpt: Excerpt, readout: ReadoutFigures) -> Excerpt:
    """Return the excerpt without populations that are read by potential and never spike in it."""
    populations = [
        rows
        for rows in excerpt.populations
        if rows.reference.any() or rows.chip.any() or no_spikes(readout, rows.name) == SILENT
    ]
    left_out = excerpt.populations_left_out + len(excerpt.populations) - len(populations)
    return replace(excerpt, populations=tuple(populations), populations_left_out=left_out)


def _extent(excerpt: Excerpt) -> str:
    """Say which recording and steps are shown, and what is left out."""
    why_this = "the first one, as no spike of any recording differs."
    if excerpt.first is not None:
        why_this = "the first in which a spike differs."
    sentences = [f"Recording {excerpt.recording}, {why_this}"]
    for phase, steps in excerpt.steps.items():
        all_steps = excerpt.all_steps[phase]
        if len(steps) < all_steps:
            sentences.append(
                f"Of {count(all_steps)} {phase} steps, {count(steps[0])} to {count(steps[-1])} are drawn."
            )
    has_large_populations = any(len(rows.numbers) < rows.size for rows in excerpt.populations)
    if has_large_populations:
        sentences.append(
            "Large populations are drawn in part: the neurons with the most differences, then the busiest ones."
        )
    left_out = excerpt.populations_left_out
    if left_out:
        populations = plural(left_out, "further population is", "further populations are")
        sentences.append(f"{populations} not drawn.")
    return " ".join(sentences)


def _input(rows: SpikeRows, excerpt: Excerpt) -> Raster:
    """Draw the events of an input. Where there are many lines, several share a row and a stroke."""
    title = f"Input of the {words(rows.phase)}: {plural(rows.size, 'line')}"
    label = "input events"
    if rows.together > 1:
        title = f"{title}, {rows.together} per row"
        label = "strokes, each one event or more"
    events = int(rows.reference.sum(dtype=np.int64))
    steps, row_count = rows.reference.shape
    return Raster(
        title,
        f"{plural(events, 'event')} drawn.",
        columns=steps,
        rows=row_count,
        x_label=f"{rows.axis} step",
        x=step_axis(excerpt.steps[rows.phase], centred=True),
        strokes=(_strokes("event", rows.reference, label),),
    )


def _population(rows: SpikeRows, excerpt: Excerpt, side: str) -> Raster:
    """Draw the spikes of a population on both sides, with a flag at the first difference if it lies here."""
    steps, row_count = rows.reference.shape
    equal, only_reference, only_chip = _sides(rows)
    neurons = plural(rows.size, "neuron")
    if row_count < rows.size:
        neurons = f"{count(row_count)} of {neurons}"
    network = "network" if side == "network" else f"{side} network"
    flag = None
    flag_label = ""
    first = excerpt.first
    if first is not None and first.population == rows.name:
        column = first.step - excerpt.steps[rows.phase].start
        row = rows.numbers.tolist().index(first.neuron)
        flag = column, row
        flag_label = f"neuron {first.neuron}, step {first.step}"
    return Raster(
        f"{rows.name}: {neurons}",
        f"{plural(int(equal.sum()), 'spike')} on both sides, "
        f"{count(int(only_reference.sum()))} only in the {network}, "
        f"{count(int(only_chip.sum()))} only on the chip.",
        columns=steps,
        rows=row_count,
        x_label=f"{rows.axis} step",
        x=step_axis(excerpt.steps[rows.phase], centred=True),
        strokes=(
            _strokes("equal", equal, "on both sides"),
            _strokes("reference", only_reference, f"only in the {network}"),
            _strokes("chip", only_chip, "only on the chip"),
        ),
        flag=flag,
        flag_label=flag_label,
    )


def _spike_table(excerpt: Excerpt, side: str) -> Table:
    """Return how many of the drawn spikes of each population are on both sides, and on each side alone."""
    table_rows = []
    for rows in excerpt.populations:
        spikes = (count(int(spikes_of_side.sum())) for spikes_of_side in _sides(rows))
        steps_that_differ = np.flatnonzero((rows.reference ^ rows.chip).any(axis=1))
        first = NONE
        if len(steps_that_differ):
            first = count(int(steps_that_differ[0]) + excerpt.steps[rows.phase].start)
        table_rows.append((rows.name, *spikes, first))
    return Table(
        f"Spikes drawn, recording {excerpt.recording}",
        ("population", "on both sides", f"only {side}", "only chip", "first difference at step"),
        tuple(table_rows),
    )


def _sides(rows: SpikeRows) -> tuple[ByteArray, ByteArray, ByteArray]:
    """Return the spikes on both sides, only in the reference, and only on the chip, (steps, rows) each."""
    equal = rows.reference & rows.chip
    return equal, rows.reference ^ equal, rows.chip ^ equal


def _strokes(
    kind: Literal["equal", "reference", "chip", "event"], spikes: ByteArray, label: str
) -> Strokes:
    """Return a stroke at (column, row) for every spike, row by row."""
    rows, columns = np.nonzero(spikes.T)
    return Strokes(
        kind,
        f"{count(len(rows))} {label}",
        tuple(zip(columns.tolist(), rows.tolist(), strict=True)),
    )


def potential(match: MatchFigures, excerpt: Excerpt | None) -> Section | None:
    """Return the section on the potential of one neuron on both sides; None without an excerpt.

    It shows the potentials with the threshold, and the chip's error. ``difference`` in the helpers below is
    the index of the step in which spikes differ, None if none does.
    """
    if excerpt is None:
        return None
    side = _network_side(match)
    neuron = excerpt.potential
    first = excerpt.first
    difference = None if first is None else first.step - neuron.first_step
    title = "Potential of a neuron" if first is None else "Potential around the first difference"
    name = f"{neuron.population}, neuron {neuron.neuron}, recording {excerpt.recording}"
    lead = f"{name}: the potential that the threshold sees, before any reset. "
    lead += _AN_EXAMPLE if first is None else _ITS_DIFFERENCE
    return Section.of(
        "potential",
        title,
        lead,
        _potentials(neuron, side, difference),
        _error(neuron, side, difference),
        Folded.of("Potentials in figures", _table_around(neuron, side, difference)),
    )


def _potentials(neuron: NeuronPotential, side: str, difference: int | None) -> Plot:
    """Draw the potentials of both sides and the threshold, with a line at the difference."""
    potentials = {
        f"{side} potential": neuron.reference.tolist(),
        "chip potential": neuron.chip.tolist(),
    }
    return _plot(
        f"{neuron.population}, neuron {neuron.neuron}: potential",
        neuron,
        potentials,
        _Level(f"threshold, {neuron.threshold:.6g}", neuron.threshold),
        marked=None if difference is None else neuron.first_step + difference,
    )


def _error(neuron: NeuronPotential, side: str, difference: int | None) -> Plot:
    """Draw the error of the chip while all spikes are equal; later errors come from the spike that differs."""
    title = "Error of the chip's potential, in percent of the threshold"
    stop = None
    if difference is not None:
        title += ", until spikes differ"
        stop = difference + 1
    # A threshold of 0 has no percents; then the error is 100 times its own value.
    unit = abs(neuron.threshold) or 1.0
    error_percent = 100.0 * (neuron.chip - neuron.reference)[:stop] / unit
    return _plot(
        title,
        neuron,
        {f"chip minus {side}": error_percent.tolist()},
        _Level("no error", 0.0),
        unit=" %",
    )


class _Level(NamedTuple):
    """A value at which a plot has a horizontal line, with its label."""

    label: str
    value: float


def _plot(
    title: str,
    neuron: NeuronPotential,
    series: dict[str, list[float]],
    level: _Level,
    unit: str = "",
    marked: float | None = None,
) -> Plot:
    """Draw values by step as curves, with a horizontal line at ``level`` and a vertical one at step ``marked``."""
    steps = len(next(iter(series.values())))
    x = step_axis(range(neuron.first_step, neuron.first_step + steps), centred=False)
    curves = [
        Curve(label, tuple(enumerate(values, neuron.first_step)))
        for label, values in series.items()
    ]
    curves.append(Curve(level.label, ((x.low, level.value), (x.high, level.value))))
    y = value_axis([value for curve in curves for _, value in curve.points], unit)
    return Plot(title, f"{neuron.axis} step", x, y, tuple(curves), marked)


def _table_around(neuron: NeuronPotential, side: str, difference: int | None) -> Table:
    """Return the potentials around the difference, or around the middle of the steps if there is none."""
    steps = len(neuron.reference)
    centre = steps // 2 if difference is None else difference
    start = max(0, centre - _STEPS_AROUND)
    stop = min(steps, centre + _STEPS_AROUND + 1)
    reference = neuron.reference[start:stop].tolist()
    chip = neuron.chip[start:stop].tolist()
    # All with the same number of digits, enough to see on which side of the threshold they lie.
    texts = told_apart([*reference, *chip, float(neuron.threshold)])
    reference_texts = texts[: len(reference)]
    chip_texts = texts[len(reference) : -1]
    rows = []
    for step, reference_text, chip_text in zip(
        range(start, stop), reference_texts, chip_texts, strict=True
    ):
        fired = []
        if neuron.reference_spikes[step]:
            fired.append(side)
        if neuron.chip_spikes[step]:
            fired.append("chip")
        rows.append(
            (
                str(neuron.first_step + step),
                reference_text,
                chip_text,
                " and ".join(fired) or NONE,
            )
        )
    return Table(
        f"{neuron.population}, neuron {neuron.neuron}, threshold {neuron.threshold:.6g}",
        ("step", f"{side} potential", "chip potential", "spike of"),
        tuple(rows),
    )
