"""The section that shows the potential which differs first, in the float network and on the chip."""

from __future__ import annotations

from typing import TYPE_CHECKING

from locsnn_compile.report.content import Block, Curve, Document, Plot, Section, Table
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
    blocks: tuple[Block, ...] = (_potentials(shown, side, at), _difference(shown, side, at), _table(shown, side, at))
    title = "Potential around the first difference" if first else "Potential of a neuron"
    return Section("potential", title, lead, blocks)


def _potentials(shown: NeuronPotential, side: str, at: int | None) -> Plot:
    reference, chip = shown.reference.tolist(), shown.chip.tolist()
    low, high, ticks = value_axis([*reference, *chip, shown.threshold])
    level = (shown.threshold - low) / (high - low)
    return Plot(
        title=f"{shown.population}, neuron {shown.neuron}: potential",
        x_label=f"{shown.axis} step",
        x_ticks=step_ticks(_steps(shown), centred=False),
        y_ticks=tuple(((value - low) / (high - low), f"{value:.6g}") for value in ticks),
        curves=(
            Curve(f"{side} potential", _points(reference, low, high)),
            Curve("chip potential", _points(chip, low, high)),
            Curve(f"threshold, {shown.threshold:.6g}", ((0.0, level), (1.0, level))),
        ),
        marked=_place(shown, at),
    )


def _difference(shown: NeuronPotential, side: str, at: int | None) -> Plot:
    """Draw how far the chip is off, as long as all spikes are equal: what follows comes from the spike that differs."""
    steps = _steps(shown) if at is None else _steps(shown)[: at + 1]
    unit = abs(shown.threshold) or 1.0
    both = zip(shown.reference.tolist(), shown.chip.tolist(), strict=True)
    differences = [100.0 * (chip - reference) / unit for reference, chip in both][: len(steps)]
    low, high, ticks = value_axis([*differences, 0.0])
    level = -low / (high - low)
    return Plot(
        title="Error of the chip's potential, in percent of the threshold"
        + ("" if at is None else ", until it counts"),
        x_label=f"{shown.axis} step",
        x_ticks=step_ticks(steps, centred=False),
        y_ticks=tuple(((value - low) / (high - low), f"{value:.6g} %") for value in ticks),
        curves=(
            Curve(f"chip less {side}", _points(differences, low, high)),
            Curve("no error", ((0.0, level), (1.0, level))),
        ),
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


def _steps(shown: NeuronPotential) -> range:
    return range(shown.first_step, shown.first_step + len(shown.reference))


def _place(shown: NeuronPotential, at: int | None) -> float | None:
    return None if at is None else at / max(1, len(shown.reference) - 1)


def _points(values: list[float], low: float, high: float) -> tuple[tuple[float, float], ...]:
    last = max(1, len(values) - 1)
    return tuple((i / last, (value - low) / (high - low)) for i, value in enumerate(values))
