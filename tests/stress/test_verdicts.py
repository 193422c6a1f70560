"""The verdict on what was measured of a case, and the sentences on its causes.

``locsnn stress`` plays *cases*, networks with extreme numbers, on the chip and in float64. The verdict is ``ok``;
``limited``, if a limit of the chip explains all that was lost; ``refused``, if the chip cannot hold the case and the
error names a way out; or ``unexplained``, which is a defect of this project. Every cause is tested alone, and two of them
together.
"""

from dataclasses import replace
from typing import Any, NamedTuple

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
# With strategy reset, the chip's own reset stands for the neuron's refractory response: another neuron model.
CASE = Case("case", "reset", network_of(srm(), random_weights()), random_input())
# Figures of a case that is ok, made up by hand: every row of the table below changes some of them.
FINE = Measured(
    spikes=PopulationMatch(reference_spikes=10, chip_spikes=10, common_spikes=9), error_thresholds=0.05, bound_thresholds=0.2,
    bound_parts_thresholds={"weights": 0.15, "decays": 0.04, "states": 0.01}, model_error_thresholds=0.0, decisions=100,
    decisions_otherwise=1, of_these_ties=0, wraps=0, clips=0, weights=Lost(lost=0, of=24), biases=Lost(lost=0, of=4), overflowed=0, outside=0,
    coarse_decays=(), odd_engine=None,
)  # fmt: skip


class ExpectedVerdict(NamedTuple):
    """What differs from ``FINE``, by field of ``Measured``, and the verdict and the causes that follow."""

    changes: dict[str, Any]
    verdict: str
    causes: tuple[str, ...]


# An error of 9 thresholds is far above the 0.1 from which it needs a cause. ``overflowed`` counts the potentials that
# differ because a register wrapped or clipped, which explains the error; so wraps and clips are its only cause. Potentials
# are compared while both sides send the float network's spikes, wraps and clips are counted while each side sends its
# own: "only if forced" overflows in the first way alone. An error of 0.11 is just above 0.1. ``outside`` counts the
# potentials that differ by more than can be explained.
CAUSES = {
    "fine": ExpectedVerdict({}, "ok", ()),
    "wraps": ExpectedVerdict({"wraps": 2, "overflowed": 3, "error_thresholds": 9.0}, "limited", ("2 wraps: a charge or current leaves its register",)),
    "clips": ExpectedVerdict({"clips": 1, "overflowed": 3, "error_thresholds": 9.0}, "limited", ("1 clip: the potential leaves its register",)),
    "only if forced": ExpectedVerdict({"overflowed": 3}, "limited", ("3 potentials would leave the register with the float network's spikes",)),
    "weights": ExpectedVerdict({"weights": Lost(lost=3, of=24)}, "limited", ("3 of 24 weights round to 0",)),
    "the weight": ExpectedVerdict({"weights": Lost(lost=1, of=1)}, "limited", ("the only weight rounds to 0",)),
    "biases": ExpectedVerdict({"biases": Lost(lost=2, of=4)}, "limited", ("2 of 4 biases round to 0",)),
    "the bias": ExpectedVerdict({"biases": Lost(lost=1, of=1)}, "limited", ("the only bias rounds to 0",)),
    "decay": ExpectedVerdict({"coarse_decays": ("a decay of 4.094 in 4096 is 4: it fades 2.3 % slower",)}, "limited", ("a decay of 4.094 in 4096 is 4: it fades 2.3 % slower",)),
    "model": ExpectedVerdict({"model_error_thresholds": 2.0, "error_thresholds": 2.1}, "limited", ("its reset is another neuron model: 2.0 thresholds at most",)),
    "rounding": ExpectedVerdict({"error_thresholds": 0.11}, "limited", ("rounding: 0.11 thresholds found, at most 0.15 by weights and 0.040 by decays",)),
    "ties": ExpectedVerdict({"of_these_ties": 1}, "limited", ("1 potential exactly at the threshold: the least rounding decides",)),
    "two": ExpectedVerdict({"clips": 1, "weights": Lost(lost=3, of=24)}, "limited", ("1 clip: the potential leaves its register", "3 of 24 weights round to 0")),
    "engine": ExpectedVerdict({"odd_engine": "the reference engine", "clips": 1}, "unexplained", ("the reference engine differs from the fast engine",)),
    "outside": ExpectedVerdict({"outside": 4}, "unexplained", ("4 potentials lie beyond the bound of 0.20 thresholds",)),
}  # fmt: skip


@pytest.mark.parametrize("expected", CAUSES.values(), ids=CAUSES)
def test_each_cause_gives_its_verdict_and_its_sentence(expected):
    row = judge(CASE, replace(FINE, **expected.changes))
    assert (row.verdict, row.causes) == (expected.verdict, expected.causes)


def test_a_refusal_is_a_row_with_its_message():
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
        # An error of ours must say what the user can do; a blank says nothing.
        (hw.TargetError("here", "no", fix=" "), "refused without a way out: here: no."),
    ],
    ids=["crash", "warning", "no way out"],
)
def test_crashes_and_refusals_without_a_way_out_are_unexplained(monkeypatch, error, cause):
    def measure_with_error(case, chip):
        raise error

    monkeypatch.setattr(run, "measure", measure_with_error)
    row = run.run_case(CASE, CHIP)
    assert (row.verdict, row.causes) == ("unexplained", (cause,))


def test_an_infinity_on_the_way_is_a_crash(monkeypatch):
    """``run_case`` lets numpy raise where it would go on with an infinity: 1e309 is beyond float64."""
    monkeypatch.setattr(run, "measure", lambda case, chip: np.array([1e308]) * 10)
    row = run.run_case(CASE, CHIP)
    assert row.verdict == "unexplained"
    assert row.causes[0].startswith("crash: FloatingPointError: overflow")
