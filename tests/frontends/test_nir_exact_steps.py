"""``--discretisation exact`` spikes as the solution of the equations does, which matrix exponentials compute.

Charges arrive at the start of a step, and thresholds are compared with the potential at its end. This holds for LIF and
CubaLIF alike, so that a graph with both stays synchronous.
"""

import nir
import numpy as np
import pytest
from scipy.linalg import expm

from locsnn_compile.reference.evaluate import evaluate
from tests.support.nir_graphs import DT, chain, linear, load_graph

STEPS = 50


def solved(node: nir.LIF | nir.CubaLIF, charges: np.ndarray) -> np.ndarray:
    """Return the spikes (steps, n) of neurons for the charges (steps, n) of each step, in units of DT."""
    spikes = np.zeros_like(charges)
    for neuron in range(charges.shape[1]):
        parameters = {
            name: value[neuron] for name, value in vars(node).items() if np.ndim(value) == 1
        }
        if isinstance(node, nir.LIF):
            rates = np.array([[-1 / parameters["tau"]]])
            jump = np.array([parameters["r"] * DT / parameters["tau"]])
        else:
            decays = [
                [-1 / parameters["tau_syn"], 0.0],
                [parameters["r"] / parameters["tau_mem"], -1 / parameters["tau_mem"]],
            ]
            rates = np.array(decays)
            jump = np.array([parameters["w_in"] * DT / parameters["tau_syn"], 0.0])
        flow = expm(rates * DT)
        state = np.zeros(len(jump))
        for step in range(len(charges)):
            state = flow @ (state + jump * charges[step, neuron])
            if state[-1] > parameters["v_threshold"]:
                spikes[step, neuron] = 1
                state[-1] = parameters["v_reset"]
    return spikes


def neurons(kind: str, rng: np.random.Generator, size: int) -> nir.LIF | nir.CubaLIF:
    """Return neurons of a kind with random time constants."""
    tau = rng.uniform(4e-3, 2e-2, size)
    rest = {"v_leak": np.zeros(size), "v_threshold": np.ones(size), "v_reset": np.zeros(size)}
    if kind == "LIF":
        return nir.LIF(tau=tau, r=tau / DT, **rest)
    tau_syn = rng.uniform(2e-3, 9e-3, size)
    return nir.CubaLIF(tau_syn=tau_syn, tau_mem=tau, r=tau / DT, w_in=np.full(size, 1.5), **rest)


@pytest.mark.parametrize("last", ["LIF", "CubaLIF"])
@pytest.mark.parametrize("first", ["LIF", "CubaLIF"])
def test_layers_of_both_kinds_equal_the_solution_step_by_step(first, last, tmp_path):
    rng = np.random.default_rng(3)
    weights = linear(rng, outs=8, ins=6), linear(rng, outs=4, ins=8)
    layers = neurons(first, rng, 8), neurons(last, rng, 4)
    nodes = [("w1", weights[0]), ("first", layers[0]), ("w2", weights[1]), ("last", layers[1])]
    network = load_graph(chain((6,), *nodes), tmp_path, discretisation="exact")
    events = (rng.random((STEPS, 6)) < 0.4).astype(np.uint8)
    ours = evaluate(network, np.pad(events, ((0, 2), (0, 0)))[None]).spikes
    hidden = solved(layers[0], events @ weights[0].weight.T)
    output = solved(layers[1], hidden @ weights[1].weight.T)
    assert output.sum() > 5
    assert np.array_equal(ours["first"][0, 1 : 1 + STEPS], hidden)
    assert np.array_equal(ours["last"][0, 2 : 2 + STEPS], output)


def test_a_current_that_is_gone_at_once_makes_a_cuba_lif_a_lif(tmp_path):
    """As tau_syn falls to 0, all charge reaches the membrane at once: the same step, the same height."""
    one = np.ones(1)
    lif = nir.LI(tau=one * 5 * DT, r=one, v_leak=0 * one)
    cuba = nir.CubaLI(tau_syn=one * 1e-7, tau_mem=one * 5 * DT, r=one, w_in=one, v_leak=0 * one)
    potentials = []
    for name, node in (("lif", lif), ("cuba", cuba)):
        graph = chain((1,), ("w", nir.Linear(np.ones((1, 1)))), ("n", node))
        (tmp_path / name).mkdir()
        network = load_graph(graph, tmp_path / name, discretisation="exact")
        events = np.zeros((1, 20, 1), np.uint8)
        events[0, 3] = 1
        potentials.append(evaluate(network, events, potentials=True).potential["n"])
    np.testing.assert_allclose(potentials[1], potentials[0], rtol=2e-4, atol=1e-12)
