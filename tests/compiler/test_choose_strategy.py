"""Strategy ``auto``: which setting it chooses within an error budget, and on which recordings.

``auto`` compiles a network with several settings (strategy, weight bits, split weights and other dials of
:data:`DIALS`), measures each on calibration recordings, and takes the cheapest that keeps the budget.
"""

from dataclasses import dataclass, replace

import numpy as np
import pytest

import hw_model as hw
import locsnn_compile as lc
import locsnn_compile.settings as settings_module
from locsnn_compile.data.recordings import Recordings
from locsnn_compile.data.sensor import neutouch
from locsnn_compile.errors import InputError, TargetError
from locsnn_compile.network.neurons import Cuba
from locsnn_compile.passes.quantize import quantize
from locsnn_compile.report.sections.build import unmet_budget
from locsnn_compile.request.choose_strategy import Candidate, Choice, choose_strategy
from locsnn_compile.request.compile_request import SettingRequest
from locsnn_compile.settings import DIALS, SPIKE_WORTH, Dial, Search, Setting
from locsnn_compile.verification.error_bounds import (
    SCORE_TOLERANCE,
    SPIKE_TOLERANCE,
    ErrorBudget,
    Losses,
    weighed_best,
)
from tests.support.networks import NEURON, hybrid, on_grid, recordings, single

CHIP = hw.chip("loihi-sim")
PAIRED = "paired-dendrite"


@pytest.fixture(scope="module")
def network():
    """A small hybrid of spike response neurons, which every strategy can lower."""
    return hybrid(1, steps=60, hidden=8)


def played(network, seed=0):
    """Return six random recordings without labels."""
    return Recordings(
        recordings(network, samples=6, seed=seed), labels=None, step_seconds=None, source="made up"
    )


@pytest.fixture(scope="module")
def choose(network):
    """Return a function that chooses a setting for the network on its random recordings, given a budget."""

    def choose_within(budget, chip=CHIP):
        request = SettingRequest(Setting("auto", weight_bits=8), budget=budget)
        return choose_strategy(network, chip, request, played(network))

    return choose_within


@pytest.mark.parametrize(
    ("compartments_per_core", "first_that_fits"), [(1024, None), (2, "delay-line"), (1, "reset")]
)
def test_the_report_says_which_strategy_sets_the_bounds_where_it_is_not_the_usual_one(
    network, compartments_per_core, first_that_fits
):
    """The bounds are what dendrites lose; if the chip cannot hold these, what the first strategy that fits loses."""
    limits = replace(CHIP.limits, compartments_per_core=compartments_per_core)
    chip = replace(CHIP, limits=limits, chips=8)
    compiled = lc.compile(network, chip, events=played(network), diagnosis=False)
    assumptions = compiled.report["assumptions"]
    expected = []
    if first_that_fits is not None:
        expected = [
            "loihi-sim cannot hold strategy dendrite, which sets the bounds of auto. "
            f"Here {first_that_fits} sets them."
        ]
    assert [line for line in assumptions if "bounds of auto" in line] == expected


def test_candidates_are_measured_on_the_calibration_recordings(network, choose):
    choice = choose(ErrorBudget())
    assert [candidate.strategy for candidate in choice.candidates] == [
        "dendrite",
        "delay-line",
        "reset",
    ]
    assert choice.samples == 6
    assert choice.source == "made up"
    for candidate in choice.candidates:
        report = lc.compile(
            network, strategy=candidate.strategy, events=played(network), diagnosis=False
        ).report
        assert report["energy"]["per_sample_pj"] == pytest.approx(candidate.energy_pj)
        assert report["match"]["prediction_agreement"] == candidate.prediction_agreement
        assert report["match"]["spike_agreement"] == pytest.approx(1 - candidate.spike_error)
        assert report["match"]["score_error"] == candidate.score_error


def test_without_a_budget_no_more_is_lost_than_with_dendrites(choose):
    choice = choose(ErrorBudget())
    dendrite, delay_line, reset = choice.candidates
    assert choice.budget == ErrorBudget(
        min_agreement=dendrite.prediction_agreement,
        max_spike_error=dendrite.spike_error + SPIKE_TOLERANCE,
        max_score_error=dendrite.score_error + SCORE_TOLERANCE,
    )
    assert not reset.keeps(choice.budget)
    within_budget = [
        candidate for candidate in (dendrite, delay_line) if candidate.keeps(choice.budget)
    ]
    least_pj = min(candidate.energy_pj for candidate in within_budget)

    def weighed_cost(candidate):
        return candidate.energy_pj / least_pj + SPIKE_WORTH * candidate.spike_error

    assert choice.taken == min(within_budget, key=weighed_cost)


def losses(spike_error, cost, score_error=0.0):
    """Return what a candidate loses and costs: shares of spikes and scores, and picojoules. Predictions all agree."""
    return Losses(
        prediction_agreement=1.0,
        spike_agreement=None if spike_error is None else 1 - spike_error,
        score_error=score_error,
        energy_pj=cost,
        chip_time_ns=1.0,
    )


@pytest.mark.parametrize(
    ("exact", "cheap", "spike_worth", "taken"),
    [
        # As measured with the example network objects-hybrid: losing 1 % more of the spikes saves 0.06 % of the cycles,
        # or 2.5 % of the energy.
        pytest.param(
            losses(spike_error=0.0083, cost=2_459_142),
            losses(spike_error=0.0182, cost=2_457_662),
            5,
            "exact",
            id="cycles",
        ),
        pytest.param(
            losses(spike_error=0.0083, cost=11.017),
            losses(spike_error=0.0182, cost=10.743),
            5,
            "exact",
            id="energy",
        ),
        # 5 % more of the spikes have to save 25 %.
        pytest.param(
            losses(spike_error=0.05, cost=100),
            losses(spike_error=0.10, cost=79),
            5,
            "cheap",
            id="saves a fifth",
        ),
        pytest.param(
            losses(spike_error=0.05, cost=100),
            losses(spike_error=0.10, cost=81),
            5,
            "exact",
            id="saves less",
        ),
        pytest.param(
            losses(spike_error=0.0083, cost=11.017),
            losses(spike_error=0.0182, cost=10.743),
            1,
            "cheap",
            id="worth less",
        ),
        pytest.param(
            losses(spike_error=0.0083, cost=11.017),
            losses(spike_error=0.0182, cost=10.743),
            0,
            "cheap",
            id="cost alone",
        ),
        pytest.param(
            losses(spike_error=None, cost=100, score_error=0.01),
            losses(spike_error=None, cost=99, score_error=0.04),
            5,
            "exact",
            id="scores",
        ),
        pytest.param(
            losses(spike_error=0.1, cost=0),
            losses(spike_error=0.1, cost=0),
            5,
            "exact",
            id="no cost, no difference",
        ),
    ],
)
def test_errors_are_weighed_against_the_cost(exact, cheap, spike_worth, taken):
    """``spike_worth`` percent of the cost must be saved for each percent of the spikes that is lost."""
    assert weighed_best([exact, cheap], spike_worth) is {"exact": exact, "cheap": cheap}[taken]


def test_the_worth_of_a_spike_can_be_set(network):
    def choose_by(spike_worth):
        request = SettingRequest(Setting("auto", weight_bits=8), spike_worth=spike_worth)
        return choose_strategy(network, CHIP, request, played(network))

    exact = choose_by(1e6)
    cheap = choose_by(0.0)
    within_budget = [candidate for candidate in cheap.candidates if candidate.keeps(cheap.budget)]
    assert exact.taken.spike_error == min(candidate.spike_error for candidate in within_budget)
    assert cheap.taken.energy_pj == min(candidate.energy_pj for candidate in within_budget)
    assert exact.spike_worth == 1e6
    assert cheap.spike_worth == 0.0


@pytest.mark.slow
@pytest.mark.parametrize(
    ("budget", "taken"),
    [
        (ErrorBudget(min_agreement=0.0), "reset"),
        (ErrorBudget(max_spike_error=1.0), "reset"),
        (ErrorBudget(max_spike_error=0.25), "dendrite"),
        (ErrorBudget(max_score_error=0.25), "dendrite"),
        (ErrorBudget(max_score_error=9.0), "reset"),
    ],
    ids=[
        "any prediction",
        "any spike",
        "a quarter of the spikes",
        "a quarter of the scores",
        "any score",
    ],
)
def test_the_cheapest_within_the_budget_is_taken(choose, budget, taken):
    choice = choose(budget)
    assert choice.taken.strategy == choice.levels.quantized.strategy == taken
    within_budget = [candidate for candidate in choice.candidates if candidate.keeps(budget)]
    assert choice.taken == min(within_budget, key=lambda candidate: candidate.energy_pj)


def test_fewer_bits_are_tried_down_to_the_fewest(network, monkeypatch):
    """Losses may rise and fall with the bits, so the search goes on below a number that does not keep the budget: here 6."""
    keeps = Candidate.keeps

    def keeps_except_with_six_bits(self, bounds):
        return self.setting.weight_bits != 6 and keeps(self, bounds)

    monkeypatch.setattr(Candidate, "keeps", keeps_except_with_six_bits)
    budget = ErrorBudget(max_spike_error=0.9)
    request = SettingRequest(Setting("reset", weight_bits=8), budget=budget)
    choice = choose_strategy(network, CHIP, request, played(network))
    bits_tried = [candidate.setting.weight_bits for candidate in choice.candidates]
    assert bits_tried == [8, 6, 5, 4, 3, 2, 1]
    assert choice.taken.setting.weight_bits < 6


# A dial that the compiler does not have, to test what a new row of DIALS brings.
HEADROOM = Dial(
    "headroom",
    values=(8.0, 16.0),
    neutral=16.0,
    needs="has_float_weights",
    tried="thresholds that the voltage register holds",
    help="thresholds that the voltage register holds (default 16)",
    value="X",
    read=float,
)


@dataclass(frozen=True)
class SettingWithHeadroom(Setting):
    """A setting with a value for the dial :data:`HEADROOM`."""

    headroom: float = 16.0


@pytest.mark.parametrize(
    ("search", "given", "tried"),
    [
        pytest.param(Search(), set(), {16.0}, id="no search"),
        pytest.param(Search(finer=(12.0, 8.0)), set(), {16.0, 12.0, 8.0}, id="finer"),
        pytest.param(Search(finer=(12.0, 8.0)), {"headroom"}, {16.0}, id="finer, but given"),
        pytest.param(
            Search(starts=lambda network, value: [value, 4.0]), set(), {16.0, 4.0}, id="starts"
        ),
        pytest.param(
            Search(starts=lambda network, value: [value, 4.0], last_resorts=[4.0]),
            set(),
            {16.0, 4.0},
            id="last resort",
        ),
        pytest.param(
            Search(coarser=lambda chip, value: [2 * value]), set(), {16.0}, id="coarser, none kept"
        ),
    ],
)
def test_the_search_of_a_dial_says_how_auto_varies_it(network, monkeypatch, search, given, tried):
    """No setting keeps the bounds here, so auto tries all values that the dial allows, unless one was ``given``."""
    monkeypatch.setattr(settings_module, "DIALS", (*DIALS, replace(HEADROOM, search=search)))
    request = SettingRequest(
        SettingWithHeadroom("reset", weight_bits=8),
        given=frozenset({"split_weights", *given}),
        budget=ErrorBudget(max_spike_error=0.0),
    )
    choice = choose_strategy(network, CHIP, request, played(network))
    assert {candidate.setting.headroom for candidate in choice.candidates} == tried


def test_the_search_of_a_dial_says_what_costs_less_once_bounds_are_kept(network, monkeypatch):
    search = Search(coarser=lambda chip, value: [2 * value, 4 * value])
    monkeypatch.setattr(settings_module, "DIALS", (*DIALS, replace(HEADROOM, search=search)))
    request = SettingRequest(
        SettingWithHeadroom("reset", weight_bits=1), budget=ErrorBudget(max_spike_error=1.0)
    )
    choice = choose_strategy(network, CHIP, request, played(network))
    assert [candidate.setting.headroom for candidate in choice.candidates] == [16.0, 32.0, 64.0]


@pytest.mark.slow
def test_dendrites_are_paired_where_no_other_strategy_keeps_the_budget(network):
    def choose(bound):
        budget = ErrorBudget(max_spike_error=bound)
        request = SettingRequest(Setting("auto", weight_bits=2), budget=budget)
        return choose_strategy(network, CHIP, request, played(network))

    def unpaired(choice):
        return [candidate for candidate in choice.candidates if candidate.strategy != PAIRED]

    least_error = min(candidate.spike_error for candidate in unpaired(choose(0.0)))
    choice = choose(least_error - 1e-6)
    assert choice.keeps_budget
    assert choice.taken.strategy == choice.levels.quantized.strategy == PAIRED
    assert choice.taken.energy_pj > max(candidate.energy_pj for candidate in unpaired(choice))
    # Within a budget that another strategy keeps, dendrites are not paired.
    within_reach = choose(least_error)
    assert unpaired(within_reach) == list(within_reach.candidates)


@pytest.mark.slow
def test_where_nothing_keeps_the_budget_the_most_accurate_is_taken(choose):
    choice = choose(ErrorBudget(max_spike_error=0.0))
    best = max(
        choice.candidates,
        key=lambda candidate: (candidate.prediction_agreement, -candidate.spike_error),
    )
    assert choice.taken == best


def test_a_strategy_that_the_chip_cannot_hold_is_passed_over(network):
    """A refractory kernel of 40 steps is too long for delay lines."""
    slow = replace(NEURON, tau_ref=40.0)
    slow_populations = tuple(replace(p, neuron=slow) for p in network.populations)
    slow_network = replace(network, populations=slow_populations)
    request = SettingRequest(Setting("auto", weight_bits=8))
    choice = choose_strategy(slow_network, CHIP, request, played(slow_network))
    assert [candidate.strategy for candidate in choice.candidates] == ["dendrite", "reset"]


def test_where_none_fits_the_first_error_is_the_answer(choose):
    chip_without_compartments = replace(CHIP, limits=replace(CHIP.limits, compartments_per_core=0))
    with pytest.raises(TargetError) as caught:
        choose(ErrorBudget(), chip_without_compartments)
    assert str(caught.value).startswith(
        "population 'time_hidden': 3 compartments of neuron 0 do not fit one core"
    )


def test_integers_leave_nothing_to_choose():
    network = on_grid(1)
    compiled = lc.compile(network, events=recordings(network, samples=2), diagnosis=False)
    assert compiled.choice is None
    assert compiled.report["strategy_choice"] is None
    assert compiled.report["match"]["spike_mismatches"] == 0


@pytest.mark.slow
@pytest.mark.parametrize(
    ("max_spike_error", "bits", "taken", "kept"),
    [
        (0.0, 8, "native, 8-bit, 100% split", True),
        (0.1, 8, "native, 4-bit", True),
        (0.1, 2, "native, 2-bit, 25% split", False),
    ],
    ids=["split weights", "fewer bits", "not kept"],
)
def test_a_budget_holds_for_neurons_that_no_strategy_lowers(max_spike_error, bits, taken, kept):
    """Leaky neurons are single compartments (native) in any strategy; bits and split weights remain to be chosen."""
    weights = np.random.default_rng(1).normal(0, 0.3, (6, 8))
    network = single(Cuba.of(6, decay_v=0.1, threshold=1.0), weights, steps=60)
    events = recordings(network, samples=5)
    budget = ErrorBudget(max_spike_error=max_spike_error)
    compiled = lc.compile(network, weight_bits=bits, events=events, budget=budget, diagnosis=False)
    choice = compiled.choice
    report = compiled.report
    assert str(choice.taken.setting) == taken
    assert choice.keeps_budget == kept
    assert (1 - report["match"]["spike_agreement"] <= max_spike_error) == kept
    assert report["strategy_choice"]["taken"] == report["strategy"] == "native"
    assert any("settings suit these" in assumption for assumption in report["assumptions"])
    assert lc.compile(network, events=events, diagnosis=False).choice is None
    with pytest.raises(InputError) as caught:
        lc.compile(network, strategy="dendrite", events=events, budget=budget, diagnosis=False)
    assert str(caught.value) == (
        "strategy 'dendrite': no neuron of this model uses it (its neurons are native). Leave the strategy out."
    )


def test_the_report_says_what_was_compared(network):
    compiled = lc.compile(network, events=recordings(network, samples=4), diagnosis=False)
    choice = compiled.report["strategy_choice"]
    assert choice["taken"] == compiled.report["strategy"] == compiled.choice.taken.strategy
    assert choice["calibration_samples"] == 4
    rows = choice["candidates"]
    assert [row["strategy"] for row in rows] == ["dendrite", "delay-line", "reset"]
    assert rows[0]["within_budget"]


@pytest.mark.slow
def test_the_choice_does_not_depend_on_the_recordings_that_are_reported():
    """A model whose input is a fingertip's calibrates on synthetic touches, unless it carries or is given recordings."""
    fingertip_channels = 78
    network = hybrid(2, channels=fingertip_channels, steps=30, sensor=neutouch())

    def choice_of(network, events, calibration=None):
        compiled = lc.compile(network, events=events, calibration=calibration, diagnosis=False)
        return compiled.choice

    first = choice_of(network, recordings(network, samples=2, seed=0))
    second = choice_of(network, recordings(network, samples=2, seed=1))
    assert first.source == second.source == "synthetic touches"
    assert first.candidates == second.candidates
    carrying = replace(network, recordings=played(network))
    assert choice_of(carrying, recordings(network)).source == "made up"
    by_calibration = choice_of(network, recordings(network), recordings(network, samples=3))
    assert by_calibration.source == "array"
    assert by_calibration.samples == 3


@pytest.mark.parametrize(
    ("make", "strategy", "message"),
    [
        (
            lambda: hybrid(),
            "resets",
            "strategy 'resets': unknown lowering strategy. Did you mean 'reset'?",
        ),
        (
            lambda: quantize(single(NEURON), CHIP, weight_bits=8, strategy="delay-line").on_grid(),
            "dendrite",
            "strategy 'dendrite': no neuron of this model uses it (its neurons are delay-line). "
            "Leave the strategy out.",
        ),
    ],
    ids=["unknown", "already laid out by another"],
)
def test_strategies_that_do_not_apply_are_refused(make, strategy, message):
    network = make()
    silence = np.zeros((1, network.steps, network.channels), dtype=np.uint8)
    with pytest.raises(InputError) as caught:
        lc.compile(network, strategy=strategy, events=silence)
    assert str(caught.value) == message


@pytest.mark.parametrize(
    ("predictions", "spikes", "score_error", "message"),
    [
        pytest.param(
            0.5,
            0.9,
            0.25,
            "50.0 % of the predictions changed, 10.0 % of the spikes different "
            "and class scores off by 25.0 % of their spread. "
            "Train for the chip with locsnn train --target, or allow more.",
            id="all compared",
        ),
        pytest.param(
            None,
            0.9,
            None,
            "an unknown share of the predictions changed, 10.0 % of the spikes different "
            "and class scores off by an unknown share of their spread. "
            "Give --calibration recordings in which outputs spike.",
            id="scores tie",
        ),
        pytest.param(
            None,
            None,
            None,
            "an unknown share of the predictions changed, an unknown share of the spikes different "
            "and class scores off by an unknown share of their spread. "
            "Give --calibration recordings in which outputs spike.",
            id="silent",
        ),
    ],
)
def test_the_report_shows_a_way_out_if_no_setting_keeps_the_budget(
    predictions, spikes, score_error, message
):
    best = Candidate(
        prediction_agreement=predictions,
        spike_agreement=spikes,
        score_error=score_error,
        energy_pj=None,
        chip_time_ns=1.0,
        setting=Setting("reset", weight_bits=4),
    )
    choice = Choice(
        taken=best,
        levels_by_setting=None,
        candidates=(best,),
        budget=ErrorBudget(min_agreement=0.9),
        samples=2,
        source="a.npz",
    )
    assert unmet_budget(choice) == (
        "no setting keeps --min-agreement 0.9 on 2 recordings of a.npz: "
        f"the best of 1 is reset, 4-bit, with {message}"
    )
