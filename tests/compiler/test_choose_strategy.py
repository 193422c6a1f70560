"""Strategy ``auto``: what it takes within which budget, on which recordings."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

import hw_model as hw
import locsnn_compile as lc
import locsnn_compile.settings as rows
from locsnn_compile.data.recordings import Recordings
from locsnn_compile.data.sensor import neutouch
from locsnn_compile.errors import InputError, TargetError
from locsnn_compile.network.neurons import Cuba
from locsnn_compile.passes.quantize import quantize
from locsnn_compile.report.sections.build import unmet_budget
from locsnn_compile.request.choose_strategy import Candidate, Choice, choose_strategy
from locsnn_compile.request.compile_request import SettingRequest
from locsnn_compile.settings import DIALS, Dial, Search, Setting
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
    """Six random recordings without labels."""
    return Recordings(
        recordings(network, samples=6, seed=seed), labels=None, step_seconds=None, source="made up"
    )


@pytest.fixture(scope="module")
def choose(network):
    """Return what chooses a setting for the network on its random recordings, given a budget."""
    return lambda budget, chip=CHIP: choose_strategy(
        network,
        chip,
        SettingRequest(Setting("auto", weight_bits=8), budget=budget),
        played(network),
    )


@pytest.mark.parametrize(("compartments", "first"), [(1024, None), (2, "delay-line"), (1, "reset")])
def test_the_report_says_which_strategy_sets_the_bounds_where_it_is_not_the_usual_one(
    network, compartments, first
):
    """A network that only ``reset`` could hold was measured against itself, and kept the bounds without a word."""
    limits = replace(CHIP.limits, compartments_per_core=compartments)
    chip = replace(CHIP, limits=limits, chips=8)
    assumed = lc.compile(network, chip, events=played(network), diagnosis=False).report[
        "assumptions"
    ]
    said = (
        "loihi-sim cannot hold strategy dendrite, which sets the bounds of auto. Here {} sets them."
    )
    assert [line for line in assumed if "bounds of auto" in line] == (
        [said.format(first)] if first else []
    )


def test_candidates_are_measured_on_the_calibration_recordings(network, choose):
    choice = choose(ErrorBudget())
    assert [candidate.strategy for candidate in choice.candidates] == [
        "dendrite",
        "delay-line",
        "reset",
    ]
    assert (choice.samples, choice.source) == (6, "made up")
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
    spikes, scores = dendrite.spike_error + SPIKE_TOLERANCE, dendrite.score_error + SCORE_TOLERANCE
    assert choice.budget == ErrorBudget(dendrite.prediction_agreement, spikes, scores)
    assert not reset.keeps(choice.budget)
    kept = [candidate for candidate in (dendrite, delay_line) if candidate.keeps(choice.budget)]
    least = min(candidate.energy_pj for candidate in kept)
    assert choice.taken == min(
        kept, key=lambda candidate: candidate.energy_pj / least + 5 * candidate.spike_error
    )


def losses(spike_error, cost, score_error=0.0):
    """What a candidate loses and costs: a share of spikes, of scores, and picojoules; predictions are all equal."""
    return Losses(1.0, None if spike_error is None else 1 - spike_error, score_error, cost, 1.0)


@pytest.mark.parametrize(
    ("exact", "cheap", "spike_worth", "taken"),
    [
        # As measured of objects-hybrid: 1 % more of the spikes for 0.06 % of the cycles, and for
        # 2.5 % of the energy.
        pytest.param(losses(0.0083, 2_459_142), losses(0.0182, 2_457_662), 5, "exact", id="cycles"),
        pytest.param(losses(0.0083, 11.017), losses(0.0182, 10.743), 5, "exact", id="energy"),
        # 5 % more of the spikes have to save 25 %.
        pytest.param(losses(0.05, 100), losses(0.10, 79), 5, "cheap", id="saves a fifth"),
        pytest.param(losses(0.05, 100), losses(0.10, 81), 5, "exact", id="saves less"),
        pytest.param(losses(0.0083, 11.017), losses(0.0182, 10.743), 1, "cheap", id="worth less"),
        pytest.param(losses(0.0083, 11.017), losses(0.0182, 10.743), 0, "cheap", id="cost alone"),
        pytest.param(losses(None, 100, 0.01), losses(None, 99, 0.04), 5, "exact", id="scores"),
        pytest.param(losses(0.1, 0), losses(0.1, 0), 5, "exact", id="no cost, no difference"),
    ],
)
def test_errors_are_weighed_against_the_cost(exact, cheap, spike_worth, taken):
    """The cheapest setting was taken, whatever it lost within a percent of the spikes."""
    assert weighed_best([exact, cheap], spike_worth) is {"exact": exact, "cheap": cheap}[taken]


def test_what_a_spike_is_worth_can_be_said(network):
    def taken(spike_worth):
        asked = SettingRequest(Setting("auto", weight_bits=8), spike_worth=spike_worth)
        return choose_strategy(network, CHIP, asked, played(network))

    exact, cheap = taken(1e6), taken(0.0)
    kept = [candidate for candidate in cheap.candidates if candidate.keeps(cheap.budget)]
    assert exact.taken.spike_error == min(candidate.spike_error for candidate in kept)
    assert cheap.taken.energy_pj == min(candidate.energy_pj for candidate in kept)
    assert (exact.spike_worth, cheap.spike_worth) == (1e6, 0.0)


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
    assert choice.taken == min(
        (c for c in choice.candidates if c.keeps(budget)), key=lambda candidate: candidate.energy_pj
    )


def test_fewer_bits_are_tried_down_to_the_fewest(network, monkeypatch):
    """Losses may rise and fall with the bits: the search ended at the first number that does not keep the budget."""
    budget, found = ErrorBudget(max_spike_error=0.9), Candidate.keeps
    monkeypatch.setattr(
        Candidate,
        "keeps",
        lambda self, bounds: self.setting.weight_bits != 6 and found(self, bounds),
    )
    asked = SettingRequest(Setting("reset", weight_bits=8), budget=budget)
    choice = choose_strategy(network, CHIP, asked, played(network))
    assert [candidate.setting.weight_bits for candidate in choice.candidates] == [
        8,
        6,
        5,
        4,
        3,
        2,
        1,
    ]
    assert choice.taken.setting.weight_bits < 6


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
class Roomy(Setting):
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
def test_a_row_says_how_auto_varies_its_dial(network, monkeypatch, search, given, tried):
    """No setting keeps the bounds here, so whatever the row allows is tried."""
    monkeypatch.setattr(rows, "DIALS", (*DIALS, replace(HEADROOM, search=search)))
    asked = SettingRequest(
        Roomy("reset", 8), frozenset({"split_weights", *given}), ErrorBudget(max_spike_error=0.0)
    )
    choice = choose_strategy(network, CHIP, asked, played(network))
    assert {candidate.setting.headroom for candidate in choice.candidates} == tried


def test_a_row_says_what_costs_less_once_bounds_are_kept(network, monkeypatch):
    search = Search(coarser=lambda chip, value: [2 * value, 4 * value])
    monkeypatch.setattr(rows, "DIALS", (*DIALS, replace(HEADROOM, search=search)))
    asked = SettingRequest(Roomy("reset", 1), budget=ErrorBudget(max_spike_error=1.0))
    choice = choose_strategy(network, CHIP, asked, played(network))
    assert [candidate.setting.headroom for candidate in choice.candidates] == [16.0, 32.0, 64.0]


@pytest.mark.slow
def test_dendrites_are_paired_where_no_other_strategy_keeps_the_budget(network):
    def choose(bound):
        budget = ErrorBudget(max_spike_error=bound)
        asked = SettingRequest(Setting("auto", weight_bits=2), budget=budget)
        return choose_strategy(network, CHIP, asked, played(network))

    usual = min(c.spike_error for c in choose(0.0).candidates if c.strategy != PAIRED)
    choice = choose(usual - 1e-6)
    assert choice.keeps_budget
    assert choice.taken.strategy == choice.levels.quantized.strategy == PAIRED
    assert choice.taken.energy_pj > max(
        c.energy_pj for c in choice.candidates if c.strategy != PAIRED
    )
    assert PAIRED not in {c.strategy for c in choose(usual).candidates}


@pytest.mark.slow
def test_where_nothing_keeps_the_budget_the_most_accurate_is_taken(choose):
    choice = choose(ErrorBudget(max_spike_error=0.0))
    best = max(choice.candidates, key=lambda c: (c.prediction_agreement, -c.spike_error))
    assert choice.taken == best


def test_a_strategy_that_the_chip_cannot_hold_is_passed_over(network):
    slow = replace(NEURON, tau_ref=40.0)
    patient = replace(
        network, populations=tuple(replace(p, neuron=slow) for p in network.populations)
    )
    asked = SettingRequest(Setting("auto", weight_bits=8))
    choice = choose_strategy(patient, CHIP, asked, played(patient))
    assert [candidate.strategy for candidate in choice.candidates] == ["dendrite", "reset"]


def test_where_none_fits_the_first_error_is_the_answer(choose):
    small = replace(CHIP, limits=replace(CHIP.limits, compartments_per_core=0))
    with pytest.raises(TargetError) as caught:
        choose(ErrorBudget(), small)
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
    ("bound", "bits", "taken", "kept"),
    [
        (0.0, 8, "native, 8-bit, 100% split", True),
        (0.1, 8, "native, 4-bit", True),
        (0.1, 2, "native, 2-bit, 25% split", False),
    ],
    ids=["split weights", "fewer bits", "not kept"],
)
def test_a_budget_holds_for_neurons_that_no_strategy_lowers(bound, bits, taken, kept):
    weights = np.random.default_rng(1).normal(0, 0.3, (6, 8))
    network = single(Cuba.of(6, decay_v=0.1, threshold=1.0), weights, steps=60)
    events, budget = recordings(network, samples=5), ErrorBudget(max_spike_error=bound)
    compiled = lc.compile(network, weight_bits=bits, events=events, budget=budget, diagnosis=False)
    choice, report = compiled.choice, compiled.report
    assert (str(choice.taken.setting), choice.keeps_budget) == (taken, kept)
    assert (1 - report["match"]["spike_agreement"] <= bound) == kept
    assert report["strategy_choice"]["taken"] == report["strategy"] == "native"
    assert [said for said in report["assumptions"] if "settings suit these" in said]
    assert lc.compile(network, events=events, diagnosis=False).choice is None
    with pytest.raises(InputError) as caught:
        lc.compile(network, strategy="dendrite", events=events, budget=budget, diagnosis=False)
    assert str(caught.value) == (
        "strategy 'dendrite': no neuron of this model uses it (its neurons are native). Leave the strategy out."
    )


def test_the_report_says_what_was_compared(network):
    compiled = lc.compile(network, events=recordings(network, samples=4), diagnosis=False)
    found = compiled.report["strategy_choice"]
    assert found["taken"] == compiled.report["strategy"] == compiled.choice.taken.strategy
    assert found["calibration_samples"] == 4
    assert [row["strategy"] for row in found["candidates"]] == ["dendrite", "delay-line", "reset"]
    assert {row["strategy"]: row["within_budget"] for row in found["candidates"]}["dendrite"]


@pytest.mark.slow
def test_what_chooses_is_not_what_reports():
    """A model that carries recordings, or whose input is a fingertip's, compiles to one program whatever is played."""
    network = hybrid(2, channels=78, steps=30, sensor=neutouch())
    first, second = (
        lc.compile(network, events=recordings(network, samples=2, seed=seed), diagnosis=False)
        for seed in (0, 1)
    )
    assert first.choice.source == second.choice.source == "synthetic touches"
    assert first.choice.candidates == second.choice.candidates
    own = lc.compile(
        replace(network, recordings=played(network)), events=recordings(network), diagnosis=False
    )
    assert own.choice.source == "made up"
    given = lc.compile(
        network,
        events=recordings(network),
        calibration=recordings(network, samples=3),
        diagnosis=False,
    )
    assert (given.choice.source, given.choice.samples) == ("array", 3)


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
    ids=["unknown", "laid out otherwise"],
)
def test_strategies_that_cannot_be(make, strategy, message):
    network = make()
    with pytest.raises(InputError) as caught:
        lc.compile(
            network,
            strategy=strategy,
            events=np.zeros((1, network.steps, network.channels), dtype=np.uint8),
        )
    assert str(caught.value) == message


@pytest.mark.parametrize(
    ("losses", "bounds", "said"),
    [
        pytest.param((0.5, 0.9, 0.25), ErrorBudget(min_agreement=0.9), "the best of 1 is reset, 4-bit, with 50.0 % of the predictions changed, 10.0 % of the spikes different and class scores off by 25.0 % of their spread. Train for the chip with locsnn train --target, or allow more.", id="all compared"),
        pytest.param((None, 0.9, None), ErrorBudget(min_agreement=0.9), "the best of 1 is reset, 4-bit, with an unknown share of the predictions changed, 10.0 % of the spikes different and class scores off by an unknown share of their spread. Give --calibration recordings in which outputs spike.", id="scores tie"),
        pytest.param((None, None, None), ErrorBudget(min_agreement=0.9), "the best of 1 is reset, 4-bit, with an unknown share of the predictions changed, an unknown share of the spikes different and class scores off by an unknown share of their spread. Give --calibration recordings in which outputs spike.", id="silent"),
    ],
)  # fmt: skip
def test_a_budget_that_no_setting_keeps_is_said_with_a_way_out(losses, bounds, said):
    best = Candidate(*losses, None, 1.0, Setting("reset", weight_bits=4))
    choice = Choice(best, None, (best,), bounds, 2, "a.npz")
    assert (
        unmet_budget(choice)
        == f"no setting keeps --min-agreement 0.9 on 2 recordings of a.npz: {said}"
    )
