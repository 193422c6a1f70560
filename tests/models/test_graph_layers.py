"""Graph convolutions against sums over all walks on the graph, and graphs of taxels against networkx."""

from __future__ import annotations

from itertools import combinations, pairwise, product

import networkx as nx
import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from locsnn_compile.data.sensor import LOCATION_ORDERS, TAXEL_COORDINATES_MM, neutouch
from locsnn_compile.data.taxel_graph import GRAPHS, taxel_graph
from locsnn_compile.errors import InputError
from locsnn_compile.models.description import InputLayout, LifParameters, NetworkDescription
from locsnn_compile.models.graph_and_windows import (
    BranchGraph,
    GraphParameters,
    hop_powers,
    spread_weights,
)
from locsnn_compile.models.lif import GraphLayer, scan_spikes, spike
from tests.support.drawn_layers import drawn

SEEDS = st.integers(0, 2**31)
TAXELS = 39  # of a fingertip, numbered from 1
CHANNELS = 2 * TAXELS


def edges_of(kind: str, neighbours: int = 3, nearer_mm: float = 3.0) -> tuple[tuple[int, int], ...]:
    """The edges of a graph of a fingertip's taxels."""
    return taxel_graph(kind, neutouch(), neighbours=neighbours, nearer_mm=nearer_mm)


def length_mm(edge: tuple[int, int]) -> float:
    """The distance of two taxels."""
    a, b = (TAXEL_COORDINATES_MM[taxel - 1] for taxel in edge)
    return float(np.hypot(a[0] - b[0], a[1] - b[1]))


def complete() -> nx.Graph:
    """The graph of all pairs of taxels, with their distances as weights."""
    graph = nx.Graph()
    pairs = combinations(range(1, TAXELS + 1), 2)
    graph.add_weighted_edges_from((a, b, length_mm((a, b))) for a, b in pairs)
    return graph


# The numbers of edges are recorded, so that no change of a graph goes unnoticed.
@pytest.mark.parametrize(("kind", "count"), [("manual", 73), ("nearest", 78), ("tree", 70)])
def test_taxel_graphs_join_all_taxels(kind: str, count: int) -> None:
    edges = edges_of(kind)
    assert len(edges) == count
    assert list(edges) == sorted({(min(edge), max(edge)) for edge in edges})
    assert nx.is_connected(nx.Graph(edges))
    assert {taxel for edge in edges for taxel in edge} == set(range(1, TAXELS + 1))


@given(neighbours=st.integers(1, 38))
@settings(max_examples=10, deadline=None)
def test_every_taxel_has_its_nearest_neighbours(neighbours: int) -> None:
    graph = nx.Graph(edges_of("nearest", neighbours))
    all_pairs = complete()
    for taxel in range(1, TAXELS + 1):
        # Rounded, so that equal distances are equal and the lower number comes first.
        by_distance = sorted(
            (round(all_pairs.edges[taxel, neighbour]["weight"], 9), neighbour)
            for neighbour in all_pairs[taxel]
        )
        assert {neighbour for _, neighbour in by_distance[:neighbours]} <= set(graph[taxel])


def test_the_tree_is_minimal_and_all_near_pairs_come_with_it() -> None:
    tree = edges_of("tree", nearer_mm=0.0)
    assert len(tree) == TAXELS - 1
    least = nx.minimum_spanning_tree(complete()).size("weight")
    assert sum(map(length_mm, tree)) == pytest.approx(least, rel=1e-12)
    pairs = combinations(range(1, TAXELS + 1), 2)
    near_pairs = {edge for edge in pairs if length_mm(edge) < 2.5}
    assert set(edges_of("tree", nearer_mm=2.5)) == near_pairs | set(tree)


def test_an_unknown_graph_is_refused() -> None:
    with pytest.raises(InputError) as caught:
        edges_of("trees")
    assert str(caught.value) == "taxel graph: 'trees' is not known. Did you mean 'tree'?"


@st.composite
def graphs(draw: st.DrawFn) -> tuple[tuple[tuple[int, int], ...], int]:
    """(edges, number of nodes) of small random graphs."""
    nodes = draw(st.integers(1, 6))
    pairs = list(combinations(range(1, nodes + 1), 2))
    return tuple(draw(st.lists(st.sampled_from(pairs), unique=True)) if pairs else ()), nodes


def brute_convolution(
    x: np.ndarray, weight: np.ndarray, edges: tuple[tuple[int, int], ...], hops: int
) -> np.ndarray:
    """Return features (nodes, f) of inputs (nodes, c): a sum over every walk of up to ``hops`` edges to a node.

    An edge of a walk contributes a factor 1 / sqrt(degree of one end * degree of the other).
    """
    nodes, inputs = x.shape
    neighbours: dict[int, list[int]] = {node: [] for node in range(1, nodes + 1)}
    for a, b in edges:
        neighbours[a].append(b)
        neighbours[b].append(a)
    features = np.zeros((nodes, len(weight)))
    for k in range(hops + 1):
        weight_of_hop = weight[:, k * inputs : (k + 1) * inputs]
        for walk in product(range(1, nodes + 1), repeat=k + 1):
            if not all(b in neighbours[a] for a, b in pairwise(walk)):
                continue
            degrees = [len(neighbours[a]) * len(neighbours[b]) for a, b in pairwise(walk)]
            share = np.prod([1 / np.sqrt(product_of_degrees) for product_of_degrees in degrees])
            features[walk[-1] - 1] += share * weight_of_hop @ x[walk[0] - 1]
    return features


@given(
    graph=graphs(),
    hops=st.integers(1, 3),
    inputs=st.integers(1, 3),
    features=st.integers(1, 3),
    seed=SEEDS,
)
@settings(max_examples=30, deadline=None)
def test_spread_weights_sum_over_walks(
    graph: tuple[tuple[tuple[int, int], ...], int], hops: int, inputs: int, features: int, seed: int
) -> None:
    edges, nodes = graph
    rng = np.random.default_rng(seed)
    weight = rng.normal(size=(features, (hops + 1) * inputs))
    x = rng.normal(size=nodes * inputs)
    lines = rng.permutation(nodes * inputs).reshape(nodes, inputs)
    spread = spread_weights(weight, BranchGraph(hop_powers(edges, nodes, hops), lines))
    expected = brute_convolution(x[lines], weight, edges, hops).ravel()
    # Equal but for the order of the sums in float64.
    np.testing.assert_allclose(spread @ x, expected, rtol=1e-9, atol=1e-12)


@pytest.mark.slow
@given(graph=graphs(), hops=st.integers(1, 3), inputs=st.integers(1, 3), seed=SEEDS)
@settings(max_examples=25, deadline=None)
def test_layer_and_its_gradient_equal_those_of_the_spread_weights(
    graph: tuple[tuple[tuple[int, int], ...], int], hops: int, inputs: int, seed: int
) -> None:
    edges, nodes = graph
    rng = np.random.default_rng(seed)
    lines = rng.permutation(nodes * inputs).reshape(nodes, inputs)
    parts = BranchGraph(hop_powers(edges, nodes, hops), lines)
    neuron = LifParameters()
    generator = torch.Generator().manual_seed(seed)
    layer = drawn(GraphLayer(parts, 2, neuron), generator, 2.0).double()
    x = (rng.random((2, 9, nodes * inputs)) < 0.4).astype(np.float64)
    # The loss is a random linear function of the spikes.
    loss_weights = torch.from_numpy(rng.normal(size=(2, 9, nodes * 2)))
    spikes = layer(torch.from_numpy(x))
    (spikes * loss_weights).sum().backward()
    weight = layer.weight.detach().numpy()
    drive = x @ spread_weights(weight, parts).toarray().T
    assert np.array_equal(spikes.detach().numpy(), scan_spikes(drive, neuron)[0])
    # The drive is linear in the weights, so that its gradient is that of dense weights, spread back.
    dense = torch.from_numpy(drive).requires_grad_()
    (spike(dense, neuron) * loss_weights).sum().backward()
    assert dense.grad is not None
    assert layer.weight.grad is not None
    for f, term in np.ndindex(weight.shape):
        unit = np.zeros(weight.shape)
        unit[f, term] = 1
        by_weight = x @ spread_weights(unit, parts).toarray().T
        assert float(layer.weight.grad[f, term]) == pytest.approx(
            (by_weight * dense.grad.numpy()).sum(), abs=1e-9
        )


def description(fingertips: int) -> NetworkDescription:
    """A network of two branches with graph convolutions, over 7 steps."""
    return NetworkDescription(
        "hybrid-graph",
        InputLayout(neutouch(fingertips), steps=7, step_seconds=0.02),
        classes=3,
        hidden=4,
        graph=GraphParameters("manual", edges_of("manual"), features=5, step_features=2),
        location_order="loop",
        location_taxels=LOCATION_ORDERS["loop"],
    )


@pytest.mark.parametrize("fingertips", [1, 2])
def test_the_inputs_of_a_taxel_are_its_polarities_on_every_fingertip(fingertips: int) -> None:
    lines = description(fingertips).graph_of("time").lines
    # Taxel 5 has channels 8 and 9 on the first fingertip, and 78 more on the second.
    assert lines[4].tolist() == [8, 9, 86, 87][: 2 * fingertips]
    assert sorted(lines.ravel().tolist()) == list(range(CHANNELS * fingertips))


def test_a_time_step_receives_from_steps_up_to_three_away() -> None:
    """Three is the number of hops; the graph of the location branch joins neighbouring time steps."""
    steps, features, hops = 7, 2, 3
    graph = description(1).graph_of("location")
    weights = spread_weights(np.ones((features, hops + 1)), graph).toarray()
    assert weights.shape == (features * steps, steps)
    neurons, lines = np.nonzero(weights)
    pairs = set(zip((neurons // features).tolist(), lines.tolist(), strict=True))
    assert pairs == {(a, b) for a, b in product(range(steps), repeat=2) if abs(a - b) <= hops}


@pytest.mark.parametrize(
    ("values", "message"),
    [
        pytest.param(
            {"taxel_edges": ((2, 1),)},
            "taxel graph: an edge is not a pair of taxels with the lower number first (got 2-1 against 1..39). "
            "Correct the graph.",
            id="turned round",
        ),
        pytest.param(
            {"taxel_edges": ((1, 40),)},
            "taxel graph: an edge is not a pair of taxels with the lower number first (got 1-40 against 1..39). "
            "Correct the graph.",
            id="no such taxel",
        ),
        pytest.param(
            {"taxel_edges": ((1, 2), (1, 2))},
            "taxel graph: edge 1-2 is given twice. Give every edge once.",
            id="twice",
        ),
        pytest.param(
            {"hops": 0},
            "graph 'hops': it must be a whole number from 1 to 16 (got 0). Correct it.",
            id="no hops",
        ),
        pytest.param(
            {"features": 200},
            "neurons of time_graph: it must be a whole number from 1 to 4096 (got 7800). Correct it.",
            id="too many neurons",
        ),
    ],
)
def test_impossible_graphs_are_refused(values: dict[str, object], message: str) -> None:
    good: dict[str, object] = {"name": "mine", "taxel_edges": ((1, 2),)}
    with pytest.raises(InputError) as caught:
        NetworkDescription(
            "tactile-sgnet",
            InputLayout(neutouch(1), steps=7, step_seconds=0.02),
            classes=3,
            graph=GraphParameters(**{**good, **values}),  # type: ignore[arg-type]
        )
    assert str(caught.value) == message


def test_the_kinds_of_graphs_are_these() -> None:
    """Their names are in checkpoints and in the help."""
    assert GRAPHS == ("manual", "nearest", "tree")
