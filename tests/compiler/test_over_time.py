"""Predictions after every step of a recording, and what early stops save, against simulations of cut recordings.

A hybrid predicts by the time branch, the location branch, both together, and ``time_weighted``: the location branch with
a share that grows over time at the rate psi.
"""

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
    """The compiled levels of a small hybrid of six channels, 20 steps, and three classes."""
    return lower(
        hybrid(seed=3, channels=6, steps=20, hidden=8, classes=3, scale=12.0), CHIP, weight_bits=8
    )


@pytest.fixture(scope="module")
def played(levels):
    """Nine random recordings."""
    return recordings(levels.network, samples=9)


def counts_after(program, recording, step):
    """Return the spikes of both branches by class after a step, from a run of the recording up to that step."""
    cut = recording * (np.arange(len(recording)) < step)[:, None].astype(np.uint8)
    spikes = hw.simulate(program, cut).spikes
    of_time = spikes["time_output"][:step].sum(axis=0)
    of_location = spikes["location_output"].sum(axis=0, dtype=np.int64)
    return of_time, of_location


def predicted(scores):
    """Return the class with the highest score, -1 if all scores tie."""
    all_tie = len(set(scores.tolist())) == 1
    return -1 if all_tie else int(np.argmax(scores))


def shares_right(program, recordings, labels, step, psi):
    """Return how many predictions after a step are equal to the labels, by the way to predict."""
    last_step = 20
    location_share = 1 / (1 + np.exp(-psi * (step / last_step - 1)))
    right = dict.fromkeys(("time", "location", "together", "time_weighted"), 0)
    for recording, label in zip(recordings, labels, strict=True):
        time, location = counts_after(program, recording, step)
        weighted = (1 - location_share) * time + location_share * location
        right["time"] += predicted(time) == label
        right["location"] += predicted(location) == label
        right["together"] += predicted(time + location) == label
        right["time_weighted"] += predicted(weighted) == label
    return right


@pytest.mark.slow
@pytest.mark.parametrize("labelled", [True, False], ids=["labels", "no labels"])
@pytest.mark.parametrize("psi", [10.0, 2.0])
def test_shares_of_right_predictions_are_those_of_cut_recordings(levels, played, labelled, psi):
    """Right is the label or, without labels, the prediction after the last step, unless all scores tie then."""
    labels = np.array([0, 1, 2] * 3) if labelled else None
    predictions = over_time(Observed(levels, played, labels), psi)
    final = np.array([predicted(scores) for scores in hw.simulate(levels.program, played).scores])
    assert set(final) > {-1}
    right_classes = labels if labelled else final
    counted = np.flatnonzero(right_classes >= 0)
    assert predictions.recordings == tuple(range(9))
    assert predictions.available == 9
    assert predictions.labelled == labelled
    assert predictions.psi == psi
    for step in (1, 7, 13, 20):
        expected = shares_right(levels.program, played[counted], right_classes[counted], step, psi)
        right = {
            name: round(len(counted) * shares[step - 1])
            for name, shares in predictions.right.items()
        }
        assert right == expected
    # An early stop predicts the first class where all scores tie.
    assert np.array_equal(predictions.proven.prediction, np.maximum(final, 0))
    if not labelled:
        assert predictions.right["together"][-1] == 1.0


def test_a_network_of_one_branch_has_one_prediction():
    network = single(NEURON, weights=((8.0,), (4.0,)), steps=30)
    levels = lower(network, CHIP, weight_bits=8)
    predictions = over_time(Observed(levels, recordings(network, samples=4)))
    assert list(predictions.right) == ["together"]


def test_of_many_recordings_64_are_followed_from_the_first_to_the_last(levels):
    many = recordings(levels.network, samples=200)
    predictions = over_time(Observed(levels, many))
    assert len(predictions.recordings) == 64
    assert predictions.recordings[0] == 0
    assert predictions.recordings[-1] == 199
    assert len(predictions.proven.steps) == 64


WORK_OF_RECORDING = 20 * (8 + 3) + 20 * 6 * (8 + 3)
"""Updates of neurons per recording: 8 hidden neurons and 3 outputs in 20 steps of the time branch, and in the 6 steps of
the location branch, which is run again after each of the 20 steps."""


def test_a_network_too_large_is_left_out(levels, played, monkeypatch):
    monkeypatch.setattr(module, "WORK", 3 * WORK_OF_RECORDING + 1)
    assert over_time(Observed(levels, played)).recordings == (0, 4, 8)
    monkeypatch.setattr(module, "WORK", WORK_OF_RECORDING - 1)
    assert over_time(Observed(levels, played)) == (
        "the network is too large to be followed step by step within seconds"
    )


def test_fewer_recordings_of_a_large_network_are_followed(levels, monkeypatch):
    """As many as take little time, but no fewer than ``AT_LEAST``, from which shares are meaningful."""
    many = recordings(levels.network, samples=60)
    monkeypatch.setattr(module, "QUICK", 40 * WORK_OF_RECORDING)
    assert len(over_time(Observed(levels, many)).recordings) == 40
    monkeypatch.setattr(module, "QUICK", 3 * WORK_OF_RECORDING)
    assert len(over_time(Observed(levels, many)).recordings) == module.AT_LEAST


def test_without_labels_recordings_whose_scores_tie_are_left_out(levels, played):
    silent = np.zeros_like(played)
    reason = over_time(Observed(levels, silent))
    assert reason == "all class scores tie after the last step of every recording"
    labelled = over_time(Observed(levels, silent, np.zeros(9, dtype=np.int64)))
    assert set(labelled.right) == {"time", "location", "together", "time_weighted"}
    for shares in labelled.right.values():
        assert shares.tolist() == [0.0] * 20


def test_a_program_that_cannot_stream_is_left_out(levels, played):
    program = levels.program
    transposed = program.inputs_of("location")[0]
    direct = replace(transposed, name="direct", positions=None)
    route = replace(program.route_of(transposed.name), input="direct")
    mixed = replace(
        program, inputs=(*program.inputs, direct), input_routes=(*program.input_routes, route)
    )
    assert over_time(Observed(replace(levels, program=mixed), played)) == (
        "phase 'location' mixes transposed inputs with inputs that are played as they come, "
        "so it cannot run as they arrive"
    )


def test_savings_are_means_over_recordings(levels, played):
    stops = hw.stop_when_proven(levels.program, played)
    saved = savings(levels.program, stops)
    whole = hw.simulate(levels.program, played).counts
    profile = levels.program.chip.profile("davies2018")
    energy_pj = sum(hw.energy_pj(whole, profile).values())
    assert saved.profile == "davies2018"
    assert saved.steps == stops.steps.mean()
    assert saved.all_steps == 20 + 6  # of the time and of the location phase
    assert saved.steps < saved.all_steps
    assert saved.all_synaptic_ops == whole.synaptic_ops / len(played)
    assert saved.synaptic_ops < saved.all_synaptic_ops
    assert saved.all_energy_pj == pytest.approx(energy_pj / len(played))
    assert saved.energy_pj < saved.all_energy_pj


@pytest.mark.slow
@pytest.mark.parametrize("chunk", [1, 4, 9, 100])
def test_stops_of_chunks_of_recordings_are_those_of_all_at_once(levels, played, chunk):
    def stop(part):
        return hw.stop_at_margin(levels.program, part, 2.0)

    progress = []
    in_chunks = stop_all(stop, played, lambda done, total: progress.append((done, total)), chunk)
    at_once = stop(played)
    assert np.array_equal(in_chunks.steps, at_once.steps)
    assert np.array_equal(in_chunks.prediction, at_once.prediction)
    assert np.array_equal(in_chunks.final, at_once.final)
    assert in_chunks.counts == at_once.counts
    assert in_chunks.all_counts == at_once.all_counts
    assert in_chunks.all_steps == at_once.all_steps
    assert progress[-1] == (9, 9)


def test_the_report_has_predictions_over_time_unless_the_diagnosis_is_off(levels, played):
    compiled = lc.compile(
        levels.network, events=played, labels=[0, 1, 2] * 3, strategy="dendrite", psi=15.0
    )
    entry = compiled.report["over_time"]
    assert entry["right_is"] == "the label"
    assert entry["psi"] == 15.0
    assert entry["step_seconds"] == 0.02
    assert entry["steps"] == list(range(1, 21))
    assert entry["right"]["together"][-1] == compiled.report["accuracy"]["chip"]
    energy_pj = compiled.report["energy"]["per_sample_pj"]
    assert entry["proven_stop"]["all_energy_pj"] == pytest.approx(energy_pj)
    assert "## Over time" in render_markdown(compose(compiled.figures))
    json.dumps(compiled.report, allow_nan=False)
    plain = lc.compile(levels.network, events=played, strategy="dendrite", diagnosis=False).report
    assert "over_time" not in plain


def test_of_long_recordings_the_report_has_50_steps():
    """Of 130 steps they are the multiples of 2.6, rounded, up to the last step."""
    network = hybrid(3, channels=3, steps=130, classes=2, scale=20.0)
    entry = lc.compile(network, events=recordings(network), strategy="dendrite").report["over_time"]
    steps = entry["steps"]
    assert len(steps) == 50
    assert steps[0] == 3
    assert steps[9] == 26
    assert steps[-1] == 130
    assert all(len(shares) == 50 for shares in entry["right"].values())


def test_a_psi_below_zero_is_refused(levels, played):
    with pytest.raises(lc.InputError) as caught:
        over_time(Observed(levels, played), -1.0)
    assert (
        str(caught.value) == "psi: it is not a valid rate (got -1.0). Give 0 or more, such as 10."
    )
