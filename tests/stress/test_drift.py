"""Long runs, in which rounding may add up.

Errors that fade do not grow, those that do not fade grow as derived, and a session, which is given
the run piece by piece, counts the same spikes as a simulation of the whole.
"""

from dataclasses import replace

import numpy as np
import pytest

import hw_model as hw
from locsnn_compile.reference.evaluate import evaluate
from locsnn_compile.report.format import short
from locsnn_compile.stress import run as drift_module
from locsnn_compile.stress.cases.case import long_runs
from locsnn_compile.stress.run import long_row, measure_drift, play_float
from locsnn_compile.verification.matching import PopulationMatch

CHIP = hw.chip("loihi-sim")
RUNS = {(run.case.name, run.case.strategy): run for run in long_runs()}
"""The long runs by name and strategy. Each plays a block of 1,000 steps again and again, up to a million steps; tests play
fewer."""


def test_the_float_run_is_the_reference():
    run = RUNS["tau_sr 10", "dendrite"]
    steps = 2 * len(run.block)
    float_run = play_float(run.case.network, run.block, steps)
    # The recording of this case is its block, twice.
    reference = evaluate(run.case.network, run.case.recordings, potentials=True)
    assert np.array_equal(float_run.spikes, reference.spikes["n"][0])
    assert float_run.potential == pytest.approx(reference.potential["n"][0], rel=1e-9, abs=1e-9)


def test_balanced_weights_drift_as_fast_as_their_rounding():
    run = RUNS["no leak, balanced input", "native"]
    float_run = play_float(run.case.network, run.block, 10_000)
    drift, session_differs = measure_drift(run, CHIP, float_run)
    assert session_differs is None
    # Errors are given by tenth of the run.
    in_proportion = [tenths * drift.error[0] for tenths in range(1, 11)]
    assert drift.error == pytest.approx(in_proportion, rel=0.1)
    # Nothing is truncated in this case, so the bound is nearly reached.
    assert 0.9 * drift.bound <= drift.error[-1] <= drift.bound


@pytest.mark.slow
def test_what_fades_does_not_grow():
    run = RUNS["leak of 10 steps", "native"]
    row = long_row(run, CHIP, play_float(run.case.network, run.block, 10_000))
    assert row.verdict == "ok"
    # The network settles in the first tenth; after it every tenth has the same error.
    assert len(set(row.drift.error[1:])) == 1
    assert row.drift.error[-1] <= row.drift.bound < 0.1


@pytest.mark.slow
def test_growth_is_told_where_nothing_fades_and_where_spikes_drift_apart():
    run = RUNS["leak of 10 steps", "native"]
    row = long_row(run, CHIP, play_float(run.case.network, run.block, 1_000))
    # The last error is above a tenth of a threshold, from which on a cause is named. It is one only where nothing fades.
    grown = replace(row.drift, steps=1_000_000, error=(0.05, 0.6))
    assert not [*drift_module.growth(row, grown, fades=True)]
    assert [*drift_module.growth(row, grown, fades=False)] == [
        "nothing fades, so rounding adds up: 0.60 thresholds in 1,000,000 steps"
    ]
    # Of 10 spikes on either side, 2 are equal in the last tenth. The 97.8 % are those of the run itself.
    apart = replace(
        row.drift, spikes=(PopulationMatch(reference_spikes=10, chip_spikes=10, common_spikes=2),)
    )
    assert [*drift_module.growth(row, apart, fades=True)] == [
        "spikes drift apart: 97.8 % are equal in the beginning, 20.0 % in the last tenth"
    ]


def test_a_session_that_counts_otherwise_is_unexplained(monkeypatch):
    run = RUNS["leak of 10 steps", "native"]
    difference = "a session counts other spikes until step 1000"
    monkeypatch.setattr(drift_module, "session_difference", lambda *_: difference)
    row = long_row(run, CHIP, play_float(run.case.network, run.block, 1_000))
    assert row.verdict == "unexplained"
    assert row.causes == (difference,)


def test_an_error_beyond_its_bound_is_unexplained(monkeypatch):
    run = RUNS["leak of 10 steps", "native"]
    # Far below any error of the run.
    monkeypatch.setattr(drift_module, "drift_bound", lambda *_: 1e-5)
    row = long_row(run, CHIP, play_float(run.case.network, run.block, 1_000))
    assert row.verdict == "unexplained"
    largest = short(max(row.drift.error))
    assert row.causes == (
        f"an error of {largest} thresholds in the long run is beyond the bound of 0.000010",
    )
