"""Recordings played to a program for SpiNNaker: which rows run, and what is counted, against numbers by hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from hw_model.errors import InputError
from hw_model.mapping.graph import Input, Phase, Readout
from hw_model.spinnaker.chips import spinnaker_chip
from hw_model.spinnaker.playing import play_program, play_recording
from hw_model.spinnaker.program import SpinnakerProgram
from tests.support.small_spinnaker import Synapse, network, parameters, population, projection

CHIP = spinnaker_chip("spinnaker1")
STRONG = (
    projection(
        Synapse(source=0, target=0, weight=60000, delay=1),
        Synapse(source=1, target=0, weight=60000, delay=1),
    ),
)
"""Two lines onto a neuron. One weight makes it spike, and two do not fit its ring buffer of 65,535."""
FAST_MS = 0.09616
"""A time constant so short that a step keeps nothing."""


def program(**changes: object) -> SpinnakerProgram:
    """Return two lines that make one neuron spike in the next step."""
    cells = population(parameters=parameters(tau_m=FAST_MS, tau_syn=FAST_MS, v_thresh=0.01))
    usual = {
        "inputs": (Input("lines", size=2, phase="run", stream="touches"),),
        "populations": (cells,),
        "projections": STRONG,
    }
    return SpinnakerProgram("small", CHIP, network(**{**usual, **changes}))


@pytest.mark.parametrize("engine", ["fast", "reference"])
def test_a_row_acts_in_the_next_step_and_each_recording_starts_from_rest(engine):
    recordings = np.array([[[1, 0], [0, 0], [0, 0]], [[0, 0], [1, 1], [0, 0]]])
    played = play_program(program(), recordings, engine)
    assert played.spikes["cells"][:, :, 0].tolist() == [[0, 1, 0], [0, 0, 1]]
    first, second = (counts["run"] for counts in played.counts)
    assert first.synaptic_ops == 1
    assert first.spikes == 1
    assert first.neuron_updates == 3
    assert first.input_events == 1
    assert (second.synaptic_ops, second.spikes, second.input_events) == (2, 1, 2)
    assert second.saturated_weights == 1
    assert played.total_counts == first + second


def test_a_phase_that_begins_with_a_touch_runs_no_row_before():
    first_touch = Phase("run", "time", steps=3, align_events=1)
    recordings = np.array([[[0, 0], [0, 0], [1, 0], [0, 0], [0, 0], [0, 0]]])
    played = play_program(program(phases=(first_touch,)), recordings)
    assert played.spikes["cells"][0, :, 0].tolist() == [0, 0, 0, 1, 0, 0]
    assert played.counts[0]["run"].neuron_updates == 3
    run = play_recording(program(phases=(first_touch,)), recordings[0])["run"]
    assert (run.start, run.rows.tolist()) == (2, [[1, 0], [0, 0], [0, 0]])


def test_a_transposed_input_is_played_channel_by_channel():
    turned = Input("lines", size=2, phase="run", stream="touches", positions=np.array([0, 2, 1]))
    location = Phase("run", "location", steps=4)
    # An event of channel 1, which is visited in step 2.
    recording = np.array([[[0, 1, 0], [0, 0, 0]]])
    played = play_program(program(inputs=(turned,), phases=(location,)), recording)
    assert played.spikes["cells"][0, :, 0].tolist() == [0, 0, 0, 1]
    assert played.counts[0]["run"].transpose_events == 1


def test_scores_take_potentials_in_potentials_of_one():
    cells = population(parameters=parameters(tau_m=FAST_MS, tau_syn=FAST_MS), potential_unit=0.25)
    readout = Readout(("cells",), (2.0,), potentials_from=0)
    with_readout = replace(program(populations=(cells,)), readout=readout)
    played = play_program(with_readout, np.array([[[1, 0], [0, 0]]]))
    # Potentials are s16.15, in mV.
    largest_mv = played.potential["cells"][0, :, 0].max() / 2**15
    assert largest_mv > 0
    assert played.scores.tolist() == [[2.0 * largest_mv / 0.25]]


def test_recordings_of_another_width_are_refused():
    with pytest.raises(InputError) as caught:
        play_program(program(), np.zeros((1, 3, 5)))
    assert str(caught.value) == (
        "spikes of 'touches': the shape does not fit ((1, 3, 5) against (steps, 2) or "
        "(batch, steps, 2)). Give one column per channel."
    )
