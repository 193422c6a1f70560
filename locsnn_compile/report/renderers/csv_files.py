"""``--emit csv``: the figures and pictures of a report as tables for a spreadsheet or a script."""

from collections.abc import Iterable
from typing import TYPE_CHECKING

from locsnn_compile.report.content import Document
from locsnn_compile.report.figures.flat import flatten, table_bytes
from locsnn_compile.report.words import UNITS

if TYPE_CHECKING:
    from locsnn_compile.verification.excerpt import Excerpt

Cell = str | int | float | None


def csv_files(document: Document, excerpt: "Excerpt | None") -> dict[str, bytes]:
    """Return ``csv/figures.csv`` and, with an excerpt, ``csv/spikes.csv`` and ``csv/potential.csv``."""
    figures = (
        (section, name, _unit(f"{section}.{name}"), value)
        for section, part in document.items()
        for name, value in flatten(part).items()
    )
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
    """Return the unit that the innermost word of a key names: pJ for ``energy.breakdown_pj.spikes``."""
    words = [part.rsplit("_", 1)[-1] for part in reversed(key.split("."))]
    return next((UNITS[word] for word in words if word in UNITS), "")


def _spikes(excerpt: "Excerpt") -> Iterable[tuple[Cell, ...]]:
    """Yield a row per spike. Inputs spike on both sides; lines that share a row have the number of the first."""
    for phase, steps in excerpt.steps.items():
        for item in (*excerpt.inputs, *excerpt.populations):
            if item.phase == phase:
                for step, row in zip(*item.either.nonzero(), strict=True):
                    sides = int(item.reference[step, row]), int(item.chip[step, row])
                    yield item.axis, item.name, steps[int(step)], int(item.numbers[row]), *sides


def _potential(excerpt: "Excerpt") -> Iterable[tuple[Cell, ...]]:
    shown = excerpt.potential
    for i, (reference, chip) in enumerate(
        zip(shown.reference.tolist(), shown.chip.tolist(), strict=True)
    ):
        fired = int(shown.reference_spikes[i]), int(shown.chip_spikes[i])
        yield (
            shown.population,
            shown.neuron,
            shown.first_step + i,
            reference,
            chip,
            shown.threshold,
            *fired,
        )
