"""The bounds that ``auto`` keeps where none is given, on the recordings of an exploration."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from locsnn_compile.errors import TargetError
from locsnn_compile.explore.executors import Executor
from locsnn_compile.explore.point import Figures, Point
from locsnn_compile.explore.store import Store
from locsnn_compile.explore.study import Study
from locsnn_compile.explore.sweep import sweep
from locsnn_compile.passes.quantize import weight_bits_of
from locsnn_compile.settings import Setting, usual_settings
from locsnn_compile.verification.error_bounds import ErrorBudget, default_budget


def auto_bounds(study: Study, points: Sequence[Point], store: Store, executor: Executor) -> ErrorBudget:
    """Return what ``auto`` may lose: by its first strategy that the chip holds, measured here if not on the grid."""
    known = {point.setting: point.figures for point in points}
    for setting in usual_settings(study.network, weight_bits_of(study.chip, None)):
        figures = known[setting] if setting in known else _measured(study, setting, store, executor)
        if figures:
            return default_budget(figures)
    # The chip holds this network with fewer bits than its most only.
    return default_budget(min((f for f in known.values() if f), key=lambda figures: figures.spike_error or 0.0))


def _measured(study: Study, setting: Setting, store: Store, executor: Executor) -> Figures | None:
    try:
        return sweep(replace(study, engines=()), [setting], store, executor)[0].figures
    except TargetError:
        return None
