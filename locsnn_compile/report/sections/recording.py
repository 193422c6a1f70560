"""Sections on one recording: its input, the spikes of both sides, and the potential that differs first."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Literal

import numpy as np

from hw_model.values import ByteArray
from locsnn_compile.report.content import Curve, Folded, Plot, Raster, Section, Strokes, Table
from locsnn_compile.report.figures.match import MatchFigures, ReadoutFigures
from locsnn_compile.report.format import NONE, SILENT, count, plural, told_apart
from locsnn_compile.report.pictures.axis import Axis, step_axis, value_axis
from locsnn_compile.report.sections.accuracy import no_spikes
from locsnn_compile.report.words import words
from locsnn_compile.verification.excerpt import Excerpt, NeuronPotential, SpikeRows

_BESIDE = 3
"""Steps before and after the central one in the table."""
_SPIKES = (
    "One recording, one row per neuron, the first at the top. A ring marks the first spike that only "
    "one side has; without a reset, later spikes may stay a step or two apart."
)
_AN_EXAMPLE = "No spike differs; this neuron of the readout is an example."
_ITS_DIFFERENCE = "Its first spike that differs is marked."


def spikes(match: MatchFigures, excerpt: Excerpt | None) -> Section | None:
    """Rasters of inputs and populations with every difference marked; None without an excerpt."""
    if excerpt is None:
        return None
    excerpt = _that_spike(excerpt, match.readout)
    side = _side(match)
    rasters: list[Raster] = []
    for phase in excerpt.steps:
        rasters += [_input(item, excerpt) for item in excerpt.inputs if item.phase == phase]
        rasters += [
            _population(item, excerpt, side) for item in excerpt.populations if item.phase == phase
        ]
    at_first_sight = _with_flag_or_last(rasters)
    others = [raster for raster in rasters if raster is not at_first_sight]
    return Section.of(
        "spikes",
        "Spikes",
        _SPIKES,
        _shown(excerpt),
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


def _side(match: MatchFigures) -> str:
    """Return what the network's side is called."""
    return "network" if match.reference == "integers" else "float"


def _that_spike(excerpt: Excerpt, readout: ReadoutFigures) -> Excerpt:
    """Return the excerpt without populations that are read by potential and never spike in it."""
    kept = [
        item
        for item in excerpt.populations
        if item.reference.any() or item.chip.any() or no_spikes(readout, item.name) == SILENT
    ]
    left_out = excerpt.populations_left_out + len(excerpt.populations) - len(kept)
    return replace(excerpt, populations=tuple(kept), populations_left_out=left_out)


def _shown(excerpt: Excerpt) -> str:
    """Return which recording and steps are shown, and what is left out."""
    parts = [
        f"Recording {excerpt.recording}, "
        + (
            "the first in which a spike differs."
            if excerpt.first
            else "the first one, as no spike of any recording differs."
        )
    ]
    for phase, steps in excerpt.steps.items():
        every = excerpt.all_steps[phase]
        if len(steps) < every:
            parts.append(
                f"Of {count(every)} {phase} steps, {count(steps[0])} to {count(steps[-1])} are drawn."
            )
    thinned = [item.name for item in excerpt.populations if len(item.numbers) < item.size]
    if thinned:
        parts.append(
            "Large populations are drawn in part: the neurons with the most differences, then the busiest ones."
        )
    if left := excerpt.populations_left_out:
        parts.append(
            f"{plural(left, 'further population is', 'further populations are')} not drawn."
        )
    return " ".join(parts)


def _input(item: SpikeRows, excerpt: Excerpt) -> Raster:
    alone = item.together == 1
    title = f"Input of the {words(item.phase)}: {plural(item.size, 'line')}"
    strokes = _strokes(
        "event", item.reference, "input events" if alone else "strokes, each one event or more"
    )
    return Raster(
        title if alone else f"{title}, {item.together} per row",
        f"{plural(int(item.reference.sum(dtype=np.int64)), 'event')} drawn.",
        *_axes(item, excerpt),
        strokes=(strokes,),
    )


def _population(item: SpikeRows, excerpt: Excerpt, side: str) -> Raster:
    rows = item.reference.shape[1]
    equal, reference, chip = _sides(item)
    of = (
        plural(item.size, "neuron")
        if rows == item.size
        else f"{count(rows)} of {plural(item.size, 'neuron')}"
    )
    network = "network" if side == "network" else f"{side} network"
    flag, flag_label, first = None, "", excerpt.first
    if first is not None and first.population == item.name:
        flag = (
            first.step - excerpt.steps[item.phase].start,
            item.numbers.tolist().index(first.neuron),
        )
        flag_label = f"neuron {first.neuron}, step {first.step}"
    return Raster(
        f"{item.name}: {of}",
        f"{plural(int(equal.sum()), 'spike')} on both sides, {count(int(reference.sum()))} only in the {network}, "
        f"{count(int(chip.sum()))} only on the chip.",
        *_axes(item, excerpt),
        strokes=(
            _strokes("equal", equal, "on both sides"),
            _strokes("reference", reference, f"only in the {network}"),
            _strokes("chip", chip, "only on the chip"),
        ),
        flag=flag,
        flag_label=flag_label,
    )


def _axes(item: SpikeRows, excerpt: Excerpt) -> tuple[int, int, str, Axis]:
    """Return the columns and rows of a raster, and its axis with the label."""
    return (
        *item.reference.shape,
        f"{item.axis} step",
        step_axis(excerpt.steps[item.phase], centred=True),
    )


def _spike_table(excerpt: Excerpt, side: str) -> Table:
    rows = []
    for item in excerpt.populations:
        spikes = (count(int(on_side.sum())) for on_side in _sides(item))
        differs = np.flatnonzero((item.reference ^ item.chip).any(axis=1))
        first = NONE
        if len(differs):
            first = count(int(differs[0]) + excerpt.steps[item.phase].start)
        rows.append((item.name, *spikes, first))
    return Table(
        f"Spikes drawn, recording {excerpt.recording}",
        ("population", "on both sides", f"only {side}", "only chip", "first difference at step"),
        tuple(rows),
    )


def _sides(item: SpikeRows) -> tuple[ByteArray, ByteArray, ByteArray]:
    """Return the spikes on both sides, only in the reference, and only on the chip."""
    equal = item.reference & item.chip
    return equal, item.reference ^ equal, item.chip ^ equal


def _strokes(
    kind: Literal["equal", "reference", "chip", "event"], spikes: ByteArray, label: str
) -> Strokes:
    """Return the (column, row) of every spike, row by row."""
    rows, columns = np.nonzero(spikes.T)
    return Strokes(
        kind,
        f"{count(len(rows))} {label}",
        tuple(zip(columns.tolist(), rows.tolist(), strict=True)),
    )


def potential(match: MatchFigures, excerpt: Excerpt | None) -> Section | None:
    """Potentials of both sides with the threshold, and their difference; None without an excerpt."""
    if excerpt is None:
        return None
    side = _side(match)
    shown, first = excerpt.potential, excerpt.first
    where = f"{shown.population}, neuron {shown.neuron}, recording {excerpt.recording}"
    at = None if first is None else first.step - shown.first_step
    title = "Potential of a neuron" if first is None else "Potential around the first difference"
    lead = f"{where}: the potential that the threshold sees, before any reset. "
    lead += _AN_EXAMPLE if first is None else _ITS_DIFFERENCE
    return Section.of(
        "potential",
        title,
        lead,
        _potentials(shown, side, at),
        _difference(shown, side, at),
        Folded.of("Potentials in figures", _around(shown, side, at)),
    )


def _potentials(shown: NeuronPotential, side: str, at: int | None) -> Plot:
    both = {f"{side} potential": shown.reference.tolist(), "chip potential": shown.chip.tolist()}
    title, level = f"{shown.population}, neuron {shown.neuron}: potential", shown.threshold
    marked = None if at is None else shown.first_step + at
    return _plot(title, shown, both, (f"threshold, {level:.6g}", level), marked=marked)


def _difference(shown: NeuronPotential, side: str, at: int | None) -> Plot:
    """Draw the error of the chip while all spikes are equal; later errors come from the spike that differs."""
    until = None if at is None else at + 1
    off = 100.0 * (shown.chip - shown.reference)[:until] / (abs(shown.threshold) or 1.0)
    title = "Error of the chip's potential, in percent of the threshold"
    title += "" if at is None else ", until spikes differ"
    return _plot(title, shown, {f"chip minus {side}": off.tolist()}, ("no error", 0.0), " %")


def _plot(
    title: str,
    shown: NeuronPotential,
    series: dict[str, list[float]],
    level: tuple[str, float],
    unit: str = "",
    marked: float | None = None,
) -> Plot:
    """Draw series of values by step, and a named level."""
    steps = len(next(iter(series.values())))
    x = step_axis(range(shown.first_step, shown.first_step + steps), centred=False)
    curves = [
        Curve(label, tuple(enumerate(values, shown.first_step))) for label, values in series.items()
    ]
    curves.append(Curve(level[0], ((x.low, level[1]), (x.high, level[1]))))
    y = value_axis([value for curve in curves for _, value in curve.points], unit)
    return Plot(title, f"{shown.axis} step", x, y, tuple(curves), marked)


def _around(shown: NeuronPotential, side: str, at: int | None) -> Table:
    centre = len(shown.reference) // 2 if at is None else at
    kept = range(max(0, centre - _BESIDE), min(len(shown.reference), centre + _BESIDE + 1))
    texts = told_apart(
        [float(v) for i in kept for v in (shown.reference[i], shown.chip[i], shown.threshold)]
    )
    rows = []
    for n, i in enumerate(kept):
        fired = [
            name
            for name, at_step in ((side, shown.reference_spikes), ("chip", shown.chip_spikes))
            if at_step[i]
        ]
        both = texts[3 * n], texts[3 * n + 1]
        rows.append((str(shown.first_step + i), *both, " and ".join(fired) or NONE))
    return Table(
        f"{shown.population}, neuron {shown.neuron}, threshold {shown.threshold:.6g}",
        ("step", f"{side} potential", "chip potential", "spike of"),
        tuple(rows),
    )
