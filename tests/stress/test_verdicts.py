"""The verdict on what was measured of a case, and the sentences on its causes: one cause at a time."""

from dataclasses import replace

import numpy as np
import pytest

import hw_model as hw
from locsnn_compile.stress import run
from locsnn_compile.stress.cases.case import (
    Case,
    lif,
    network_of,
    random_input,
    random_weights,
    srm,
)
from locsnn_compile.stress.row import Lost, Measured, judge
from locsnn_compile.verification.matching import PopulationMatch

CHIP = hw.chip("loihi-sim")
CASE = Case("case", "reset", network_of(srm(), random_weights()), random_input())
# Figures of a case that is ok: every row of the table below changes some of them.
FINE = Measured(
    spikes=PopulationMatch(reference_spikes=10, chip_spikes=10, common_spikes=9), error_thresholds=0.05, bound_thresholds=0.2,
    bound_parts_thresholds={"weights": 0.15, "decays": 0.04, "states": 0.01}, model_error_thresholds=0.0, decisions=100,
    decisions_otherwise=1, of_these_ties=0, wraps=0, clips=0, weights=Lost(lost=0, of=24), biases=Lost(lost=0, of=4), overflowed=0, outside=0,
    coarse_decays=(), odd_engine=None,
)  # fmt: skip
# Each row: its id, what differs from FINE, the verdict, and the causes.
CAUSES = [
    ("fine", {}, "ok", ()),
    ("wraps", {"wraps": 2, "overflowed": 3, "error_thresholds": 9.0}, "limited", ("2 wraps: a charge or current leaves its register",)),
    ("clips", {"clips": 1, "overflowed": 3, "error_thresholds": 9.0}, "limited", ("1 clip: the potential leaves its register",)),
    ("only if forced", {"overflowed": 3}, "limited", ("3 potentials would leave the register with the float network's spikes",)),
    ("weights", {"weights": Lost(lost=3, of=24)}, "limited", ("3 of 24 weights round to 0",)),
    ("the weight", {"weights": Lost(lost=1, of=1)}, "limited", ("the only weight rounds to 0",)),
    ("biases", {"biases": Lost(lost=2, of=4)}, "limited", ("2 of 4 biases round to 0",)),
    ("the bias", {"biases": Lost(lost=1, of=1)}, "limited", ("the only bias rounds to 0",)),
    ("decay", {"coarse_decays": ("a decay of 4.094 in 4096 is 4: it fades 2.3 % slower",)}, "limited", ("a decay of 4.094 in 4096 is 4: it fades 2.3 % slower",)),
    ("model", {"model_error_thresholds": 2.0, "error_thresholds": 2.1}, "limited", ("its reset is another neuron model: 2.0 thresholds at most",)),
    ("rounding", {"error_thresholds": 0.11}, "limited", ("rounding: 0.11 thresholds found, at most 0.15 by weights and 0.040 by decays",)),
    ("ties", {"of_these_ties": 1}, "limited", ("1 potential exactly at the threshold: the least rounding decides",)),
    ("two", {"clips": 1, "weights": Lost(lost=3, of=24)}, "limited", ("1 clip: the potential leaves its register", "3 of 24 weights round to 0")),
    ("engine", {"odd_engine": "the reference engine", "clips": 1}, "unexplained", ("the reference engine differs from the fast engine",)),
    ("outside", {"outside": 4}, "unexplained", ("4 potentials lie beyond the bound of 0.20 thresholds",)),
]  # fmt: skip


@pytest.mark.parametrize(
    ("changes", "verdict", "causes"), [row[1:] for row in CAUSES], ids=[row[0] for row in CAUSES]
)
def test_causes(changes, verdict, causes):
    row = judge(CASE, replace(FINE, **changes))
    assert (row.verdict, row.causes) == (verdict, causes)


def test_a_refusal_is_a_row():
    row = run.run_case(replace(CASE, network=network_of(lif(), np.full((4, 6), np.inf))), CHIP)
    assert row.verdict == "refused"
    assert row.causes == (
        "projection 'touch' -> 'n': a weight is not a finite number. Train again, with a lower learning rate.",
    )


@pytest.mark.parametrize(
    ("error", "cause"),
    [
        (
            ZeroDivisionError("float division by zero"),
            "crash: ZeroDivisionError: float division by zero",
        ),
        (RuntimeWarning("overflow"), "crash: RuntimeWarning: overflow"),
        (hw.TargetError("here", "no", fix=" "), "refused without a way out: here: no."),
    ],
    ids=["crash", "warning", "no way out"],
)
def test_defects_are_unexplained(monkeypatch, error, cause):
    def broken(case, chip):
        raise error

    monkeypatch.setattr(run, "measure", broken)
    row = run.run_case(CASE, CHIP)
    assert (row.verdict, row.causes) == ("unexplained", (cause,))


def test_an_infinity_on_the_way_is_a_crash(monkeypatch):
    monkeypatch.setattr(run, "measure", lambda case, chip: np.array([1e308]) * 10)
    row = run.run_case(CASE, CHIP)
    assert row.verdict == "unexplained"
    assert row.causes[0].startswith("crash: FloatingPointError: overflow")
