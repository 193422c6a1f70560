"""The rows as plain numbers and texts, for scripts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

import hw_model as hw
from locsnn_compile.stress.row import Drift, Measured, Row, by_verdict
from locsnn_compile.verification.matching import PopulationMatch

SCHEMA = 1


def stress_document(rows: Sequence[Row], chip: hw.Chip) -> dict[str, Any]:
    """Return what ``locsnn stress --json`` prints; errors and bounds are in thresholds."""
    return {
        "schema": SCHEMA,
        "target": chip.name,
        "verdicts": by_verdict(rows),
        "rows": [_row(row) for row in rows],
    }


def _row(row: Row) -> dict[str, Any]:
    case = row.case
    return {
        "group": case.group,
        "case": case.name,
        "strategy": case.strategy,
        "weight_bits": case.weight_bits,
        "verdict": row.verdict,
        "causes": list(row.causes),
        "measured": None if row.measured is None else _measured(row.measured),
        "long_run": None if row.drift is None else _drift(row.drift),
    }


def _measured(m: Measured) -> dict[str, Any]:
    return {
        **_spikes(m.spikes),
        "error_thresholds": m.error,
        "bound_thresholds": m.bound,
        "bound_parts_thresholds": dict(m.parts),
        "model_error_thresholds": m.model_error,
        "decisions": m.decisions,
        "decisions_otherwise": m.otherwise,
        "of_these_ties": m.ties,
        "wraps": m.wraps,
        "clips": m.clips,
        "weights": asdict(m.weights),
        "biases": asdict(m.biases),
    }


def _drift(drift: Drift) -> dict[str, Any]:
    return {
        "steps": drift.steps,
        "by_tenth": [_spikes(match) for match in drift.spikes],
        "error_thresholds_by_tenth": None if drift.error is None else list(drift.error),
        "bound_thresholds": drift.bound,
    }


def _spikes(match: PopulationMatch) -> dict[str, Any]:
    return {
        "reference_spikes": match.reference_spikes,
        "chip_spikes": match.chip_spikes,
        "spike_agreement": match.agreement,
    }
