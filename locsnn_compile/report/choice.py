"""What strategy ``auto`` compared: its part of report.json, and how that is shown."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from locsnn_compile.report.content import Block, Document, Table
from locsnn_compile.report.format import count, energy, share

if TYPE_CHECKING:
    from locsnn_compile.choose_strategy import Choice


def choice_document(choice: Choice | None) -> dict[str, Any] | None:
    """Return the candidates as plain values; None where nothing was chosen."""
    if choice is None:
        return None
    return {
        "calibration_source": choice.source,
        "calibration_samples": choice.samples,
        "min_agreement": choice.budget.min_agreement,
        "max_spike_error": choice.budget.max_spike_error,
        "taken": choice.taken.strategy,
        "candidates": [
            {
                "strategy": candidate.strategy,
                "prediction_agreement": candidate.prediction_agreement,
                "spike_error": candidate.spike_error,
                "energy_pj": candidate.energy_pj,
                "within_budget": candidate.keeps(choice.budget),
            }
            for candidate in choice.candidates
        ],
    }


def choice_blocks(document: Document) -> tuple[Block, ...]:
    """Return a table of the strategies that were compared; nothing where none were."""
    choice = document.get("strategy_choice")
    if choice is None:
        return ()
    return (
        Table(
            f"Strategies compared on {count(choice['calibration_samples'])} recordings of "
            f"{choice['calibration_source']}; taken: {choice['taken']}, {_reason(choice)}",
            ("strategy", "same prediction", "spikes that differ", "energy", "within the error budget"),
            tuple(
                (
                    row["strategy"],
                    share(row["prediction_agreement"]),
                    share(row["spike_error"]),
                    energy(row["energy_pj"]),
                    "yes" if row["within_budget"] else "no",
                )
                for row in choice["candidates"]
            ),
        ),
    )


def _reason(choice: dict[str, Any]) -> str:
    within = any(row["within_budget"] for row in choice["candidates"])
    return "the cheapest within the error budget" if within else "the most accurate, as none is within the error budget"
