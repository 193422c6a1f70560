"""A Delay behind a bias holds the bias back like a spike: against the equations, and worked out by hand."""

import nir
import numpy as np
import pytest

from locsnn_compile.reference.evaluate import evaluate
from tests.support.nir_forward import run
from tests.support.nir_graphs import cuba, lif, linear, load_graph

DT = 1e-4
"""The step of the graphs that are worked out by hand; random graphs have 1e-3."""
STEPS = 24


def integrator(threshold: float) -> nir.IF:
    """Return one neuron that adds its inputs until it passes a threshold."""
    return nir.IF(r=np.ones(1), v_threshold=np.full(1, threshold), v_reset=np.zeros(1))


def affine(bias: float) -> nir.Affine:
    """Return one weight of 0.25, which no test uses, and a bias."""
    return nir.Affine(np.array([[0.25]]), np.array([bias]))


def delay(steps: float) -> nir.Delay:
    """Return a delay of one value."""
    return nir.Delay(np.array([steps * DT]))


def graph(nodes: dict, edges: list[tuple[str, str]]) -> nir.NIRGraph:
    """Return a graph of these nodes between one input and one output."""
    ends = {"input": nir.Input(np.array([1])), "output": nir.Output(np.array([1]))}
    return nir.NIRGraph({**ends, **nodes}, edges, type_check=False)


IN_A_ROW = graph(
    {"w": affine(0.5), "d": delay(3), "n": integrator(1.2)},
    [("input", "w"), ("w", "d"), ("d", "n"), ("n", "output")],
)
SCALED = graph(
    {"w": affine(0.25), "s": nir.Scale(np.array([2.0])), "d": delay(3), "n": integrator(1.2)},
    [("input", "w"), ("w", "s"), ("s", "d"), ("d", "n"), ("n", "output")],
)
TWO_PATHS = graph(
    {"w": affine(0.3), "late": affine(0.2), "d": delay(4), "n": integrator(1.0)},
    [("input", "w"), ("w", "n"), ("input", "late"), ("late", "d"), ("d", "n"), ("n", "output")],
)
# By hand: 0.5 arrives in steps 4, 5, 6 and passes 1.2 in the third. Of two paths, 0.3 in each of
# steps 1 to 4, then 0.5 in each step.
BY_HAND = {
    "a bias, a Delay": (IN_A_ROW, [6, 9, 12, 15, 18, 21]),
    "a Scale between": (SCALED, [6, 9, 12, 15, 18, 21]),
    "another path has no Delay": (TWO_PATHS, [4, 7, 10, 13, 16, 19, 22]),
}


@pytest.mark.parametrize(("graph", "steps"), BY_HAND.values(), ids=BY_HAND)
def test_a_bias_behind_a_delay_waits_as_long_as_a_spike(graph, steps, tmp_path):
    network = load_graph(graph, tmp_path, dt=DT)
    spikes = evaluate(network, np.zeros((1, STEPS, 1), np.uint8)).spikes["n"]
    assert np.flatnonzero(spikes[0, :, 0]).tolist() == steps


@pytest.mark.parametrize("seed", range(12))
def test_random_graphs_with_delays_after_biases_equal_their_equations(seed, tmp_path):
    rng = np.random.default_rng(seed)
    size = 6
    neuron = cuba if seed % 2 else lif
    nodes = {
        "w": nir.Affine(rng.normal(0.1, 0.5, (size, 4)), rng.normal(0.1, 0.2, size)),
        "d": nir.Delay(rng.integers(0, 7, size) * 1e-3),
        "again": nir.Affine(rng.normal(0.0, 0.5, (size, size)), rng.normal(0.1, 0.2, size)),
        "more": nir.Delay(rng.integers(0, 4, size) * 1e-3),
        "direct": nir.Affine(rng.normal(0.1, 0.5, (size, 4)), rng.normal(0.1, 0.1, size)),
        "n": neuron(rng, size),
        "back": linear(rng, 3, size),
        "last": lif(rng, 3, v_threshold=0.5),
    }
    ends = {"input": nir.Input(np.array([4])), "output": nir.Output(np.array([3]))}
    edges = [("input", "w"), ("w", "d"), ("d", "again"), ("again", "more"), ("more", "n")]
    edges += [("input", "direct"), ("direct", "n"), ("n", "back"), ("back", "last")]
    random_graph = nir.NIRGraph({**ends, **nodes}, [*edges, ("last", "output")], type_check=False)
    spikes = (rng.random((STEPS, 4)) < 0.3).astype(np.uint8)
    by_the_book = run(random_graph, spikes, 1e-3)
    network = load_graph(random_graph, tmp_path, dt=1e-3)
    ours = evaluate(network, np.pad(spikes, ((0, 3), (0, 0)))[None]).spikes
    assert by_the_book["n"].sum() > 0
    for depth, name in ((1, "n"), (2, "last")):
        assert np.array_equal(ours[name][0, depth : depth + STEPS], by_the_book[name]), name
