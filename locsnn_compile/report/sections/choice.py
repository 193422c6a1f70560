"""The table of the settings that were compared, and what to say where none keeps a budget."""

from __future__ import annotations

from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from locsnn_compile.report.content import Document, Table, of, table
from locsnn_compile.report.format import agreed, any_value, energy, plural, share

if TYPE_CHECKING:
    from locsnn_compile.choose_strategy import Candidate, Choice


def settings_compared(choice: Document) -> Table:
    """Return a table of the settings that were compared."""
    taken = {**choice, "strategy": choice["taken"]}
    return table(
        f"Settings compared on {plural(choice['calibration_samples'], 'recording')} of "
        f"{choice['calibration_source']}; taken: {setting_words(taken, 'taken_')}, {_reason(choice)}",
        choice["candidates"],
        ("setting", setting_words),
        ("same prediction", of("prediction_agreement", lambda share: agreed(share, "all tie"))),
        ("spikes that differ", of("spike_error", agreed)),
        ("energy", of("energy_pj", energy)),
        ("within the error budget", of("within_budget", any_value)),
    )


def unmet_budget(choice: Choice) -> str:
    """Say in a line what a budget that no setting keeps came to, and a way out."""
    best, bounds = choice.taken, choice.budget
    silent = best.spike_agreement is None or (bounds.min_agreement is not None and best.prediction_agreement is None)
    fix = (
        "Give --calibration recordings in which outputs spike."
        if silent
        else "Train for the chip with locsnn train --target, or allow more."
    )
    setting = setting_words(asdict(best.setting))
    return (
        f"no setting keeps {bounds.words()} on {plural(choice.samples, 'recording')} of {choice.source}: "
        f"the best of {len(choice.candidates)} is {setting}, with {_lost(best)}. {fix}"
    )


def _lost(candidate: Candidate) -> str:
    agreement, error = candidate.prediction_agreement, candidate.spike_error
    predictions = "no prediction compared" if agreement is None else f"prediction agreement {agreement:.4f}"
    return f"{predictions} and {'no spike compared' if error is None else f'{error:.4f} of the spikes different'}"


def setting_words(row: dict[str, Any], prefix: str = "") -> str:
    """Name a setting."""
    part = row[f"{prefix}split_weights"]
    split = f", {'all' if part == 1 else share(part) + ' of'} weights split" if part else ""
    return f"{row['strategy']}, {row[f'{prefix}weight_bits']} bits{split}"


def _reason(choice: dict[str, Any]) -> str:
    if choice["min_agreement"] is choice["max_spike_error"] is None:
        return "the most exact one, as nothing was compared"
    if choice["kept"]:
        return "the cheapest within the error budget"
    return "the most accurate, as none is within the error budget"
