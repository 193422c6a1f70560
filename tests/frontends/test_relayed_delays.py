"""Delays longer than a synapse can hold are cut, which an assumption states, or carried by neurons that repeat spikes.

The expected spikes are worked out by hand, or those of forward passes in ``tests/support``.
"""

import nir
import numpy as np
import pytest

import hw_model as hw
import locsnn_compile as lc
from locsnn_compile.reference.evaluate import evaluate
from tests.support.net_files import dense, neuron, play, write_net
from tests.support.nir_forward import run
from tests.support.nir_graphs import DT, chain, lif, linear, load_graph

MEMORYLESS = neuron(i_decay=4096, v_decay=4096, threshold=10)
"""Neurons that keep nothing, and whose threshold a weight of 20 exceeds."""


def one_synapse(delay: float) -> list[dict]:
    """Return a layer of one neuron without memory, which repeats its input after a delay."""
    weight = np.array([[20.0]], dtype=np.float32)
    return [
        dense(
            np.random.default_rng(0), outs=1, ins=1, weight=weight, neuron=MEMORYLESS, delay=delay
        )
    ]


def spike_steps(network, steps: int = 400, name: str = "layer0") -> list[int]:
    """Return the steps in which the first neuron of a layer spikes on the chip, after one event in step 0."""
    events = np.zeros((1, steps, network.channels), np.uint8)
    events[0, 0, 0] = 1
    compiled = lc.compile(network, events=events, diagnosis=False)
    assert compiled.match.spikes.agreement == 1
    spikes = hw.simulate(compiled.program, events[0]).spikes[name]
    return np.flatnonzero(spikes[:, 0]).tolist()


CUT = "Of layer 0, 1 of 1 delay, up to {} steps, are cut to 62 steps, as in netx (--relay-delays keeps them)."
FLOORED = "Of layer 0, 1 of 1 delay lose a fraction of a step, as in netx."
# The delay in the file, the step of the spike, and the assumptions.
CHANGED = {
    "62 fits": (62, 63, ()),
    "70 is cut": (70, 63, (CUT.format(70),)),
    "a fraction is floored": (3.7, 4, (FLOORED,)),
    "both": (70.5, 63, (FLOORED, CUT.format(70.5))),
}


@pytest.mark.parametrize(("delay", "spike_step", "sentences"), CHANGED.values(), ids=CHANGED)
def test_a_delay_that_a_synapse_cannot_hold_is_cut_and_listed_as_an_assumption(
    delay, spike_step, sentences, tmp_path
):
    write_net(tmp_path / "model.net", one_synapse(delay))
    network = lc.load(tmp_path / "model.net")
    assert spike_steps(network) == [spike_step]
    assert network.assumptions == sentences


@pytest.mark.parametrize("delay", [0, 62, 63, 70, 125, 126, 200, 300])
def test_relays_carry_any_delay(delay, tmp_path):
    write_net(tmp_path / "model.net", one_synapse(delay))
    network = lc.load(tmp_path / "model.net", relay_delays=True)
    assert spike_steps(network) == [delay + 1]
    relays = [population for population in network.populations if population.helper]
    # A synapse holds 62 steps, and every relay adds 63.
    assert len(relays) == max(-(-(delay - 62) // 63), 0)
    assert len(network.assumptions) == (1 if relays else 0)


def test_relays_of_layers_with_many_delays_change_nothing_but_the_limit(tmp_path):
    rng = np.random.default_rng(5)
    delays = rng.integers(0, 200, 12).astype(np.float32)
    layers = [dense(rng, outs=12, ins=10, delay=delays), dense(rng, outs=5, ins=12, delay=80.0)]
    write_net(tmp_path / "model.net", layers)
    network = lc.load(tmp_path / "model.net", relay_delays=True)
    events = (rng.random((500, 10)) < 0.2).astype(np.uint8)
    compiled = lc.compile(network, events=events[None], diagnosis=False)
    expected = play(layers, events, longest_delay=1000)
    result = hw.simulate(compiled.program, events)
    for number, layer_spikes in expected.items():
        assert layer_spikes.sum() > 20
        assert np.array_equal(result.spikes[f"layer{number}"], layer_spikes)


def test_relays_carry_the_delays_of_a_nir_graph(tmp_path):
    rng = np.random.default_rng(6)
    delays = nir.Delay(rng.integers(0, 150, 8) * DT)
    layers = (("d", delays), ("w", linear(rng, outs=6, ins=8)), ("n", lif(rng, 6)))
    graph = chain((8,), *layers)
    events = (rng.random((300, 8)) < 0.3).astype(np.uint8)
    network = load_graph(graph, tmp_path, relay_delays=True)
    expected = run(graph, events, DT)["n"]
    ours = evaluate(network, events[None]).spikes["n"][0]
    assert expected.sum() > 50
    assert np.array_equal(ours[1:], expected[:-1])
    with pytest.raises(lc.TargetError, match="a delay is out of range"):
        lc.compile(load_graph(graph, tmp_path), events=events[None], diagnosis=False)
    assert lc.compile(network, events=events[None], diagnosis=False).match.spikes.agreement > 0.95


def test_a_last_layer_without_neurons_is_read_out(tmp_path):
    """Its potential is the sum of the weights that arrive in a step, which is the output of netx."""
    rng = np.random.default_rng(7)
    hidden = dense(rng, outs=12, ins=10)
    readout = dense(rng, outs=3, ins=12)
    del readout["neuron"]
    write_net(tmp_path / "model.net", [hidden, readout])
    network = lc.load(tmp_path / "model.net")
    events = (rng.random((1, 80, 10)) < 0.3).astype(np.uint8)
    spikes = play([hidden], events[0])[0]
    arriving = 64 * spikes[:-1] @ readout["weight"].astype(int).T
    assert spikes.sum() > 20
    reference = evaluate(network, events, potentials=True)
    assert np.array_equal(reference.potential["layer1"][0, 1:], arriving)
    assert reference.scores[0].tolist() == arriving.max(axis=0).tolist()
    compiled = lc.compile(network, events=events, diagnosis=False)
    potential = hw.simulate(compiled.program, events[0], probe=("potential",)).potential["layer1"]
    assert np.array_equal(potential[1:], arriving)
