"""Networks whose numbers are the integers of a Xylo from the start, so that the compiler rounds nothing.

Spikes and potentials are compared with a second implementation of the arithmetic, in plain Python (the *oracle*).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import locsnn_compile as lc
from hw_model.xylo.network import XyloNetwork, XyloPopulation
from locsnn_compile.network.projections import ChipProjection, matrix
from locsnn_compile.network.xylo_neurons import XyloNeuron
from locsnn_compile.reference.evaluate import evaluate
from tests.support.random_xylo import random_xylo
from tests.support.xylo_oracle import play

SEEDS = range(40)


def plain_network(seed: int) -> tuple[XyloNetwork, np.ndarray]:
    """Return a random network with one current per neuron, without biases or aliases, and rows of 0 and 1.

    Networks that are trained in a Xylo's integers have nothing else.
    """
    network, events = random_xylo(seed)
    hidden, outputs = (replace(p, bias=None) for p in (network.hidden, network.outputs))
    plain = replace(
        network,
        hidden=replace(hidden, dash_syn=hidden.dash_syn[:, :1]),
        outputs=outputs,
        weights_in=network.weights_in[:, :, :1],
        weights_hidden=network.weights_hidden[:, :, :1],
        aliases=None,
    )
    return plain, np.minimum(events, 1).astype(np.uint8)


def neurons(population: XyloPopulation, most_spikes: int) -> XyloNeuron:
    """Return the chip's neurons as neurons of a network."""
    return XyloNeuron(
        population.dash_syn[:, 0], population.dash_mem, population.threshold, most_spikes
    )


def synapses(source: str, target: str, weights: np.ndarray, shift: int) -> ChipProjection:
    """Return a projection of integer weights, given source first, which are shifted by ``shift``."""
    return ChipProjection(source, target, matrix(weights.T, np.int64), shift, 8, "mixed")


def as_network(plain: XyloNetwork, steps: int) -> lc.Network:
    """Return the network of the same integers, with the hidden neurons in one population."""
    return lc.Network(
        name="integers",
        channels=len(plain.weights_in),
        steps=steps,
        views=(lc.InputView("touch", "time", len(plain.weights_in)),),
        populations=(
            lc.Population("hidden", "time", plain.hidden.size, neurons(plain.hidden, 31)),
            lc.Population("classes", "time", plain.outputs.size, neurons(plain.outputs, 1)),
        ),
        projections=(
            synapses("touch", "hidden", plain.weights_in[:, :, 0], plain.shift_in),
            synapses("hidden", "hidden", plain.weights_hidden[:, :, 0], plain.shift_hidden),
            synapses("hidden", "classes", plain.weights_out, plain.shift_out),
        ),
        readout=lc.Readout(("classes",), (1.0,)),
    )


@pytest.mark.parametrize("seed", SEEDS)
def test_the_network_spikes_as_the_arithmetic_says(seed):
    """Spikes and potentials are those of the oracle, one step later: in networks, an event acts in the next step."""
    plain, rows = plain_network(seed)
    expected, _ = play(plain, rows)
    steps = len(rows) + 1
    network = as_network(plain, steps)
    recordings = np.concatenate([rows, np.zeros((1, rows.shape[1]), np.uint8)])[None]

    result = evaluate(network, recordings, potentials=True)

    assert (result.spikes["hidden"][0, 1:] == expected["spikes"]).all()
    assert (result.spikes["classes"][0, 1:] == expected["output_spikes"]).all()
    before_reset = expected["v"] + expected["spikes"] * plain.hidden.threshold
    assert (result.potential["hidden"][0, 1:] == before_reset).all()


@pytest.mark.parametrize("seed", SEEDS[:8])
def test_the_program_has_exactly_the_integers_of_the_network(seed):
    plain, rows = plain_network(seed)
    network = as_network(plain, len(rows))

    compiled = lc.compile(network, target="xylo-audio3", events=rows[None])

    program = compiled.program.network
    for name in ("weights_in", "weights_hidden", "weights_out"):
        assert (getattr(program, name) == getattr(plain, name)).all()
    for population, original in ((program.hidden, plain.hidden), (program.outputs, plain.outputs)):
        assert (population.threshold == original.threshold).all()
        assert (population.dash_mem == original.dash_mem).all()
        assert (population.dash_syn == original.dash_syn).all()
    shifts = (program.shift_in, program.shift_hidden, program.shift_out)
    assert shifts == (plain.shift_in, plain.shift_hidden, plain.shift_out)
    assert compiled.figures.match.reference == "integers"
    spikes = compiled.match.by_population["hidden"]
    assert spikes.reference_spikes == spikes.chip_spikes == spikes.common_spikes


def hidden_spiking_once(network: lc.Network) -> lc.Network:
    """Return the network with hidden neurons that spike at most once in a step."""
    hidden, classes = network.populations
    once = replace(hidden, neuron=replace(hidden.neuron, most_spikes=1))
    return replace(network, populations=(once, classes))


def float_classes(network: lc.Network) -> lc.Network:
    """Return the network with outputs in float."""
    hidden, classes = network.populations
    soft = lc.SoftCuba.of(classes.size, decay_u=0.5, decay_v=0.5, threshold=1.0, drop=0.5)
    into, among, onto = network.projections
    in_float = lc.Projection("hidden", "classes", onto.mantissa.astype(float))
    return replace(
        network,
        populations=(hidden, replace(classes, neuron=soft)),
        projections=(into, among, in_float),
    )


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        pytest.param(
            hidden_spiking_once,
            "population 'hidden': its neurons may spike another number of times in a step than a "
            "Xylo's (1 against 31). Give 31.",
            id="spikes a step",
        ),
        pytest.param(
            float_classes,
            "population 'hidden': it has the integers of a Xylo, and other populations are in "
            "float. Give all populations in one kind of number.",
            id="half in float",
        ),
    ],
)
def test_what_a_xylo_does_not_do_is_refused(changed, message):
    plain, rows = plain_network(0)
    network = changed(as_network(plain, len(rows)))
    with pytest.raises(lc.TargetError) as error:
        lc.compile(network, target="xylo-audio3", events=rows[None])
    assert str(error.value) == message


def test_a_mesh_of_cores_refuses_neurons_of_a_xylo():
    plain, rows = plain_network(0)
    with pytest.raises(lc.TargetError) as error:
        lc.compile(as_network(plain, len(rows)), target="loihi-sim", events=rows[None])
    assert str(error.value) == (
        "population 'hidden': loihi-sim does not have neurons of a Xylo, whose decays are shifts "
        "and which spike several times in a step. Compile it for the Xylo that it was trained on."
    )


def test_charges_that_saturate_are_added_in_the_order_of_their_sources():
    """Two charges up and one down end elsewhere than their sum, which fits the register."""
    neuron = XyloNeuron.of(1, dash_syn=15, dash_mem=15, threshold=32767, most_spikes=31)
    output = XyloNeuron.of(1, dash_syn=1, dash_mem=1, threshold=1, most_spikes=1)
    weights = np.array([[127, 127, -128]])
    network = lc.Network(
        name="order",
        channels=3,
        steps=2,
        views=(lc.InputView("touch", "time", 3),),
        populations=(
            lc.Population("hidden", "time", 1, neuron),
            lc.Population("classes", "time", 1, output),
        ),
        projections=(
            synapses("touch", "hidden", weights.T, shift=8),
            synapses("hidden", "classes", np.array([[1]]), shift=0),
        ),
        readout=lc.Readout(("classes",), (1.0,)),
    )
    recordings = np.array([[[1, 1, 1], [0, 0, 0]]], np.uint8)

    result = evaluate(network, recordings, potentials=True)

    # The charges are 127 << 8 = 32,512 twice, then -128 << 8 = -32,768. The current is 32,512; then 65,024 saturates
    # at 32,767; then it is -1, of which a decay takes -1 >> 15 = -1. The plain sum would be 32,256.
    assert result.potential["hidden"][0, 1, 0] == 0
