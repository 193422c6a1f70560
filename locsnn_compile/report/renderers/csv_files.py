"""``--emit csv``: write the figures and pictures of a report as tables for a spreadsheet or a script.

The pictures are those of the excerpt, a part of one recording: spikes around the first difference, and the potential
of one neuron.
"""

from collections.abc import Iterable
from typing import TYPE_CHECKING

from locsnn_compile.report.content import Document
from locsnn_compile.report.figures.flat import flatten, table_bytes
from locsnn_compile.report.words import UNITS

if TYPE_CHECKING:
    from locsnn_compile.verification.excerpt import Excerpt, SpikeRows

Cell = str | int | float | None


def csv_files(document: Document, excerpt: "Excerpt | None") -> dict[str, bytes]:
    """Return ``csv/figures.csv`` and, with an excerpt, ``csv/spikes.csv`` and ``csv/potential.csv``."""
    figures = []
    for section, entry in document.items():
        for name, value in flatten(entry).items():
            figures.append((section, name, _unit(f"{section}.{name}"), value))
    files = {"csv/figures.csv": table_bytes(("section", "name", "unit", "value"), figures)}
    if excerpt is not None:
        files["csv/spikes.csv"] = table_bytes(
            ("axis", "source", "step", "row", "reference", "chip"), _spikes(excerpt)
        )
        files["csv/potential.csv"] = table_bytes(
            (
                "population",
                "neuron",
                "step",
                "reference",
                "chip",
                "threshold",
                "reference_spike",
                "chip_spike",
            ),
            _potential(excerpt),
        )
    return files


def _unit(key: str) -> str:
    """Return the unit of a figure, from the last words of the parts of its key; nothing without a unit.

    The innermost part that names a unit counts: ``energy.breakdown_pj.spikes`` is in pJ.
    """
    last_words = [part.rsplit("_", 1)[-1] for part in reversed(key.split("."))]
    return next((UNITS[word] for word in last_words if word in UNITS), "")


def _spikes(excerpt: "Excerpt") -> Iterable[tuple[Cell, ...]]:
    """Yield a row per spike. Inputs spike on both sides; lines that share a row have the number of the first."""
    for phase, steps in excerpt.steps.items():
        for rows in (*excerpt.inputs, *excerpt.populations):
            if rows.phase == phase:
                yield from _spikes_of(rows, steps)


def _spikes_of(rows: "SpikeRows", steps: range) -> Iterable[tuple[Cell, ...]]:
    """Yield a row per spike of an input or a population; ``steps`` are the numbers of the steps shown."""
    for step, row in zip(*rows.either.nonzero(), strict=True):
        yield (
            rows.axis,
            rows.name,
            steps[int(step)],
            int(rows.numbers[row]),
            int(rows.reference[step, row]),
            int(rows.chip[step, row]),
        )


def _potential(excerpt: "Excerpt") -> Iterable[tuple[Cell, ...]]:
    """Yield a row per step of the neuron whose potential is shown."""
    neuron = excerpt.potential
    potentials = zip(neuron.reference.tolist(), neuron.chip.tolist(), strict=True)
    for i, (reference, chip) in enumerate(potentials):
        yield (
            neuron.population,
            neuron.neuron,
            neuron.first_step + i,
            reference,
            chip,
            neuron.threshold,
            int(neuron.reference_spikes[i]),
            int(neuron.chip_spikes[i]),
        )
