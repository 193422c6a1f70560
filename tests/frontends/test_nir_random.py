"""Random NIR graphs spike as their equations say: with skip connections, loops, delays and images.

hypothesis draws the graphs; ``tests/support/nir_forward.py: run`` steps their equations.
"""

import itertools
import tempfile
from pathlib import Path

import hypothesis.strategies as st
import networkx as nx
import nir
import numpy as np
import pytest
from hypothesis import given, settings

import locsnn_compile as lc
from locsnn_compile.reference.evaluate import evaluate
from tests.support.nir_forward import run
from tests.support.nir_graphs import DT, cuba, integrate, lif, linear

STEPS = 40
# By reset: functions that make neurons of a shape. Those whose rest is above their threshold need a reset to a value.
NEURONS = {
    "zero": {
        "lif": lambda rng, *n: lif(rng, *n),
        "rest below": lambda rng, *n: lif(rng, *n, v_leak=-0.3, v_reset=-0.5),
        "rest above": lambda rng, *n: lif(rng, *n, v_leak=1.3, v_reset=0.2),
        "cuba": lambda rng, *n: cuba(rng, *n),
        "cuba rest above": lambda rng, *n: cuba(rng, *n, v_leak=1.2, v_reset=-0.1),
        "if": lambda rng, *n: nir.IF(
            np.full(n, 1 / DT), rng.uniform(0.8, 1.5, n), np.full(n, -0.3)
        ),
        "threshold": lambda rng, *n: nir.Threshold(rng.uniform(0.2, 1, n)),
    },
    "subtract": {
        "lif": lambda rng, *n: lif(rng, *n, v_leak=-0.2),
        "cuba": lambda rng, *n: cuba(rng, *n, v_leak=0.2),
        "if": integrate,
    },
}
NEURONS |= dict.fromkeys(("late-zero", "late-subtract", "none"), NEURONS["subtract"])


def image(rng, may_have_biases):
    """Return nodes that lead from an input of (2, 6, 6), their neurons' shape, and what flattens it."""
    bias = rng.normal(0, 0.1, 4) if may_have_biases else np.zeros(4)
    kernel = {"stride": 2, "padding": 1, "dilation": 1, "groups": 2, "bias": bias}
    conv = nir.Conv2d(input_shape=(6, 6), weight=rng.normal(0.1, 0.3, (4, 1, 3, 3)), **kernel)
    pool = nir.SumPool2d(
        kernel_size=np.array([2, 2]), stride=np.array([1, 1]), padding=np.array([0, 0])
    )
    return [("conv", conv), ("pool", pool)], (4, 2, 2)


@st.composite
def ways(draw, count):
    """Draw connections between ``count`` populations, and the depths of these.

    A connection is a pair (source, target) of numbers, 0 for the input, with its delay in steps. A connection that closes
    a loop leads to a population through which all spikes into the loop pass, and has at least the delay with which the
    loop is as fast as in a framework.
    """
    connections = {}
    for target in range(1, count + 1):
        for source in draw(st.sets(st.integers(0, target - 1), min_size=1, max_size=3)):
            connections[source, target] = draw(st.sampled_from([0, 0, 0, 1, 3]))
    graph = nx.DiGraph(list(connections))
    depth = {n: k for k, layer in enumerate(nx.topological_generations(graph)) for n in layer}
    dominator_of = nx.immediate_dominators(graph, 0)
    for source in draw(st.sets(st.integers(1, count), max_size=2)):
        entries = [n for n in dominator_of if n and n in dominators(dominator_of, source)]
        target = draw(st.sampled_from(sorted(entries)))
        connections[source, target] = depth[source] - depth[target] + draw(st.integers(0, 2))
    return connections, depth


def dominators(dominator_of, name):
    """Return the populations through which all paths from the input to a population pass, with itself."""
    immediate = dominator_of.get(name, name)
    if immediate in (name, None):
        return {name}
    return {name} | dominators(dominator_of, immediate)


@st.composite
def graphs(draw, may_have_biases=True):
    """Draw a graph, the shape of its input, depths of populations, and a reset."""
    rng, count = np.random.default_rng(draw(st.integers(0, 2**32 - 1))), draw(st.integers(1, 5))
    reset = draw(st.sampled_from([*NEURONS]))
    connections, depth = draw(ways(count))
    names = ["input", *draw(st.permutations("abcde"))[:count]]
    pictured = draw(st.booleans())
    sizes = [72 if pictured else 8, *(draw(st.integers(2, 7)) for _ in range(count))]
    nodes, edges = {}, []
    for k in range(1, count + 1):
        name, shape = names[k], (sizes[k],)
        kinds = NEURONS[reset]
        before = []
        if pictured and k == 1:
            before, shape = image(rng, may_have_biases)
            sizes[1] = 16
        nodes[name] = kinds[draw(st.sampled_from([*kinds]))](rng, *shape)
        if before:
            connections = {pair: delay for pair, delay in connections.items() if pair != (0, 1)}
            chain = ["input", *(f"{name}_{node}" for node, _ in before), name]
            nodes |= {f"{name}_{node}": image_node for node, image_node in before}
            edges += itertools.pairwise(chain)
    for (source, target), delay in connections.items():
        name = f"{names[source]}_{names[target]}"
        scale = 0.2 if source >= target else 0.5
        weight = linear(rng, sizes[target], sizes[source], scale)
        chain = [names[source]]
        if (sizes[source] == 72 and not source) or (pictured and source == 1):
            nodes[f"{name}_flat"] = nir.Flatten(
                input_type={"input": np.array([2, 6, 6] if not source else [4, 2, 2])}
            )
            nodes[f"{name}_flat"].start_dim, nodes[f"{name}_flat"].end_dim = 0, -1
            chain.append(f"{name}_flat")
        behind = draw(st.booleans())
        if delay and not behind:
            nodes[f"{name}_delay"] = nir.Delay(np.full(sizes[source], delay * DT))
            chain.append(f"{name}_delay")
        biased = may_have_biases and source < target and draw(st.booleans())
        nodes[name] = (
            nir.Affine(weight.weight, rng.normal(0.05, 0.05, sizes[target])) if biased else weight
        )
        chain.append(name)
        if draw(st.booleans()):
            nodes[f"{name}_scale"] = nir.Scale(rng.uniform(0.5, 1.5, sizes[target]))
            chain.append(f"{name}_scale")
        if delay and behind:
            later = rng.integers(0, 3, sizes[target])
            nodes[f"{name}_delay"] = nir.Delay((delay + later) * DT)
            chain.append(f"{name}_delay")
        edges += itertools.pairwise([*chain, names[target]])
    shape = (2, 6, 6) if pictured else (8,)
    nodes |= {"input": nir.Input(np.array(shape)), "output": nir.Output(np.array([sizes[count]]))}
    edges = draw(st.permutations([*edges, (names[count], "output")]))
    return (
        nir.NIRGraph(nodes, edges, type_check=False),
        shape,
        {names[k]: depth[k] for k in range(1, count + 1)},
        reset,
    )


@pytest.mark.slow
@given(st.data(), st.sampled_from(["euler", "hold", "exact"]))
@settings(max_examples=40, deadline=None)
def test_random_graphs_spike_as_the_equations_say(data, how):
    graph, shape, depths, reset = data.draw(graphs(may_have_biases=how != "exact"))
    spikes = (np.random.default_rng(3).random((STEPS, *shape)) < 0.2).astype(np.uint8)
    by_equations = run(graph, spikes, DT, how=how, reset=reset)
    with tempfile.TemporaryDirectory() as folder:
        nir.write(Path(folder) / "graph.nir", graph)
        network = lc.load(Path(folder) / "graph.nir", dt=DT, discretisation=how, reset=reset)
    assert network.assumptions == ()
    ours = evaluate(network, spikes.reshape(1, STEPS, -1)).spikes
    for name, depth in depths.items():
        expected = by_equations[name].reshape(STEPS, -1)[:-depth]
        np.testing.assert_array_equal(ours[name][0, depth:], expected, err_msg=name)
