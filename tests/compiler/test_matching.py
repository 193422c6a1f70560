"""Matching: how many spikes, predictions and scores of chip and float network agree, and where they differ first.

Counts are compared with those of whole runs, counted by hand. Recordings are played in chunks of ``BATCH``.
"""

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
    """The compiled levels of the network with weights of 3 bits, so that spikes differ from the float network's."""
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
def test_agreement_is_that_of_common_spikes(match, agreement, mismatches):
    """Twice the common spikes over the spikes of both sides; unknown where neither side spikes."""
    assert match.agreement == (agreement and pytest.approx(agreement))
    assert match.mismatches == mismatches


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
    """The spread is the mean distance of a recording's scores from their mean."""
    match = ScoreMatch.of(np.array(reference, float), np.array(chip, float))
    assert match.relative_error == (relative and pytest.approx(relative))
    assert match.mean_spread == spread
    assert match.mean_error == error


def predicted(scores):
    """Return the class with the highest score of each recording, -1 where all scores tie."""
    classes = []
    for row in scores:
        all_tie = len(set(row.tolist())) == 1
        classes.append(-1 if all_tie else int(np.argmax(row)))
    return classes


def test_a_match_is_what_counting_by_hand_gives(network, levels):
    played = recordings(network, samples=BATCH + 3)
    match = compare(Observed(levels, played))
    reference = evaluate(network, played)
    chip = hw.simulate(levels.program, played)
    for name, counted in match.by_population.items():
        common = (reference.spikes[name] == 1) & (chip.spikes[name] == 1)
        assert counted == PopulationMatch(
            reference_spikes=int(reference.spikes[name].sum()),
            chip_spikes=int(chip.spikes[name].sum()),
            common_spikes=int(common.sum()),
        )
    assert match.spikes.mismatches > 0
    assert match.chip_prediction.tolist() == predicted(chip.scores)
    assert match.reference_prediction.tolist() == predicted(reference.scores)
    assert -1 in match.chip_prediction
    assert match.counts == chip.per_recording
    assert match.accuracy is None
    error = np.abs(chip.scores - reference.scores)
    assert match.scores.mean_error == pytest.approx(error.mean())
    distance = np.abs(reference.scores - reference.scores.mean(axis=1, keepdims=True))
    assert match.scores.mean_spread == pytest.approx(distance.mean())


def test_the_first_divergence_comes_before_all_others(network, levels):
    """The order is by recording, then the time axis before the location axis, then step, population and neuron."""
    played = recordings(network, samples=5)
    first = compare(Observed(levels, played)).first_divergence
    reference = evaluate(network, played, potentials=True)
    chip = hw.simulate(levels.program, played, probe=("spikes", "potential"))
    differences = []
    for rank, population in enumerate(network.populations):
        differs = reference.spikes[population.name] != chip.spikes[population.name]
        on_location_axis = population.axis == "location"
        for recording, step, neuron in np.argwhere(differs):
            differences.append((recording, on_location_axis, step, rank, neuron))
    recording, _, step, rank, neuron = min(differences)
    name = network.populations[rank].name
    assert first.recording == recording
    assert first.population == name
    assert first.step == step
    assert first.neuron == neuron
    assert first.reference_potential == reference.potential[name][recording, step, neuron]
    scale = levels.quantized.population(name).scale[neuron]
    chip_potential = chip.potential[name][recording, step, neuron] / scale
    assert first.chip_potential == pytest.approx(chip_potential)
    reference_fires = first.reference_potential >= first.threshold
    chip_fires = first.chip_potential >= first.threshold
    assert reference_fires != chip_fires


def test_chunks_of_recordings_add_up_to_a_whole_run():
    """Two chunks and a part of one, with registers that clip in all of them."""
    network = hybrid(1, steps=40, hidden=6, scale=4000.0)
    levels = lower(network, CHIP, weight_bits=3)
    played = recordings(network, samples=2 * BATCH + 3)
    match = compare(Observed(levels, played))
    result = hw.simulate(levels.program, played, probe=("spikes", "activity"))
    assert match.wraps_and_clips == result.events
    assert all(counts.voltage_clips for counts in result.per_recording)
    assert match.counts_by_phase == result.counts_by_phase
    assert match.additions == network_additions(network, evaluate(network, played).spikes)
    ranges = [compare(Observed(levels, one[None])).latency_range_ns for one in played]
    for bound, bounds_of_recordings in zip(
        match.latency_range_ns, zip(*ranges, strict=True), strict=True
    ):
        # A bound that is unknown for one recording is unknown for all.
        if None in bounds_of_recordings:
            assert bound is None
        else:
            assert bound == pytest.approx(np.mean(bounds_of_recordings))


def test_a_first_divergence_after_the_first_chunk_has_its_recording(network, levels):
    silent = np.zeros((BATCH + 2, network.steps, network.channels), dtype=np.uint8)
    played = np.concatenate((silent, recordings(network, samples=1)))
    assert compare(Observed(levels, played)).first_divergence.recording == BATCH + 2


def test_the_time_axis_comes_first(network, levels):
    """Tested with recordings in which the location branch differs at an earlier step of its own axis."""
    played = recordings(network, samples=30)
    reference = evaluate(network, played).spikes
    chip = hw.simulate(levels.program, played).spikes
    never = 99  # after every step

    def first_step_that_differs(axis, recording):
        steps = [never]
        for population in network.populations:
            if population.axis == axis:
                name = population.name
                differs = reference[name][recording] != chip[name][recording]
                steps += np.flatnonzero(differs.any(axis=1)).tolist()
        return min(steps)

    tested = 0
    for recording in range(len(played)):
        location_step = first_step_that_differs("location", recording)
        time_step = first_step_that_differs("time", recording)
        if location_step < time_step < never:
            one_recording = played[recording : recording + 1]
            divergence = compare(Observed(levels, one_recording)).first_divergence
            assert divergence.population.startswith("time")
            assert divergence.step == time_step
            tested += 1
    assert tested > 0


def test_equal_spikes_have_no_divergence(network, levels):
    silent = np.zeros((2, network.steps, network.channels), dtype=np.uint8)
    match = compare(Observed(levels, silent))
    assert match.first_divergence is None
    assert match.spikes.agreement is None
    assert match.prediction_agreement is None
    assert match.tied_predictions == 2


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
def test_recordings_that_tie_on_both_sides_are_not_compared(
    network, levels, reference, chip, agreement, tied
):
    """A prediction of -1 stands for scores that all tie."""
    match = compare(Observed(levels, recordings(network, samples=1)))
    match = replace(
        match,
        samples=len(chip),
        labels=np.zeros(len(chip), dtype=np.int64),
        reference_prediction=np.array(reference),
        chip_prediction=np.array(chip),
    )
    assert match.prediction_agreement == (agreement and pytest.approx(agreement))
    assert match.tied_predictions == tied
    assert match.accuracy == {
        "reference": np.mean(np.array(reference) == 0),
        "chip": np.mean(np.array(chip) == 0),
    }


def test_helper_neurons_are_counted_separately(network, levels):
    """Helpers are neurons that the compiler added; they do not count as spikes of the network."""
    played = recordings(network, samples=4)
    first = network.populations[0]
    with_helper = replace(
        network, populations=(replace(first, helper=True), *network.populations[1:])
    )

    def match_as(network):
        quantized = replace(levels.quantized, network=network)
        return compare(Observed(replace(levels, network=network, quantized=quantized), played))

    plain = match_as(network)
    helped = match_as(with_helper)
    of_helper = plain.by_population[first.name]
    assert helped.helpers == {first.name: of_helper}
    assert helped.helpers | helped.by_population == plain.by_population
    assert plain.first_divergence.population == first.name
    assert helped.first_divergence.population != first.name
    assert helped.spikes.mismatches == plain.spikes.mismatches - of_helper.mismatches


def test_a_short_recording_is_followed_by_silence(network, levels):
    played = recordings(network, samples=2)
    played[:, 25:] = 0
    whole = compare(Observed(levels, network.fit(played, "array")))
    short = compare(Observed(levels, network.fit(played[:, :25], "array")))
    assert whole.by_population == short.by_population


@pytest.mark.parametrize(
    ("shape", "message"),
    [
        pytest.param(
            (2, 40, 5),
            "events 'array': the channel count differs from the model's (5 channels against 4). "
            "Give recordings of 4 channels.",
            id="channels",
        ),
        pytest.param(
            (2, 41, 4),
            "events 'array': the recordings are longer than the model's (41 steps against 40). "
            "Cut them to 40 steps.",
            id="steps",
        ),
    ],
)
def test_recordings_that_do_not_fit_are_refused(levels, shape, message):
    with pytest.raises(InputError) as caught:
        levels.network.fit(np.zeros(shape, dtype=np.uint8), "array")
    assert str(caught.value) == message


@pytest.mark.parametrize("steps", [5, 30], ids=["shorter", "longer"])
def test_a_network_of_any_length_takes_recordings_as_they_are(steps):
    endless = replace(single(NEURON, steps=20), any_length=True)
    spikes = np.ones((2, steps, 1), dtype=np.uint8)
    assert endless.fit(spikes, "array") is spikes


def test_a_network_of_any_length_walks_the_sensor_to_the_end_of_its_silence(network):
    """Its time phase has no fixed steps; its location phase has a step per channel and the silent steps after them."""
    time_view, location_view = network.views
    views = (time_view, replace(location_view, silence=3))
    endless = replace(network, views=views, any_length=True)
    levels = lower(endless, CHIP, weight_bits=3)
    location_steps = network.steps_of("location") + 3
    assert endless.steps_of("location") == location_steps
    assert [phase.steps for phase in levels.program.phases] == [None, location_steps]
    played = recordings(endless)[:, :25]
    assert compare(Observed(levels, played)).samples == len(played)


@pytest.mark.parametrize(
    ("labels", "message"),
    [
        pytest.param(
            [0],
            "labels of 'array': there is not one label per recording ((1,) against (2,)). "
            "Give one class number for every recording.",
            id="count",
        ),
        pytest.param(
            [0, 2],
            "labels of 'array': a label is not one of the model's classes (0..2 against 0..1). "
            "Check that the events belong to this model.",
            id="class",
        ),
        pytest.param(
            [-1, 0],
            "labels of 'array': a label is not one of the model's classes (-1..0 against 0..1). "
            "Check that the events belong to this model.",
            id="below 0",
        ),
    ],
)
def test_labels_that_do_not_fit_are_refused(network, levels, labels, message):
    with pytest.raises(InputError) as caught:
        Observed(levels, recordings(network, samples=2), np.array(labels))
    assert str(caught.value) == message


def test_accuracy_counts_both_sides(network, levels):
    played = recordings(network, samples=6)
    match = compare(Observed(levels, played, np.array([0, 1, 0, 1, 0, 1])))
    assert match.tied_predictions < 6
    labelled_by_chip = replace(match, labels=match.chip_prediction)
    agrees = match.reference_prediction == match.chip_prediction
    assert labelled_by_chip.accuracy["chip"] == 1.0
    assert labelled_by_chip.accuracy["reference"] == np.mean(agrees)
