"""Run all cases, one row after the other."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from functools import partial
from itertools import groupby

import numpy as np

import hw_model as hw
from locsnn_compile.errors import LocsnnError
from locsnn_compile.stress.cases import cases
from locsnn_compile.stress.cases.case import Case
from locsnn_compile.stress.cases.long_runs import BLOCK, long_runs
from locsnn_compile.stress.drift import long_row, play_float
from locsnn_compile.stress.measure import Float, measure
from locsnn_compile.stress.row import Row, judge

LONG_STEPS, QUICK_STEPS = 1_000_000, 10 * BLOCK
"""Steps of a long run, and of one of a quick run."""

Progress = Callable[[int, int], None]


def run_stress(chip: hw.Chip, *, quick: bool = False, progress: Progress | None = None) -> tuple[Row, ...]:
    """Return a row for each case; ``progress`` is called with (rows done, rows in all)."""
    table = cases(quick=quick)
    long = [run for run in long_runs() if run.case.quick or not quick]
    rows: list[Row] = []

    def done(row: Row) -> None:
        rows.append(row)
        if progress:
            progress(len(rows), len(table) + len(long))

    for case in table:
        done(run_case(case, chip))
    for network, runs in groupby(long, key=lambda run: run.case.network):
        float_run: Float | None = None
        for run in runs:
            float_run = float_run or play_float(network, run.block, QUICK_STEPS if quick else LONG_STEPS)
            done(_row(run.case, partial(long_row, run, chip, float_run)))
    return tuple(rows)


def run_case(case: Case, chip: hw.Chip) -> Row:
    """Return the row of a case, whatever happens."""
    return _row(case, lambda: judge(case, measure(case, chip)))


def _row(case: Case, make: Callable[[], Row]) -> Row:
    """Make a row, or one of the error that this ends in.

    Warnings of numpy count as crashes: an infinity that nobody meant to compute is nonsense in the making.
    """
    with warnings.catch_warnings(), np.errstate(over="raise", divide="raise", invalid="raise"):
        warnings.simplefilter("error", RuntimeWarning)
        try:
            return make()
        except LocsnnError as error:
            if not error.fix.strip():
                return Row(case, "unexplained", (f"refused without a way out: {error}",))
            return Row(case, "refused", (str(error),))
        except Exception as error:
            return Row(case, "unexplained", (f"crash: {type(error).__name__}: {error}",))
