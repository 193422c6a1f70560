"""Predictions over time, and savings, of small compiled networks: against formulas of their own."""

import json
from dataclasses import replace

import numpy as np
import pytest

import hw_model as hw
import locsnn_compile as lc
from locsnn_compile.pipeline import lower
from locsnn_compile.report.compose import compose
from locsnn_compile.report.renderers.markdown import render_markdown
from locsnn_compile.verification import over_time as module
from locsnn_compile.verification.observation import Observed
from locsnn_compile.verification.over_time import over_time, stop_all
from locsnn_compile.verification.savings import savings
from tests.support.networks import NEURON, hybrid, recordings, single

CHIP = hw.chip("loihi-sim")


@pytest.fixture(scope="module")
def levels():
    """A small hybrid of three classes at every level."""
    return lower(
        hybrid(seed=3, channels=6, steps=20, hidden=8, classes=3, scale=12.0), CHIP, weight_bits=8
    )


@pytest.fixture(scope="module")
def played(levels):
    """Nine random recordings."""
    return recordings(levels.network, samples=9)


def counts_after(program, recording, step):
    """Spikes of both branches after a step, by a simulation of what was recorded until then."""
    until = recording * (np.arange(len(recording)) < step)[:, None].astype(np.uint8)
    found = hw.simulate(program, until).spikes
    return found["time_output"][:step].sum(axis=0), found["location_output"].sum(
        axis=0, dtype=np.int64
    )


def predicted(scores):
    """The class with the highest score, -1 where all tie."""
    return int(np.argmax(scores)) if len(set(scores.tolist())) > 1 else -1


@pytest.mark.slow
@pytest.mark.parametrize("labelled", [True, False], ids=["labels", "no labels"])
@pytest.mark.parametrize("psi", [10.0, 2.0])
def test_shares_of_right_predictions(levels, played, labelled, psi):
    labels = np.array([0, 1, 2] * 3) if labelled else None
    found = over_time(Observed(levels, played, labels), psi)
    final = np.array([predicted(scores) for scores in hw.simulate(levels.program, played).scores])
    assert set(final) > {-1}
    wanted = labels if labelled else final
    counted = [i for i in range(9) if labelled or final[i] >= 0]
    assert (found.recordings, found.available, found.labelled, found.psi) == (
        tuple(range(9)),
        9,
        labelled,
        psi,
    )
    for step in (1, 7, 13, 20):
        w = 1 / (1 + np.exp(-psi * (step / 20 - 1)))
        right = dict.fromkeys(("time", "location", "together", "time_weighted"), 0)
        for recording, label in zip(played[counted], wanted[counted], strict=True):
            a, b = counts_after(levels.program, recording, step)
            for name, scores in (
                ("time", a),
                ("location", b),
                ("together", a + b),
                ("time_weighted", (1 - w) * a + w * b),
            ):
                right[name] += predicted(scores) == label
        assert {
            name: round(len(counted) * shares[step - 1]) for name, shares in found.right.items()
        } == right
    assert np.array_equal(found.proven.prediction, np.maximum(final, 0))
    if not labelled:
        assert found.right["together"][-1] == 1.0


def test_one_branch_has_one_prediction():
    network = single(NEURON, weights=((8.0,), (4.0,)), steps=30)
    found = over_time(Observed(lower(network, CHIP, weight_bits=8), recordings(network, samples=4)))
    assert list(found.right) == ["together"]


def test_a_sample_is_spread_over_all(levels):
    many = recordings(levels.network, samples=200)
    found = over_time(Observed(levels, many))
    assert (len(found.recordings), found.recordings[0], found.recordings[-1]) == (64, 0, 199)
    assert len(found.proven.steps) == 64


def test_a_network_too_large_is_left_out(levels, played, monkeypatch):
    """Work grows with what the location branch would take if it ran whole after every step."""
    work = 20 * (8 + 3) + 20 * 6 * (8 + 3)
    monkeypatch.setattr(module, "WORK", 3 * work + 1)
    assert over_time(Observed(levels, played)).recordings == (0, 4, 8)
    monkeypatch.setattr(module, "WORK", work - 1)
    assert over_time(Observed(levels, played)) == (
        "the network is too large to be followed step by step within seconds"
    )


def test_fewer_recordings_of_a_large_network_are_followed(levels, monkeypatch):
    """As many as are quick, but no fewer than say something."""
    many, work = recordings(levels.network, samples=60), 20 * (8 + 3) + 20 * 6 * (8 + 3)
    monkeypatch.setattr(module, "QUICK", 40 * work)
    assert len(over_time(Observed(levels, many)).recordings) == 40
    monkeypatch.setattr(module, "QUICK", 3 * work)
    assert len(over_time(Observed(levels, many)).recordings) == module.AT_LEAST


def test_recordings_that_nothing_is_predicted_of_are_left_out(levels, played):
    silent = np.zeros_like(played)
    assert (
        over_time(Observed(levels, silent))
        == "all class scores tie after the last step of every recording"
    )
    labelled = over_time(Observed(levels, silent, np.zeros(9, dtype=np.int64)))
    assert {name: shares.tolist() for name, shares in labelled.right.items()} == {
        name: [0.0] * 20 for name in ("time", "location", "together", "time_weighted")
    }


def test_a_program_that_cannot_stream_is_left_out(levels, played):
    program = levels.program
    item = program.inputs_of("location")[0]
    beside = replace(item, name="beside", positions=None)
    route = replace(program.route_of(item.name), input="beside")
    mixed = replace(
        program, inputs=(*program.inputs, beside), input_routes=(*program.input_routes, route)
    )
    assert over_time(Observed(replace(levels, program=mixed), played)) == (
        "phase 'location' mixes transposed inputs with inputs that are played as they come, so it cannot run as they arrive"
    )


def test_savings_are_means(levels, played):
    stops = hw.stop_when_proven(levels.program, played)
    found = savings(levels.program, stops)
    whole = hw.simulate(levels.program, played).counts
    profile = levels.program.chip.profile("davies2018")
    assert found.profile == "davies2018"
    assert found.steps == stops.steps.mean() < found.all_steps == 26
    assert found.all_synaptic_ops == whole.synaptic_ops / 9 > found.synaptic_ops
    assert found.all_energy_pj == pytest.approx(sum(hw.energy_pj(whole, profile).values()) / 9)
    assert found.energy_pj < found.all_energy_pj


@pytest.mark.slow
@pytest.mark.parametrize("chunk", [1, 4, 9, 100])
def test_stops_by_chunks_are_those_of_all(levels, played, chunk):
    done = []
    found = stop_all(
        lambda part: hw.stop_at_margin(levels.program, part, 2.0),
        played,
        lambda *at: done.append(at),
        chunk,
    )
    wanted = hw.stop_at_margin(levels.program, played, 2.0)
    assert np.array_equal(found.steps, wanted.steps)
    assert np.array_equal(found.prediction, wanted.prediction)
    assert np.array_equal(found.final, wanted.final)
    assert (found.counts, found.all_counts, found.all_steps) == (
        wanted.counts,
        wanted.all_counts,
        wanted.all_steps,
    )
    assert done[-1] == (9, 9)


def test_the_report_has_it_unless_told_not_to(levels, played):
    compiled = lc.compile(
        levels.network, events=played, labels=[0, 1, 2] * 3, strategy="dendrite", psi=15.0
    )
    entry = compiled.report["over_time"]
    assert (entry["right_is"], entry["psi"], entry["step_seconds"]) == ("the label", 15.0, 0.02)
    assert entry["steps"] == list(range(1, 21))
    assert entry["right"]["together"][-1] == compiled.report["accuracy"]["chip"]
    assert entry["proven_stop"]["all_energy_pj"] == pytest.approx(
        compiled.report["energy"]["per_sample_pj"]
    )
    assert "## Over time" in render_markdown(compose(compiled.figures))
    json.dumps(compiled.report, allow_nan=False)
    bare = lc.compile(levels.network, events=played, strategy="dendrite", diagnosis=False).report
    assert "over_time" not in bare


def test_long_recordings_keep_some_steps(levels):
    network = hybrid(3, channels=3, steps=130, classes=2, scale=20.0)
    entry = lc.compile(network, events=recordings(network), strategy="dendrite").report["over_time"]
    assert (len(entry["steps"]), entry["steps"][0], entry["steps"][9], entry["steps"][-1]) == (
        50,
        3,
        26,
        130,
    )
    assert all(len(values) == 50 for values in entry["right"].values())


def test_a_psi_below_zero_is_refused(levels, played):
    with pytest.raises(lc.InputError) as caught:
        over_time(Observed(levels, played), -1.0)
    assert (
        str(caught.value) == "psi: it is not a valid rate (got -1.0). Give 0 or more, such as 10."
    )
