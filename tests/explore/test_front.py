"""The front and what is recommended on it, against their definitions."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from small_model import figures, point

from locsnn_compile.choose_strategy import ErrorBudget
from locsnn_compile.explore.front import on_front
from locsnn_compile.explore.recommend import recommend

FEW = st.sampled_from([0.25, 0.5, 0.75, 1.0])
FOUND = st.builds(figures, spikes=FEW, predictions=FEW, energy=FEW, time=FEW)
NO_BUDGET = ErrorBudget()


def costs(found):
    return np.array([1 - found.spike_agreement, 1 - found.prediction_agreement, found.energy_pj, found.chip_time_ns])


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


@given(st.lists(FOUND, min_size=1, max_size=12), st.one_of(st.none(), FEW), st.one_of(st.none(), FEW))
def test_nothing_off_the_front_is_recommended(found, agreement, error):
    points = [point(found=one) for one in found]
    taken = recommend(points, ErrorBudget(agreement, error)).taken
    front = on_front(found)
    within = [
        one
        for one in found
        if (agreement is None or one.prediction_agreement >= agreement) and (error is None or one.spike_error <= error)
    ]
    if taken is None:
        assert not within
        return
    assert front[next(i for i, one in enumerate(points) if one is taken)]
    if (agreement, error) != (None, None):
        assert taken.figures.energy_pj == min(one.energy_pj for one in within)


TABLE = [
    ("dendrite", 8, figures(spikes=0.9, predictions=1.0, energy=12e6, time=2e6)),
    ("delay-line", 8, figures(spikes=0.8, predictions=0.995, energy=7e6, time=1.1e6)),
    ("reset", 8, figures(spikes=0.5, predictions=0.99, energy=6e6, time=1e6)),
    ("reset", 1, figures(spikes=0.1, predictions=0.1, energy=1e6, time=1e5)),
    ("dendrite", 1, figures(spikes=0.1, predictions=0.1, energy=2e6, time=2e5)),
]


@pytest.mark.parametrize(
    ("budget", "taken", "why"),
    [
        (NO_BUDGET, "delay-line, 8-bit", "the knee of the front: of its settings that change at most 1 % more of the predictions than the best, the one with the smallest sum of squares of spike error, changed predictions, energy and chip time, each from 0, the best of these settings, to 1, the worst"),
        (ErrorBudget(max_spike_error=0.2), "delay-line, 8-bit", "the least energy, 7.00 µJ and 1.10 ms a recording, of 2 settings on the front within --max-spike-error 0.2"),
        (ErrorBudget(min_agreement=1.0), "dendrite, 8-bit", "the least energy, 12.0 µJ and 2.00 ms a recording, of 1 setting on the front within --min-agreement 1"),
        (ErrorBudget(0.0, 1.0), "reset, 1-bit", "the least energy, 1.00 µJ and 100 µs a recording, of 4 settings on the front within --min-agreement 0 and --max-spike-error 1"),
        (ErrorBudget(max_spike_error=0.05), "none", "no setting keeps --max-spike-error 0.05; the least spike error is 10.0 %, with 0 % of the predictions changed, by dendrite, 8-bit"),
    ],
    ids=["knee", "spikes", "predictions", "both", "none keeps it"],
)  # fmt: skip
def test_what_is_recommended_and_why(budget, taken, why):
    found = recommend([point(name, bits, one) for name, bits, one in TABLE], budget)
    assert (str(found.taken.setting) if found.taken else "none", found.why) == (taken, why)
