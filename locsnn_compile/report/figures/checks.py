"""Entries of report.json on the checks beyond the match: error budget, margins, predictions over time, settings."""

from dataclasses import asdict
from typing import Any

import numpy as np

from hw_model.program.chip_program import ChipProgram
from hw_model.values import picked
from locsnn_compile.report.content import Document
from locsnn_compile.request.choose_strategy import Choice
from locsnn_compile.verification.diagnosis import EDGES, Diagnosis, PopulationMargins
from locsnn_compile.verification.error_budget.budget import Cause, Deviation
from locsnn_compile.verification.matching import PopulationMatch
from locsnn_compile.verification.over_time import OverTime, savings

_REGISTERS = ("peak_u", "share_u", "peak_v", "share_v", "headroom_bits", "wraps", "clips")
_POINTS = 50
"""Steps of a recording for which figures are kept, evenly spread up to the last one."""
_ORDER = ("together", "time", "location", "time_weighted")


def budget_entry(diagnosis: Diagnosis) -> Document | None:
    """Return ``error_budget``; None if nothing was rounded."""
    budget = diagnosis.budget
    if budget is None:
        return None
    return {
        **_recordings(diagnosis),
        "alone": {stage: _deviation(found) for stage, found in budget.alone.items()},
        "all_but": {stage: _deviation(found) for stage, found in budget.without.items()},
        "together": _deviation(budget.together),
        "unexplained_spikes": budget.unexplained,
        "kernel_tail": None if budget.kernel_tail is None else _deviation(budget.kernel_tail),
    }


def cause_entry(cause: Cause | None) -> Document | None:
    """Return ``match.first_divergence.cause``: what each stage adds to the potential that decided."""
    if cause is None:
        return None
    return {
        "moved_by": dict(cause.moved),
        "moved_by_interaction": cause.rest,
        "moved_together": cause.together,
        "largest": cause.largest,
        "enough_alone": list(cause.enough),
    }


def margins_entry(diagnosis: Diagnosis) -> Document:
    """Return ``margins``; distances and errors are in thresholds."""
    found = diagnosis.margins
    return {
        **_recordings(diagnosis),
        "histogram_edges": [float(f"{edge:.6g}") for edge in EDGES],
        "by_population": {name: _population(one) for name, one in found.populations.items()},
        "registers": {name: picked(one, *_REGISTERS) for name, one in found.registers.items()},
    }


def _recordings(diagnosis: Diagnosis) -> Document:
    return {"recordings": list(diagnosis.recordings), "recordings_available": diagnosis.available}


def _deviation(found: Deviation) -> Document:
    return {
        **spikes_entry(found.spikes),
        "predictions_changed": found.predictions_changed,
        "score_error": found.scores.relative_error,
        "by_population": {name: spikes_entry(one) for name, one in found.by_population.items()},
    }


def spikes_entry(found: PopulationMatch) -> Document:
    """Return how equal the spikes of both sides are."""
    return {"spike_agreement": found.agreement, "spike_mismatches": found.mismatches}


def _population(found: PopulationMargins) -> Document:
    return {
        "neuron_steps": found.neuron_steps,
        "nearest": {f"{share:g}": distance for share, distance in found.nearest.items()},
        "error": {f"{share:g}": error for share, error in found.error.items()},
        **picked(found, "within_error", "decided_otherwise"),
        "distance_histogram": found.distance_histogram.tolist(),
        "error_histogram": found.error_histogram.tolist(),
    }


def over_time_entry(
    found: OverTime | str, program: ChipProgram, step_seconds: float | None
) -> dict[str, Any]:
    """Return ``over_time``; if predictions were not followed, only the reason."""
    if isinstance(found, str):
        return {"left_out": found}
    steps = len(next(iter(found.right.values())))
    kept = np.unique(np.ceil(np.arange(1, _POINTS + 1) * steps / _POINTS).astype(np.int64))
    return {
        "recordings": list(found.recordings),
        "recordings_available": found.available,
        "right_is": "the label" if found.labelled else "the prediction after the last step",
        "psi": found.psi,
        "step_seconds": step_seconds,
        "steps": kept.tolist(),
        "right": {
            name: found.right[name][kept - 1].tolist() for name in _ORDER if name in found.right
        },
        "proven_stop": savings(program, found.proven),
    }


def choice_document(choice: Choice | None) -> dict[str, Any] | None:
    """Return ``strategy_choice``; None if nothing was chosen."""
    if choice is None:
        return None
    return {
        "calibration_source": choice.source,
        "calibration_samples": choice.samples,
        **asdict(choice.budget),
        "kept": choice.keeps_budget,
        **{dial.taken_key: value for dial, value in choice.taken.setting.by_dial},
        "candidates": [
            {
                **asdict(candidate.setting),
                **picked(
                    candidate,
                    "prediction_agreement",
                    "spike_error",
                    "score_error",
                    "energy_pj",
                    "chip_time_ns",
                ),
                "within_budget": candidate.keeps(choice.budget),
            }
            for candidate in choice.candidates
        ],
    }
