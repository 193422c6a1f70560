"""Proven stops, worked out by hand: a layer of two classes, a few events, and the step after which one has won.

``one_layer`` reads out a compartment ``y`` per class, with a threshold of 30 by default. Weights and thresholds are in
units of 64 counts of a register, biases in counts. A stop is a number of steps, not the number of the last step.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import hw_model as hw
from hw_model.mapping.graph import Readout
from tests.support.early_stops import by_potentials, one_layer
from tests.support.hybrids import CHIP, graph_in_phase, program_of_graphs
from tests.support.register_units import FORGETS_AT_ONCE, KEEPS_ALL, LARGEST_THRESHOLD


def stops_alone(program: hw.ChipProgram, recordings: np.ndarray) -> list[list[int]]:
    """Return the proven stop of each recording by itself."""
    return [
        hw.stop_when_proven(program, recording[None]).steps.tolist() for recording in recordings
    ]


def steps_until_rest(program: hw.ChipProgram, recording: np.ndarray) -> int:
    """Return the number of steps after which no compartment has anything to work on any more."""
    activity = hw.simulate(program, recording, probe=("activity",)).activity["time"][0]
    is_active = activity.by_piece["neuron_updates_active"].any(axis=1)
    return 1 + int(np.flatnonzero(is_active).max())


@pytest.mark.parametrize(
    ("options", "stop"),
    [
        # A charge is enough for a spike: class 0 has 4 after step 4, and class 1 can still have one in each of 3 steps.
        ({}, 5),
        # Class 0 has one spike, in step 1, and class 1 can have no more than one in the last four steps.
        ({"refractory": 4}, 4),
        # With a charge in every step v = 3/4 v + 60 stays below 240.
        ({"threshold": 240}, 0),
        # A charge just reaches the threshold, or is one more.
        ({"threshold": 60, "decay_v": FORGETS_AT_ONCE}, 0),
        ({"threshold": 60, "decay_v": FORGETS_AT_ONCE, "bias": 1}, 5),
        # Here every charge may wrap, so nothing is known about v: both might spike at any time.
        ({"threshold": 240, "exponent": 7, "decay_u": 1}, 5),
        ({"threshold": 240, "exponent": 7, "decay_u": 1, "refractory": 4}, 4),
    ],
    ids=[
        "at any time",
        "refractory",
        "never",
        "at the threshold",
        "just above it",
        "wraps",
        "wraps and refractory",
    ],
)
def test_stops_of_two_classes_worked_out_by_hand(options, stop):
    """There are two classes with a channel each; the first has an event in each of the first four of eight rows."""
    builder, _ = one_layer(
        [[60, 0], [0, 60]], **{"decay_u": FORGETS_AT_ONCE, "decay_v": 1024} | options
    )
    recording = np.zeros((8, 2), dtype=np.uint8)
    recording[:4, 0] = 1
    stops = hw.stop_when_proven(builder.build(), recording[None])
    assert (stops.steps.tolist(), stops.all_steps, stops.prediction.tolist()) == ([stop], 8, [0])


@pytest.mark.parametrize("weight", [1e100, -1e100])
def test_the_largest_weight_that_a_program_may_have_changes_no_stop(weight):
    """Bounds of scores do not overflow: stops depend on the sign of the weight alone."""
    builder, _ = one_layer([[60, 0], [0, 60]], decay_u=FORGETS_AT_ONCE, decay_v=1024)
    program = builder.build()
    large = replace(program, readout=replace(program.readout, weights=(weight,)))
    sign = replace(program, readout=replace(program.readout, weights=(weight / abs(weight),)))
    recording = np.zeros((1, 8, 2), dtype=np.uint8)
    recording[0, :4, 0] = 1
    expected = hw.stop_when_proven(sign, recording)
    stops = hw.stop_when_proven(large, recording)
    assert stops.steps.tolist() == expected.steps.tolist()
    assert stops.prediction.tolist() == expected.prediction.tolist()


def test_a_class_without_positive_weights_may_spike_if_its_charge_wraps():
    """Class 1 has no positive weight at all, but two of its negative ones together wrap to a charge above 0."""
    builder, _ = one_layer(
        [[60, 0, 0], [0, -254, -254]],
        decay_u=FORGETS_AT_ONCE,
        decay_v=FORGETS_AT_ONCE,
        exponent=7,
        threshold=[30, 500],
    )
    program = builder.build()
    recording = np.zeros((8, 3), dtype=np.uint8)
    recording[0, 0] = 1
    stops = hw.stop_when_proven(program, recording[None])
    # One spike against six, ... and against one, in the last step: a tie, which goes to class 0.
    assert (stops.steps.tolist(), stops.prediction.tolist()) == ([7], [0])
    recording[5:, 1:] = 1
    assert hw.simulate(program, recording).prediction == 1


def test_refractory_steps_take_a_voltage_up_to_0():
    """While the neuron is refractory, v is 0, so it forgets a strong inhibition that would otherwise prevent spikes."""
    builder, _ = one_layer(
        [[40, 0, 0], [0, 40, -158]],
        decay_u=[4096, 1024],
        decay_v=[4096, 0],
        threshold=10,
        refractory=[6, 4],
    )
    program = builder.build()
    recording = np.zeros((6, 3), dtype=np.uint8)
    recording[0, :2] = 1
    recording[1, 2] = 1
    stops = hw.stop_when_proven(program, recording[None])
    # u of class 1 is 2560, -8192, -6144 ... from step 1 on: a charge in steps 4 and 5 each, and 1024 is above 640.
    assert (stops.steps.tolist(), stops.prediction.tolist()) == ([5], [0])
    recording[3:, 1] = 1
    played = hw.simulate(program, recording)
    assert (played.spikes["y"].sum(axis=0).tolist(), played.prediction) == ([1, 2], 1)


def test_a_batch_stops_as_its_recordings_alone():
    builder, _ = one_layer([[60, 0], [0, 60]], decay_u=FORGETS_AT_ONCE)
    program = builder.build()
    recordings = np.zeros((4, 9, 2), dtype=np.uint8)
    recordings[0, :7, 0] = recordings[1, :4, 0] = recordings[2, 2, 1] = 1
    alone = stops_alone(program, recordings)
    assert alone == [[5], [5], [9], [9]]
    assert [[step] for step in hw.stop_when_proven(program, recordings).steps.tolist()] == alone


def test_potentials_of_a_batch_count_to_the_end_of_each_recording_alone():
    """Class 1 can gain 60 in each step that is left. Class 0 leads by five times 60 in A, and by two times 254 in B."""
    builder, _ = one_layer(
        [[60, 0, 254], [0, 60, 0]], decay_u=FORGETS_AT_ONCE, decay_v=KEEPS_ALL, threshold=100_000
    )
    program = by_potentials(builder.build(), 0)
    recordings = np.zeros((2, 9, 3), dtype=np.uint8)
    recordings[0, :8, 0] = recordings[1, :2, 2] = 1
    alone = stops_alone(program, recordings)
    assert alone == [[5], [3]]
    assert [[step] for step in hw.stop_when_proven(program, recordings).steps.tolist()] == alone


def test_spikes_of_a_batch_count_to_the_end_of_each_recording_alone():
    """In A class 0 leads with four spikes against four to come; in B class 1 is inhibited to the end in the first step."""
    builder, _ = one_layer(
        [[60, 0, 0], [0, 32, -254]], decay_u=[4096, 200], decay_v=FORGETS_AT_ONCE
    )
    program = builder.build()
    recordings = np.zeros((2, 9, 3), dtype=np.uint8)
    recordings[0, :8, 0] = recordings[1, 0, 2] = 1
    alone = stops_alone(program, recordings)
    assert alone == [[5], [2]]
    assert [[step] for step in hw.stop_when_proven(program, recordings).steps.tolist()] == alone


def test_a_potential_that_may_wrap_may_be_the_largest_voltage():
    """Class 1 has no positive weight at all, but two of its negative ones together wrap to a charge above 0."""
    builder, _ = one_layer(
        [[60, 0, 0], [0, -254, -254]],
        decay_u=FORGETS_AT_ONCE,
        decay_v=FORGETS_AT_ONCE,
        exponent=7,
        threshold=100_000,
    )
    recording = np.zeros((1, 8, 3), dtype=np.uint8)
    recording[0, 0, 0] = 1
    assert hw.stop_when_proven(by_potentials(builder.build(), 0), recording).steps.tolist() == [8]


def test_potentials_prove_nothing_before_the_first_step_that_counts():
    """Class 0 can only fall. Only when it is still 0 after row 2, the first that counts, can no other exceed it."""
    builder, _ = one_layer(
        [[-60], [0]], decay_u=FORGETS_AT_ONCE, decay_v=FORGETS_AT_ONCE, threshold=100_000
    )
    silence = np.zeros((1, 6, 1), dtype=np.uint8)
    assert hw.stop_when_proven(by_potentials(builder.build(), 2), silence).steps.tolist() == [3]


def test_potentials_stay_0_after_the_end_of_a_recording():
    """The last event acts in step 3; as nothing is kept, all registers are 0 from step 4 on."""
    builder, _ = one_layer(
        [[60, 0], [0, 60]], decay_u=FORGETS_AT_ONCE, decay_v=FORGETS_AT_ONCE, threshold=100_000
    )
    program = by_potentials(builder.build(), 0)
    program = replace(program, phases=(replace(program.phases[0], steps=40),))
    recording = np.zeros((1, 3, 2), dtype=np.uint8)
    recording[0, :, 1] = 1
    rests = steps_until_rest(program, recording)
    stops = hw.stop_when_proven(program, recording)
    assert (stops.steps.tolist(), stops.prediction.tolist(), rests < 8) == ([rests], [1], True)


def test_a_buffer_that_is_empty_needs_no_step():
    """In a program of one transposed phase, the whole recording is known before the phase begins."""
    builder = hw.ProgramBuilder(CHIP)
    x = builder.add_input("x", 3)
    y = builder.add_compartments(
        "y", 2, decay_u=FORGETS_AT_ONCE, decay_v=FORGETS_AT_ONCE, threshold=10
    )
    builder.connect(x, y, [[20, 20, 20], [20, 20, 20]])
    program = program_of_graphs(
        CHIP, Readout(("y",), (1.0,)), graph_in_phase(builder.graph(), "location", 4, np.arange(4))
    )
    assert hw.stop_when_proven(program, np.zeros((1, 3, 4), dtype=np.uint8)).steps.tolist() == [0]


@pytest.mark.parametrize(("winner", "stop"), [(0, 5), (1, 6)], ids=["the first", "the second"])
def test_a_tie_goes_to_the_first_class(winner, stop):
    """A lead of four spikes against three to come is enough for both classes, and against four for the first one only."""
    builder, _ = one_layer([[60, 0], [0, 60]], decay_u=FORGETS_AT_ONCE)
    recording = np.zeros((9, 2), dtype=np.uint8)
    recording[:4, winner] = 1
    stops = hw.stop_when_proven(builder.build(), recording[None])
    assert (stops.steps.tolist(), stops.prediction.tolist()) == ([stop], [winner])


def test_a_tie_of_rounded_scores_proves_nothing():
    """With weights of 0.1, rounding may decide a tie, so a tie proves nothing."""
    builder, _ = one_layer([[60, 0], [0, 60]], decay_u=FORGETS_AT_ONCE)
    program = builder.build()
    recording = np.zeros((9, 2), dtype=np.uint8)
    recording[:4, 0] = 1
    stops = [
        hw.stop_when_proven(
            replace(program, readout=Readout(("y",), (weight,))), recording[None]
        ).steps.tolist()
        for weight in (1.0, 0.1)
    ]
    assert stops == [[5], [6]]


def test_one_fraction_among_the_weights_makes_scores_inexact():
    """The second population never spikes, so that its weight alone decides whether a tie is certain."""
    builder, _ = one_layer([[60, 0], [0, 60]], decay_u=FORGETS_AT_ONCE)
    builder.add_compartments("silent", 2, threshold=LARGEST_THRESHOLD)
    program = builder.build()
    recording = np.zeros((9, 2), dtype=np.uint8)
    recording[:4, 0] = 1
    stops = [
        hw.stop_when_proven(
            replace(program, readout=Readout(("y", "silent"), (1.0, weight))), recording[None]
        ).steps.tolist()
        for weight in (2.0, 0.1)
    ]
    assert stops == [[5], [6]]


@pytest.mark.parametrize(
    ("tie_class", "stop"), [(None, 5), (0, 5), (1, 6)], ids=["none", "the winner", "the rival"]
)
def test_a_tie_of_all_classes_goes_to_the_class_for_ties(tie_class, stop):
    """After step 5, the rival can still draw level with the first class, which wins if it is the class for ties."""
    builder, _ = one_layer([[60, 0], [0, 60]], decay_u=FORGETS_AT_ONCE)
    program = builder.build()
    readout = replace(program.readout, tie_class=tie_class)
    recording = np.zeros((9, 2), dtype=np.uint8)
    recording[:4, 0] = 1
    stops = hw.stop_when_proven(replace(program, readout=readout), recording[None])
    assert (stops.steps.tolist(), stops.prediction.tolist()) == ([stop], [0])


def test_spikes_against_a_class_count_as_losses():
    """With a negative weight spikes are losses: the silent class wins, once the other has lost more than it still can."""
    builder, _ = one_layer([[60, 0], [0, 60]], decay_u=FORGETS_AT_ONCE, refractory=3)
    program = replace(builder.build(), readout=Readout(("y",), (-2.0,)))
    recording = np.zeros((9, 2), dtype=np.uint8)
    recording[:7, 0] = 1
    stops = hw.stop_when_proven(program, recording[None])
    # Class 0 has spiked in steps 1 and 4. In the last four steps class 1 could have two spikes, and lose that tie.
    assert (stops.steps.tolist(), stops.prediction.tolist()) == ([6], [1])


def test_a_child_is_not_below_its_lower_limit():
    """A joined child is pulled down by its bias, but clipped at 0, so that its parent can spike."""
    builder, y = one_layer(
        [[20, 0], [0, 20]], decay_u=FORGETS_AT_ONCE, decay_v=FORGETS_AT_ONCE, threshold=10, vmin=0
    )
    builder.add_compartments(
        "d", 2, decay_v=FORGETS_AT_ONCE, threshold=0, bias=[0, -6400], vmin=0, joined_to=y
    )
    program = builder.build()
    recording = np.zeros((6, 2), dtype=np.uint8)
    recording[0, 0] = 1
    stops = hw.stop_when_proven(program, recording[None])
    assert (stops.steps.tolist(), stops.prediction.tolist()) == ([5], [0])
    recording[2:, 1] = 1
    assert hw.simulate(program, recording).prediction == 1


def test_nothing_comes_after_the_end_of_a_recording():
    """Three rows are followed by 37 silent steps, in which the proof knows that no event will come."""
    builder, _ = one_layer([[60, 0], [0, 60]], decay_u=FORGETS_AT_ONCE, decay_v=2048, refractory=2)
    program = builder.build()
    program = replace(program, phases=(replace(program.phases[0], steps=40),))
    recording = np.zeros((1, 3, 2), dtype=np.uint8)
    recording[0, :, 1] = 1
    stop = hw.stop_when_proven(program, recording)
    rests = steps_until_rest(program, recording)
    assert (stop.steps.tolist(), stop.prediction.tolist(), stop.all_steps) == ([rests], [1], 40)
    assert 4 < rests < 20
    silent = hw.stop_when_proven(program, 0 * recording)
    assert (silent.steps.tolist(), silent.counts.neuron_updates) == ([3], 6)
    for short in (recording, 0 * recording):
        longer = np.concatenate((short, np.zeros((1, 37, 2), dtype=np.uint8)), axis=1)
        assert hw.stop_when_proven(program, longer).steps.tolist() > [30]
