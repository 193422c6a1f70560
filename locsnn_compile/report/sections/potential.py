"""The section that shows the potential which differs first, in the float network and on the chip."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from locsnn_compile.report.content import Curve, Document, Plot, Section, Table, section
from locsnn_compile.report.format import NONE, told_apart
from locsnn_compile.report.pictures.ticks import step_ticks, value_axis

if TYPE_CHECKING:
    from locsnn_compile.verification.excerpt import Excerpt, NeuronPotential

_BESIDE = 3
"""Steps before and after the one in the middle that the table has."""


def potential(document: Document, excerpt: Excerpt | None) -> Section | None:
    """Potentials of both sides with the threshold, and what they differ by; None where nothing was kept to show."""
    if excerpt is None:
        return None
    side = "network" if document["match"]["reference"] == "integers" else "float"
    shown, first = excerpt.potential, excerpt.first
    where = f"{shown.population}, neuron {shown.neuron}, recording {excerpt.recording}"
    lead = f"{where}: the potential that the threshold sees, before any reset. " + (
        "Its first spike that differs is marked."
        if first
        else "No spike differs; this neuron of the readout is an example."
    )
    at = None if first is None else first.step - shown.first_step
    title = "Potential around the first difference" if first else "Potential of a neuron"
    blocks = (make(shown, side, at) for make in (_potentials, _difference, _table))
    return section("potential", title, lead, *blocks)


def _potentials(shown: NeuronPotential, side: str, at: int | None) -> Plot:
    both = {f"{side} potential": shown.reference.tolist(), "chip potential": shown.chip.tolist()}
    title, level = f"{shown.population}, neuron {shown.neuron}: potential", shown.threshold
    marked = None if at is None else at / max(1, len(shown.reference) - 1)
    return _plot(title, shown, both, (f"threshold, {level:.6g}", level), marked=marked)


def _difference(shown: NeuronPotential, side: str, at: int | None) -> Plot:
    """Draw how far the chip is off, as long as all spikes are equal: what follows comes from the spike that differs."""
    until = None if at is None else at + 1
    off = 100.0 * (shown.chip - shown.reference)[:until] / (abs(shown.threshold) or 1.0)
    title = "Error of the chip's potential, in percent of the threshold"
    title += "" if at is None else ", until it counts"
    return _plot(title, shown, {f"chip less {side}": off.tolist()}, ("no error", 0.0), " %")


def _plot(
    title: str,
    shown: NeuronPotential,
    series: dict[str, list[float]],
    level: tuple[str, float],
    unit: str = "",
    marked: float | None = None,
) -> Plot:
    """Draw values by step, all from the first step on, with a level and its name."""
    low, high, ticks = value_axis([value for values in series.values() for value in values] + [level[1]])
    steps = len(next(iter(series.values())))

    def curve(label: str, values: Sequence[float]) -> Curve:
        last = max(1, len(values) - 1)
        return Curve(label, tuple((i / last, (value - low) / (high - low)) for i, value in enumerate(values)))

    return Plot(
        title=title,
        x_label=f"{shown.axis} step",
        x_ticks=step_ticks(range(shown.first_step, shown.first_step + steps), centred=False),
        y_ticks=tuple(((value - low) / (high - low), f"{value:.6g}{unit}") for value in ticks),
        curves=(*(curve(*one) for one in series.items()), curve(level[0], [level[1]] * 2)),
        marked=marked,
    )


def _table(shown: NeuronPotential, side: str, at: int | None) -> Table:
    centre = len(shown.reference) // 2 if at is None else at
    kept = range(max(0, centre - _BESIDE), min(len(shown.reference), centre + _BESIDE + 1))
    texts = told_apart([float(v) for i in kept for v in (shown.reference[i], shown.chip[i], shown.threshold)])
    rows = []
    for n, i in enumerate(kept):
        fired = [name for name, at_step in ((side, shown.reference_spikes), ("chip", shown.chip_spikes)) if at_step[i]]
        rows.append((str(shown.first_step + i), texts[3 * n], texts[3 * n + 1], " and ".join(fired) or NONE))
    return Table(
        f"{shown.population}, neuron {shown.neuron}, threshold {shown.threshold:.6g}",
        ("step", f"{side} potential", "chip potential", "spike of"),
        tuple(rows),
    )
