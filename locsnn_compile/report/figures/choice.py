"""What report.json says of the settings that were compared."""

from __future__ import annotations

from dataclasses import asdict
from typing import TYPE_CHECKING, Any

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
        "kept": choice.keeps_budget,
        "taken": choice.taken.strategy,
        "taken_weight_bits": choice.taken.setting.weight_bits,
        "taken_split_weights": choice.taken.setting.split_weights,
        "candidates": [
            {
                **asdict(candidate.setting),
                "prediction_agreement": candidate.prediction_agreement,
                "spike_error": candidate.spike_error,
                "energy_pj": candidate.energy_pj,
                "within_budget": candidate.keeps(choice.budget),
            }
            for candidate in choice.candidates
        ],
    }
