"""Counting agreement, and the first divergence."""

from dataclasses import replace

import numpy as np
import pytest

import hw_model as hw
from locsnn_compile.baselines.operations import network_additions
from locsnn_compile.data.recordings import BATCH
from locsnn_compile.errors import InputError
from locsnn_compile.pipeline import lower
from locsnn_compile.reference.evaluate import evaluate
from locsnn_compile.verification.matching import PopulationMatch, ScoreMatch, compare
from locsnn_compile.verification.observation import Observed
from tests.support.networks import NEURON, hybrid, recordings, single

CHIP = hw.chip("loihi-sim")


@pytest.fixture(scope="module")
def network():
    """A small hybrid whose weights of 20 make many spikes."""
    return hybrid(1, steps=40, hidden=6, scale=20.0)


@pytest.fixture(scope="module")
def levels(network):
    """It at every level, with weights of 3 bits: spikes differ from the float network's."""
    return lower(network, CHIP, weight_bits=3)


@pytest.mark.parametrize(
    ("match", "agreement", "mismatches"),
    [
        (PopulationMatch(reference_spikes=0, chip_spikes=0, common_spikes=0), None, 0),
        (PopulationMatch(reference_spikes=4, chip_spikes=4, common_spikes=4), 1.0, 0),
        (PopulationMatch(reference_spikes=4, chip_spikes=2, common_spikes=2), 2 / 3, 2),
        (PopulationMatch(reference_spikes=3, chip_spikes=0, common_spikes=0), 0.0, 3),
    ],
    ids=["silence", "equal", "two missing", "all missing"],
)
def test_agreement(match, agreement, mismatches):
    assert (match.agreement, match.mismatches) == (
        agreement and pytest.approx(agreement),
        mismatches,
    )


def test_spikes_in_common_are_the_fewer_where_a_neuron_sends_several_in_a_step():
    reference = np.array([[[1, 0, 1, 2]]], np.uint8)
    chip = np.array([[[2, 3, 0, 2]]], np.uint8)
    assert PopulationMatch.of(reference, chip) == PopulationMatch(
        reference_spikes=4, chip_spikes=7, common_spikes=3
    )


@pytest.mark.parametrize(
    ("reference", "chip", "relative", "spread", "error"),
    [
        ([[1, 3], [5, 5]], [[1, 3], [5, 5]], 0.0, 0.5, 0.0),
        ([[1, 3], [5, 5]], [[1, 2], [6, 5]], 1.0, 0.5, 0.5),
        ([[1, 3], [0, 4]], [[2, 2], [0, 4]], 1 / 3, 1.5, 0.5),
        ([[5, 5]], [[5, 5]], None, 0.0, 0.0),
        ([[5, 5]], [[5, 8]], None, 0.0, 1.5),
    ],
    ids=["equal", "same class", "a tie", "nothing to compare", "only the chip decides"],
)
def test_scores_are_compared_with_their_spread(reference, chip, relative, spread, error):
    found = ScoreMatch.of(np.array(reference, float), np.array(chip, float))
    assert found.relative_error == (relative and pytest.approx(relative))
    assert (found.mean_spread, found.mean_error) == (spread, error)


def predicted(scores):
    """The class with the highest score, -1 where all tie."""
    return [int(np.argmax(row)) if len(set(row.tolist())) > 1 else -1 for row in scores]


def test_a_match_is_what_counting_by_hand_gives(network, levels):
    played = recordings(network, samples=BATCH + 3)
    match = compare(Observed(levels, played))
    wanted, found = evaluate(network, played), hw.simulate(levels.program, played)
    for name, counted in match.by_population.items():
        both = (wanted.spikes[name] == 1) & (found.spikes[name] == 1)
        assert counted == PopulationMatch(
            int(wanted.spikes[name].sum()), int(found.spikes[name].sum()), int(both.sum())
        )
    assert match.spikes.mismatches > 0
    assert match.chip_prediction.tolist() == predicted(found.scores)
    assert match.reference_prediction.tolist() == predicted(wanted.scores)
    assert -1 in match.chip_prediction
    assert match.counts == found.per_recording
    assert match.accuracy is None
    apart = np.abs(found.scores - wanted.scores)
    assert match.scores.mean_error == pytest.approx(apart.mean())
    assert match.scores.mean_spread == pytest.approx(
        np.abs(wanted.scores - wanted.scores.mean(axis=1, keepdims=True)).mean()
    )


def test_the_first_divergence_is_the_first(network, levels):
    played = recordings(network, samples=5)
    first = compare(Observed(levels, played)).first_divergence
    wanted, found = (
        evaluate(network, played, potentials=True),
        hw.simulate(levels.program, played, probe=("spikes", "potential")),
    )
    axis = {p.name: p.axis for p in network.populations}
    rows = [
        (recording, axis[name] == "location", step, rank, neuron)
        for rank, name in enumerate(axis)
        for recording, step, neuron in np.argwhere(wanted.spikes[name] != found.spikes[name])
    ]
    recording, _, step, rank, neuron = min(rows)
    name = list(axis)[rank]
    assert (first.recording, first.population, first.step, first.neuron) == (
        recording,
        name,
        step,
        neuron,
    )
    assert first.reference_potential == wanted.potential[name][recording, step, neuron]
    chip = (
        found.potential[name][recording, step, neuron]
        / levels.quantized.population(name).scale[neuron]
    )
    assert first.chip_potential == pytest.approx(chip)
    assert (first.reference_potential >= first.threshold) != (
        first.chip_potential >= first.threshold
    )


def test_what_chunks_of_recordings_add_up_to():
    """Two chunks and a part of one, with registers that clip in all of them."""
    network = hybrid(1, steps=40, hidden=6, scale=4000.0)
    levels = lower(network, CHIP, weight_bits=3)
    played = recordings(network, samples=2 * BATCH + 3)
    match = compare(Observed(levels, played))
    found = hw.simulate(levels.program, played, probe=("spikes", "activity"))
    assert match.wraps_and_clips == found.events
    assert all(counts.voltage_clips for counts in found.per_recording)
    assert match.counts_by_phase == found.counts_by_phase
    assert match.additions == network_additions(network, evaluate(network, played).spikes)
    alone = [compare(Observed(levels, one[None])).latency_range_ns for one in played]
    least, most = zip(*alone, strict=True)
    assert match.latency_range_ns == (
        None if None in least else pytest.approx(np.mean(least)),
        None if None in most else pytest.approx(np.mean(most)),
    )


def test_a_first_divergence_behind_the_first_chunk(network, levels):
    played = np.concatenate(
        (np.zeros((BATCH + 2, 40, 4), dtype=np.uint8), recordings(network, samples=1))
    )
    assert compare(Observed(levels, played)).first_divergence.recording == BATCH + 2


def test_the_time_axis_comes_first(network, levels):
    """Of the recordings in which the location branch differs at an earlier step of its own."""
    played = recordings(network, samples=30)
    wanted, found = evaluate(network, played).spikes, hw.simulate(levels.program, played).spikes
    first = {
        axis: [
            min((int(np.argwhere(a != b)[0, 0]) for a, b in pairs if (a != b).any()), default=99)
            for pairs in (
                [
                    (wanted[p.name][i], found[p.name][i])
                    for p in network.populations
                    if p.axis == axis
                ]
                for i in range(len(played))
            )
        ]
        for axis in (phase.name for phase in network.phases)
    }
    tried = [i for i in range(len(played)) if first["location"][i] < first["time"][i] < 99]
    assert tried
    for i in tried:
        divergence = compare(Observed(levels, played[i : i + 1])).first_divergence
        assert divergence.population.startswith("time")
        assert divergence.step == first["time"][i]


def test_equal_spikes_have_no_divergence(network, levels):
    silent = np.zeros((2, network.steps, network.channels), dtype=np.uint8)
    match = compare(Observed(levels, silent))
    assert match.first_divergence is None
    assert (match.spikes.agreement, match.prediction_agreement, match.tied_predictions) == (
        None,
        None,
        2,
    )


@pytest.mark.parametrize(
    ("reference", "chip", "agreement", "tied"),
    [
        ([0, 1, 1, 0], [0, 1, 0, 0], 0.75, 0),
        ([0, -1, -1, 0], [0, -1, -1, 1], 0.5, 2),
        ([0, 1, -1, -1], [0, -1, 0, -1], 1 / 3, 1),
        ([-1, -1], [-1, -1], None, 2),
        ([-1, -1], [0, 1], 0.0, 0),
    ],
    ids=[
        "none tied",
        "tied on both sides",
        "tied on one side only",
        "all tied",
        "the chip alone predicts",
    ],
)
def test_ties(network, levels, reference, chip, agreement, tied):
    match = compare(Observed(levels, recordings(network, samples=1)))
    sides = {"reference_prediction": np.array(reference), "chip_prediction": np.array(chip)}
    match = replace(match, samples=len(chip), labels=np.zeros(len(chip), dtype=np.int64), **sides)
    assert (match.prediction_agreement, match.tied_predictions) == (
        agreement and pytest.approx(agreement),
        tied,
    )
    assert match.accuracy == {
        "reference": np.mean(np.array(reference) == 0),
        "chip": np.mean(np.array(chip) == 0),
    }


def with_network(levels, network):
    return replace(levels, network=network, quantized=replace(levels.quantized, network=network))


def test_helper_neurons_are_counted_apart(network, levels):
    played = recordings(network, samples=4)
    first = network.populations[0]
    helped = replace(network, populations=(replace(first, helper=True), *network.populations[1:]))
    plain, found = (
        compare(Observed(with_network(levels, net), played)) for net in (network, helped)
    )
    assert found.helpers == {first.name: plain.by_population[first.name]}
    assert found.helpers | found.by_population == plain.by_population
    assert plain.first_divergence.population == first.name != found.first_divergence.population
    assert (
        found.spikes.mismatches
        == plain.spikes.mismatches - plain.by_population[first.name].mismatches
    )


def test_a_short_recording_is_followed_by_silence(network, levels):
    played = recordings(network, samples=2)
    played[:, 25:] = 0
    whole, short = (
        compare(Observed(levels, network.fit(p, "array"))) for p in (played, played[:, :25])
    )
    assert whole.by_population == short.by_population


@pytest.mark.parametrize(
    ("shape", "message"),
    [
        ((2, 40, 5), "events 'array': the channel count differs from the model's (5 channels against 4). Give recordings of 4 channels."),
        ((2, 41, 4), "events 'array': the recordings are longer than the model's (41 steps against 40). Cut them to 40 steps."),
    ],
    ids=["channels", "steps"],
)  # fmt: skip
def test_recordings_that_do_not_fit(levels, shape, message):
    with pytest.raises(InputError) as caught:
        levels.network.fit(np.zeros(shape, dtype=np.uint8), "array")
    assert str(caught.value) == message


@pytest.mark.parametrize("steps", [5, 30], ids=["shorter", "longer"])
def test_a_network_of_any_length_takes_recordings_as_they_are(steps):
    endless, given = (
        replace(single(NEURON, steps=20), any_length=True),
        np.ones((2, steps, 1), dtype=np.uint8),
    )
    assert endless.fit(given, "array") is given


def test_a_network_of_any_length_walks_the_sensor_to_the_end_of_its_silence():
    given = hybrid(1, steps=40, hidden=6, scale=20.0)
    views = tuple(replace(view, silence=3 * (view.walk is not None)) for view in given.views)
    endless = replace(given, views=views, any_length=True)
    levels, played = lower(endless, CHIP, weight_bits=3), recordings(endless)[:, :25]
    walked = [phase.steps for phase in levels.program.phases]
    assert walked == [None, endless.steps_of("location")] == [None, given.steps_of("location") + 3]
    assert compare(Observed(levels, played)).samples == len(played)


@pytest.mark.parametrize(
    ("labels", "message"),
    [
        ([0], "labels of 'array': there is not one label per recording ((1,) against (2,)). Give one class number for every recording."),
        ([0, 2], "labels of 'array': a label is not one of the model's classes (0..2 against 0..1). Check that the events belong to this model."),
        ([-1, 0], "labels of 'array': a label is not one of the model's classes (-1..0 against 0..1). Check that the events belong to this model."),
    ],
    ids=["count", "class", "below 0"],
)  # fmt: skip
def test_labels_that_do_not_fit(network, levels, labels, message):
    with pytest.raises(InputError) as caught:
        Observed(levels, recordings(network, samples=2), np.array(labels))
    assert str(caught.value) == message


def test_accuracy_counts_both_sides(network, levels):
    played = recordings(network, samples=6)
    match = compare(Observed(levels, played, np.array([0, 1, 0, 1, 0, 1])))
    assert match.tied_predictions < 6
    again = replace(match, labels=match.chip_prediction)
    assert again.accuracy["chip"] == 1.0
    assert again.accuracy["reference"] == np.mean(
        match.reference_prediction == match.chip_prediction
    )
