"""Proven stops that can be followed by hand: a layer of two classes, a few events, and the step after which one wins.

``one_layer`` reads out a compartment ``y`` per class, with thresholds of 30 unless given. Weights and thresholds are in
units of 64 of the registers, a bias is in units of the registers. A stop is a number of steps, not the last step.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import hw_model as hw
from hw_model.mapping.graph import Readout
from tests.support.early_stops import by_potentials, one_layer
from tests.support.hybrids import CHIP, graph_in_phase, program_of_graphs
from tests.support.register_units import FORGETS_AT_ONCE, KEEPS_ALL


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
        # Here every charge may wrap, so that nothing is known of v: as if each could spike at any time.
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
def test_stops_by_hand(options, stop):
    """Two classes, a channel each; the first has an event in each of the first four rows of eight."""
    builder, _ = one_layer(
        [[60, 0], [0, 60]], **{"decay_u": FORGETS_AT_ONCE, "decay_v": 1024} | options
    )
    recording = np.zeros((8, 2), dtype=np.uint8)
    recording[:4, 0] = 1
    stops = hw.stop_when_proven(builder.build(), recording[None])
    assert (stops.steps.tolist(), stops.all_steps, stops.prediction.tolist()) == ([stop], 8, [0])


@pytest.mark.parametrize("weight", [1e100, -1e100])
def test_the_largest_weight_that_a_program_may_have_changes_no_stop(weight):
    """Weights of 1e308 made scores and their bounds overflow."""
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


def test_what_may_wrap_may_spike():
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
    """A strong inhibition is forgotten while the neuron is refractory: its charge alone would say that it never spikes."""
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
    alone = [hw.stop_when_proven(program, one[None]).steps.tolist() for one in recordings]
    assert alone == [[5], [5], [9], [9]]
    assert [[step] for step in hw.stop_when_proven(program, recordings).steps.tolist()] == alone


def test_potentials_of_a_batch_count_to_the_end_of_each_recording_alone():
    """Class 1 can gain 60 in each step that is left: five of 60 in A, two of 254 in B, are ahead of that."""
    builder, _ = one_layer(
        [[60, 0, 254], [0, 60, 0]], decay_u=FORGETS_AT_ONCE, decay_v=KEEPS_ALL, threshold=100_000
    )
    program = by_potentials(builder.build(), 0)
    recordings = np.zeros((2, 9, 3), dtype=np.uint8)
    recordings[0, :8, 0] = recordings[1, :2, 2] = 1
    alone = [hw.stop_when_proven(program, one[None]).steps.tolist() for one in recordings]
    assert alone == [[5], [3]]
    assert [[step] for step in hw.stop_when_proven(program, recordings).steps.tolist()] == alone


def test_spikes_of_a_batch_count_to_the_end_of_each_recording_alone():
    """Class 0 leads with four spikes against four to come in A; in B class 1 is pulled down for good in the first step."""
    builder, _ = one_layer(
        [[60, 0, 0], [0, 32, -254]], decay_u=[4096, 200], decay_v=FORGETS_AT_ONCE
    )
    program = builder.build()
    recordings = np.zeros((2, 9, 3), dtype=np.uint8)
    recordings[0, :8, 0] = recordings[1, 0, 2] = 1
    alone = [hw.stop_when_proven(program, one[None]).steps.tolist() for one in recordings]
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


def test_nothing_is_known_of_a_potential_before_a_step_that_counts():
    """Class 0 can only fall: when row 2 has left it at 0, no other exceeds it, and not before."""
    builder, _ = one_layer(
        [[-60], [0]], decay_u=FORGETS_AT_ONCE, decay_v=FORGETS_AT_ONCE, threshold=100_000
    )
    silence = np.zeros((1, 6, 1), dtype=np.uint8)
    assert hw.stop_when_proven(by_potentials(builder.build(), 2), silence).steps.tolist() == [3]


def test_potentials_stay_0_after_the_end_of_a_recording():
    """The last event acts in step 3: with nothing to come and nothing kept, all is 0 from step 4 on."""
    builder, _ = one_layer(
        [[60, 0], [0, 60]], decay_u=FORGETS_AT_ONCE, decay_v=FORGETS_AT_ONCE, threshold=100_000
    )
    program = by_potentials(builder.build(), 0)
    program = replace(program, phases=(replace(program.phases[0], steps=40),))
    recording = np.zeros((1, 3, 2), dtype=np.uint8)
    recording[0, :, 1] = 1
    busy = (
        hw.simulate(program, recording, probe=("activity",))
        .activity["time"][0]
        .by_piece["neuron_updates_active"]
    )
    rests = 1 + int(busy.any(axis=1).nonzero()[0].max())
    stops = hw.stop_when_proven(program, recording)
    assert (stops.steps.tolist(), stops.prediction.tolist(), rests < 8) == ([rests], [1], True)


def test_a_buffer_that_is_empty_needs_no_step():
    """A program of a transposed phase alone: the whole recording is there before it begins."""
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
    """Four spikes against three to come are enough for both; against four, for the first class alone."""
    builder, _ = one_layer([[60, 0], [0, 60]], decay_u=FORGETS_AT_ONCE)
    recording = np.zeros((9, 2), dtype=np.uint8)
    recording[:4, winner] = 1
    stops = hw.stop_when_proven(builder.build(), recording[None])
    assert (stops.steps.tolist(), stops.prediction.tolist()) == ([stop], [winner])


def test_scores_that_are_rounded_are_no_ties():
    """With weights of a tenth a tie may be decided by rounding, so that it is not taken for proven."""
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


def test_spikes_against_a_class_count_as_losses():
    """With a negative weight a class can only lose: the silent one wins, and is safe when the other has more."""
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
    """Three events, and 37 silent steps that the program adds: what is proven there knows that no event is left."""
    builder, _ = one_layer([[60, 0], [0, 60]], decay_u=FORGETS_AT_ONCE, decay_v=2048, refractory=2)
    program = builder.build()
    program = replace(program, phases=(replace(program.phases[0], steps=40),))
    recording = np.zeros((1, 3, 2), dtype=np.uint8)
    recording[0, :, 1] = 1
    stop = hw.stop_when_proven(program, recording)
    rests = 1 + int(hw.simulate(program, recording, probe=("activity",)).activity["time"][0]
                    .by_piece["neuron_updates_active"].any(axis=1).nonzero()[0].max())  # fmt: skip
    assert (stop.steps.tolist(), stop.prediction.tolist(), stop.all_steps) == ([rests], [1], 40)
    assert 4 < rests < 20
    silent = hw.stop_when_proven(program, 0 * recording)
    assert (silent.steps.tolist(), silent.counts.neuron_updates) == ([3], 6)
    for short in (recording, 0 * recording):
        longer = np.concatenate((short, np.zeros((1, 37, 2), dtype=np.uint8)), axis=1)
        assert hw.stop_when_proven(program, longer).steps.tolist() > [30]
