"""Small functions on networks, their matrices and their host layers: whole results for networks of a few neurons."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy import sparse

import hw_model as hw
from locsnn_compile.data.recordings import Recordings
from locsnn_compile.errors import InputError
from locsnn_compile.network.chip_neurons import ChipCuba
from locsnn_compile.network.committee import committee
from locsnn_compile.network.network import HostLayers, HostOutput, Population
from locsnn_compile.network.neurons import Cuba
from locsnn_compile.network.projections import (
    ChipProjection,
    Projection,
    charge,
    held_matrix,
    matrix,
)
from locsnn_compile.passes.quantize import quantize
from locsnn_compile.pipeline import lower
from locsnn_compile.verification.observation import neuron_steps
from tests.support.networks import hybrid, single

CHIP = hw.chip("loihi-sim")
LEAKY = Cuba.of(2, decay_v=0.5, threshold=1.0)


def recordings_of(steps: int, step_seconds: float | None = None) -> Recordings:
    """Return a recording of three channels without events."""
    return Recordings(np.zeros((1, steps, 3), dtype=np.uint8), None, step_seconds, "a.npz")


@pytest.mark.parametrize(
    ("fields", "step_seconds", "expected"),
    [
        ({}, 0.002, (20, None)),
        ({"any_length": True}, None, (7, None)),
        ({"usual_step_seconds": 0.001}, 0.002, (20, 0.002)),
        ({"usual_step_seconds": 0.001}, None, (20, 0.001)),
        ({"usual_step_seconds": 0.001, "step_seconds": 0.003}, 0.002, (20, 0.003)),
    ],
    ids=["neither", "any length", "the recordings'", "the usual one", "the network's own"],
)
def test_steps_that_a_network_leaves_open_are_those_of_recordings(fields, step_seconds, expected):
    network = replace(single(LEAKY, np.ones((2, 3))), **fields)
    with_steps = network.with_steps_of(recordings_of(7, step_seconds))
    assert (with_steps.steps, with_steps.step_seconds) == expected


@pytest.mark.parametrize(
    ("shape", "channels"), [((5, 3), "3 channels"), ((1, 5, 4), "4 channels")], ids=["axes", "channels"]
)  # fmt: skip
def test_recordings_of_other_axes_or_channels_are_refused(shape, channels):
    network = single(LEAKY, np.ones((2, 3)))
    with pytest.raises(InputError) as error:
        network.fit(np.zeros(shape, dtype=np.uint8), "a.npz")
    assert str(error.value) == (
        f"events 'a.npz': the channel count differs from the model's ({channels} against 3). "
        "Give recordings of 3 channels."
    )


def test_steps_of_neurons_are_counted_by_population_and_phase():
    """Three hidden neurons and two classes on each axis: 12 time steps, and 4 channels in a row."""
    assert neuron_steps(hybrid(channels=4, steps=12, hidden=3, classes=2)) == 5 * 12 + 5 * 4


@pytest.mark.parametrize(
    ("classes", "expected"),
    [((1, 1), 1), ((0, 1), None), ((None, None), None), ((None, 1), None)],
    ids=["one", "two", "none", "one of them"],
)
def test_a_committee_has_the_class_for_ties_that_all_members_name(classes, expected):
    members = []
    for number, tie_class in enumerate(classes):
        network = single(LEAKY, np.ones((2, 3)))
        readout = replace(network.readout, tie_class=tie_class)
        members.append(replace(network, name=f"member{number}", readout=readout))
    assert committee(members, [1.0, 1.0]).readout.tie_class == expected


# --- matrices ---


@pytest.mark.parametrize(
    "weights",
    [np.array([[1, 2]]), np.array([[1.0, 2.0]], dtype=np.float32), np.array([[1.0, 2.0]])],
    ids=["integers", "single precision", "double precision"],
)
def test_weights_are_held_in_double_precision_and_cannot_be_written_to(weights):
    weights.setflags(write=False)
    held = held_matrix(weights, "projection")
    assert (held.dtype, held.tolist(), held.flags.writeable) == (np.float64, [[1.0, 2.0]], False)
    # A copy is made only where it is needed.
    assert (held is weights) == (weights.dtype == np.float64)


@pytest.mark.parametrize("form", [np.array, sparse.csr_array], ids=["dense", "sparse"])
@pytest.mark.parametrize("dtype", [np.int64, np.float64])
def test_spikes_of_a_single_line_bring_its_weights(form, dtype):
    weights = matrix(form([[3], [-2]]), dtype)
    spikes = np.array([[[1], [0], [1]]], dtype=np.uint8)
    assert charge(spikes, weights).tolist() == [[[3, -2], [0, 0], [3, -2]]]


# --- layers on the host ---


def host_layers(*neurons) -> HostLayers:
    """Return populations of two neurons each in a row on the host, all connected, with one weight of 0 at each.

    The neurons of the second layer may be in the chip's integers.
    """
    network = single(LEAKY, np.array([[1.0, 0.0, 2.0], [1.0, 1.0, 1.0]]))
    populations = []
    projections = list(network.projections)
    for number, neuron in enumerate(neurons):
        name = "n" if number == 0 else f"n{number}"
        populations.append(Population(name, "time", 2, neuron))
    if len(neurons) > 1:
        weights = np.array([[2, 0], [4, 6]])
        if isinstance(neurons[1], ChipCuba):
            mantissa = matrix(weights, np.int64)
            projections.append(ChipProjection("n", "n1", mantissa, exponent=0, weight_bits=8))
        else:
            projections.append(Projection("n", "n1", weights))
    network = replace(network, populations=tuple(populations), projections=tuple(projections))
    return HostLayers(network, (HostOutput("n", 1),), (3,))


INTEGERS = ChipCuba.of(2, decay_u=4096, decay_v=100, threshold=10)


@pytest.mark.parametrize(
    ("neurons", "multiplications", "arithmetic"),
    [
        ((LEAKY,), {"n": 5}, "float"),
        ((LEAKY, LEAKY), {"n": 5, "n1": 3}, "float"),
        ((LEAKY, INTEGERS), {"n": 5, "n1": 3}, "float and integers"),
    ],
    ids=["one layer", "two layers", "one in integers"],
)
def test_host_layers_count_their_weights_and_say_how_they_compute(
    neurons, multiplications, arithmetic
):
    layers = host_layers(*neurons)
    assert (layers.multiplications, layers.arithmetic) == (multiplications, arithmetic)


# --- synapses of lowered networks ---


@pytest.mark.parametrize(
    ("signs", "expected"),
    [
        ("mixed", [("mixed", [20, -30, 40])]),
        ("apart", [("excitatory", [20, 40]), ("inhibitory", [-30])]),
    ],
    ids=["together", "apart"],
)
def test_weights_of_both_signs_become_one_list_or_two(signs, expected):
    network = single(LEAKY, np.ones((2, 2)))
    mantissa = matrix(np.array([[20, 40], [-30, 0]]), np.int64)
    projection = ChipProjection("touch", "n", mantissa, exponent=0, weight_bits=8, signs=signs)
    population = Population("n", "time", size=2, neuron=INTEGERS)
    network = replace(network, populations=(population,), projections=(projection,))
    levels = lower(network, CHIP, weight_bits=8)
    lists = [(s.sign_mode, s.mantissa.tolist()) for s in levels.compartments.synapses]
    assert lists == expected


def test_a_score_of_potentials_has_the_largest_scale_of_its_population():
    """Both neurons get one threshold mantissa, so that a potential of 1 is twice as much where the threshold is half."""
    network = single(Cuba.of(2, decay_v=0.5, threshold=[1.0, 2.0]), np.ones((2, 3)))
    readout = replace(network.readout, potentials_from=0)
    quantized = quantize(replace(network, readout=readout), CHIP)
    scale = quantized.populations[0].scale
    assert scale[0] == 2 * scale[1]
    assert quantized.score_scale == scale[0]
