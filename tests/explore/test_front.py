"""The front and what is recommended on it, against their definitions."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from locsnn_compile.explore.exploration import Recommendation, on_front, recommend
from locsnn_compile.verification.error_bounds import (
    SCORE_TOLERANCE,
    SPIKE_TOLERANCE,
    ErrorBudget,
    default_budget,
)
from tests.support.explored_model import figures, point

FEW = st.sampled_from([0.25, 0.5, 0.75, 1.0])
FOUND = st.builds(figures, spikes=FEW, predictions=FEW, energy=FEW, time=FEW, scores=FEW)
NO_BUDGET = ErrorBudget()


def costs(found):
    errors = 1 - found.spike_agreement, 1 - found.prediction_agreement, found.score_error
    return np.array([*errors, found.energy_pj, found.chip_time_ns])


@given(st.lists(FOUND, min_size=1, max_size=12))
def test_the_front_is_what_no_other_beats(found):
    table = np.array([costs(one) for one in found])
    no_worse = (table[:, None] <= table[None]).all(axis=2)
    better = (table[:, None] < table[None]).any(axis=2)
    assert on_front(found) == [not beaten for beaten in (no_worse & better).any(axis=0)]


def test_settings_without_figures_are_not_on_the_front_and_beat_none():
    assert on_front([None, figures(spikes=0.1), None]) == [False, True, False]


def test_equal_settings_are_both_on_the_front():
    assert on_front([figures(), figures()]) == [True, True]


BOUND = st.one_of(st.none(), FEW)


@given(st.lists(FOUND, min_size=1, max_size=12), BOUND, BOUND, BOUND)
def test_nothing_off_the_front_is_recommended(found, agreement, error, off):
    points = [point(found=one) for one in found]
    taken = recommend(points, ErrorBudget(agreement, error, off)).taken
    front = on_front(found)
    within = [
        one
        for one in found
        if (agreement is None or one.prediction_agreement >= agreement)
        and (error is None or one.spike_error <= error)
        and (off is None or one.score_error <= off)
    ]
    if taken is None:
        assert not within or (agreement, error, off) == (None, None, None)
        return
    assert front[next(i for i, one in enumerate(points) if one is taken)]
    assert taken.figures.energy_pj == min(one.energy_pj for one in within)


TABLE = [
    ("dendrite", 8, figures(spikes=0.9, predictions=1.0, energy=12e6, time=2e6)),
    ("delay-line", 8, figures(spikes=0.8, predictions=0.995, energy=7e6, time=1.1e6)),
    ("reset", 8, figures(spikes=0.5, predictions=0.99, energy=6e6, time=1e6, scores=0.4)),
    ("reset", 1, figures(spikes=0.1, predictions=0.1, energy=1e6, time=1e5, scores=0.9)),
    ("dendrite", 1, figures(spikes=0.1, predictions=0.1, energy=2e6, time=2e5, scores=0.9)),
]


@pytest.mark.parametrize(
    ("budget", "taken", "why"),
    [
        (NO_BUDGET, "none", "nothing was compared: no neuron spikes on these recordings, and all class scores tie"),
        (ErrorBudget(max_spike_error=0.2), "delay-line, 8-bit", "the least energy, 7.00 µJ and 1.10 ms per recording, of 2 settings on the front within --max-spike-error 0.2"),
        (ErrorBudget(min_agreement=1.0), "dendrite, 8-bit", "the least energy, 12.0 µJ and 2.00 ms per recording, of 1 setting on the front within --min-agreement 1"),
        (ErrorBudget(min_agreement=0.0, max_spike_error=1.0), "reset, 1-bit", "the least energy, 1.00 µJ and 100 µs per recording, of 4 settings on the front within --min-agreement 0 and --max-spike-error 1"),
        (ErrorBudget(max_score_error=0.05), "delay-line, 8-bit", "the least energy, 7.00 µJ and 1.10 ms per recording, of 2 settings on the front within --max-score-error 0.05"),
        (ErrorBudget(max_spike_error=0.05), "none", "no setting keeps --max-spike-error 0.05; the least spike error is 10.0 %, with 0 % of the predictions changed, by dendrite, 8-bit"),
    ],
    ids=["nothing compared", "spikes", "predictions", "both", "scores", "none keeps it"],
)  # fmt: skip
def test_what_is_recommended_and_why(budget, taken, why):
    found = recommend([point(name, bits, one) for name, bits, one in TABLE], budget)
    assert (str(found.taken.setting) if found.taken else "none", found.why) == (taken, why)


def test_a_cheaper_setting_whose_potentials_are_off_beats_none_and_is_not_recommended():
    """No neuron spikes here, and every class stays: only class scores tell the two apart."""
    exact = figures(spikes=None, energy=2e6, scores=0.002)
    coarse = point("dendrite", 2, figures(spikes=None, energy=1e6, scores=0.43))
    points = [point("dendrite", 8, exact), coarse]
    assert on_front([one.figures for one in points]) == [True, True]
    assert recommend(points, default_budget(exact), by_default=True).taken is points[0]
    assert recommend(points, ErrorBudget(max_score_error=0.001)) == Recommendation(
        None,
        "no setting keeps --max-score-error 0.001; the least error of class scores is 0.20 % of their spread, with 0 % of "
        "the predictions changed, by dendrite, 8-bit",
    )
    assert recommend(points, ErrorBudget(max_score_error=0.5)).taken is coarse


def test_what_auto_keeps_is_said():
    points = [point(name, bits, one) for name, bits, one in TABLE]
    found = recommend(points, ErrorBudget(min_agreement=1.0, max_spike_error=0.11), by_default=True)
    assert str(found.taken.setting) == "dendrite, 8-bit"
    assert found.why == (
        "the best weighed energy, 12.0 µJ and 2.00 ms per recording, of 1 setting on the front within what auto "
        "keeps by default, --min-agreement 1 and --max-spike-error 0.11, with a percent of spikes worth 5 % of the cost"
    )


TIED = {"dendrite": None, "reset": 1.0}


def test_a_bound_on_what_was_not_compared_is_not_kept():
    silent = [
        point(name, 8, figures(None, predictions, scores=None))
        for name, predictions in TIED.items()
    ]
    assert on_front([one.figures for one in silent]) == [True, True]
    found = recommend(silent, ErrorBudget(min_agreement=0.0, max_spike_error=1.0))
    assert found.taken is None
    assert found.why == (
        "no setting keeps --min-agreement 0 and --max-spike-error 1; no neuron spikes on these recordings"
    )


@pytest.mark.parametrize(
    ("first", "budget"),
    [
        (
            figures(spikes=0.75, predictions=0.5),
            ErrorBudget(
                min_agreement=0.5,
                max_spike_error=0.25 + SPIKE_TOLERANCE,
                max_score_error=SCORE_TOLERANCE,
            ),
        ),
        (
            figures(spikes=0.75, predictions=None, scores=None),
            ErrorBudget(min_agreement=None, max_spike_error=0.25 + SPIKE_TOLERANCE),
        ),
        (
            figures(spikes=None, scores=0.5),
            ErrorBudget(
                min_agreement=1.0, max_spike_error=None, max_score_error=0.5 + SCORE_TOLERANCE
            ),
        ),
        (figures(spikes=None, predictions=None, scores=None), ErrorBudget()),
    ],
    ids=["all", "ties", "potentials", "silence"],
)
def test_bounds_by_default(first, budget):
    assert default_budget(first) == budget


def test_without_energy_the_setting_of_least_time_is_recommended():
    points = [
        point("dendrite", found=figures(energy=None, time=2e6)),
        point("reset", found=figures(energy=None)),
    ]
    found = recommend(points, ErrorBudget(min_agreement=0.5))
    assert found.taken is points[1]
    assert (
        found.why
        == "the least time, 1.00 ms per recording, of 1 setting on the front within --min-agreement 0.5"
    )
