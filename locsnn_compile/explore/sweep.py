"""Measure every setting of a grid once, whatever interrupts it: finished points come from the store.

And the bounds that ``auto`` keeps where none is given, on the same recordings.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import replace

from locsnn_compile.cluster.code import check_code
from locsnn_compile.errors import InputError, TargetError
from locsnn_compile.explore.executors import Executor
from locsnn_compile.explore.point import Figures, Point
from locsnn_compile.explore.store import Store
from locsnn_compile.explore.study import Study
from locsnn_compile.passes.quantize import weight_bits_of
from locsnn_compile.settings import Setting, usual_settings
from locsnn_compile.verification.error_bounds import ErrorBudget, default_budget

Progress = Callable[[int, int], None]
"""Called with (settings done, settings in all)."""


def sweep(
    study: Study, settings: Sequence[Setting], store: Store, executor: Executor, progress: Progress | None = None
) -> tuple[Point, ...]:
    """Return a point for every setting, in their order; each is stored as soon as it is measured.

    A setting that the chip cannot hold is a point too, but where that is all of them the error of the first one is
    raised, and an ``InputError``, which all settings share, at once. Points of other code are refused.
    """
    keys = {setting: study.key(setting) for setting in settings}
    points = {setting: point for setting, key in keys.items() if (point := store.read(key, setting))}
    missing = [setting for setting in keys if setting not in points]
    if progress:
        progress(len(points), len(keys))
    if missing:
        # Whatever ends this, processes and connections end with it.
        with closing(executor(study, missing)) as measured:
            for point in measured:
                check_code(f"setting {point.setting}", point.code)
                if point.refusal and point.refusal.kind == InputError.__name__:
                    raise point.refusal.error()
                store.write(keys[point.setting], point)
                points[point.setting] = point
                if progress:
                    progress(len(points), len(keys))
    done = tuple(points[setting] for setting in keys)
    if done and done[0].refusal and not any(point.figures for point in done):
        raise done[0].refusal.error()
    return done


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
