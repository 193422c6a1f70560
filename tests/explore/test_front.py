"""The front and the recommended point, against their definitions.

A point is on the front if none is at least as good in every objective and better in one. The definition is written here
once more with numpy, and tried on random figures.
"""

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

# Few different values, so that points are often equal in some figures.
FEW = st.sampled_from([0.25, 0.5, 0.75, 1.0])
ANY_FIGURES = st.builds(figures, spikes=FEW, predictions=FEW, energy=FEW, time=FEW, scores=FEW)
NO_BUDGET = ErrorBudget()


def costs(point_figures):
    """Return the objectives of a point, all to be minimised."""
    errors = (
        1 - point_figures.spike_agreement,
        1 - point_figures.prediction_agreement,
        point_figures.score_error,
    )
    return np.array([*errors, point_figures.energy_pj, point_figures.chip_time_ns])


@given(st.lists(ANY_FIGURES, min_size=1, max_size=12))
def test_the_front_is_what_no_other_beats(found):
    table = np.array([costs(point_figures) for point_figures in found])
    no_worse = (table[:, None] <= table[None]).all(axis=2)
    better = (table[:, None] < table[None]).any(axis=2)
    assert on_front(found) == [not beaten for beaten in (no_worse & better).any(axis=0)]


def test_settings_without_figures_are_not_on_the_front_and_beat_none():
    assert on_front([None, figures(spikes=0.1), None]) == [False, True, False]


def test_equal_settings_are_both_on_the_front():
    assert on_front([figures(), figures()]) == [True, True]


BOUND = st.one_of(st.none(), FEW)


@given(st.lists(ANY_FIGURES, min_size=1, max_size=12), BOUND, BOUND, BOUND)
def test_nothing_off_the_front_is_recommended(
    found, min_agreement, max_spike_error, max_score_error
):
    points = [point(found=point_figures) for point_figures in found]
    taken = recommend(points, ErrorBudget(min_agreement, max_spike_error, max_score_error)).taken
    front = on_front(found)
    within_bounds = [
        point_figures
        for point_figures in found
        if (min_agreement is None or point_figures.prediction_agreement >= min_agreement)
        and (max_spike_error is None or point_figures.spike_error <= max_spike_error)
        and (max_score_error is None or point_figures.score_error <= max_score_error)
    ]
    if taken is None:
        assert not within_bounds or (min_agreement, max_spike_error, max_score_error) == (
            None,
            None,
            None,
        )
        return
    assert front[next(i for i, point_figures in enumerate(points) if point_figures is taken)]
    assert taken.figures.energy_pj == min(
        point_figures.energy_pj for point_figures in within_bounds
    )


# Strategy, weight bits and figures; an agreement of 1 is an error of 0. Energies are in pJ, times in ns.
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
    recommendation = recommend(
        [point(name, bits, point_figures) for name, bits, point_figures in TABLE], budget
    )
    assert (
        str(recommendation.taken.setting) if recommendation.taken else "none",
        recommendation.why,
    ) == (taken, why)


def test_a_cheaper_setting_whose_potentials_are_off_beats_none_and_is_not_recommended():
    """No neuron spikes here, and every class stays: only class scores tell the two apart."""
    exact = figures(spikes=None, energy=2e6, scores=0.002)
    coarse = point("dendrite", 2, figures(spikes=None, energy=1e6, scores=0.43))
    points = [point("dendrite", 8, exact), coarse]
    assert on_front([one.figures for one in points]) == [True, True]
    assert recommend(points, default_budget(exact), by_default=True).taken is points[0]
    assert recommend(points, ErrorBudget(max_score_error=0.001)) == Recommendation(
        taken=None,
        why="no setting keeps --max-score-error 0.001; the least error of class scores is 0.20 % of their spread, with 0 % of "
        "the predictions changed, by dendrite, 8-bit",
    )
    assert recommend(points, ErrorBudget(max_score_error=0.5)).taken is coarse


def test_what_auto_keeps_is_said():
    points = [point(name, bits, point_figures) for name, bits, point_figures in TABLE]
    recommendation = recommend(
        points, ErrorBudget(min_agreement=1.0, max_spike_error=0.11), by_default=True
    )
    assert str(recommendation.taken.setting) == "dendrite, 8-bit"
    assert recommendation.why == (
        "the best weighed energy, 12.0 µJ and 2.00 ms per recording, of 1 setting on the front within what auto "
        "keeps by default, --min-agreement 1 and --max-spike-error 0.11, with a percent of spikes worth 5 % of the cost"
    )


TIED = {"dendrite": None, "reset": 1.0}


def test_a_bound_on_what_was_not_compared_is_not_kept():
    silent = [
        point(name, 8, figures(None, predictions, scores=None))
        for name, predictions in TIED.items()
    ]
    assert on_front([silent_point.figures for silent_point in silent]) == [True, True]
    recommendation = recommend(silent, ErrorBudget(min_agreement=0.0, max_spike_error=1.0))
    assert recommendation.taken is None
    assert recommendation.why == (
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
    recommendation = recommend(points, ErrorBudget(min_agreement=0.5))
    assert recommendation.taken is points[1]
    assert (
        recommendation.why
        == "the least time, 1.00 ms per recording, of 1 setting on the front within --min-agreement 0.5"
    )
