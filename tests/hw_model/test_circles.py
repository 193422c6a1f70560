"""The order of updates: nodes in a circle of edges come together, and sources before targets; against networkx."""

import networkx as nx
import numpy as np
import pytest

from hw_model.mapping.circles import sources_first


@pytest.mark.parametrize(
    ("count", "edges", "order"),
    [
        (0, [], []),
        (3, [], [[0], [1], [2]]),
        (3, [(2, 0), (0, 1)], [[2], [0], [1]]),
        (3, [(1, 1), (2, 1)], [[0], [2], [1]]),
        (5, [(4, 1), (1, 3), (3, 1), (3, 0)], [[2], [4], [1, 3], [0]]),
        (4, [(0, 1), (1, 2), (2, 3), (3, 0)], [[0, 1, 2, 3]]),
    ],
    ids=["nothing", "no edges", "a chain", "a loop", "a circle", "all of them"],
)
def test_sources_come_first(count, edges, order):
    assert sources_first(count, edges) == order


@pytest.mark.parametrize("seed", range(40))
def test_the_order_equals_that_of_networkx(seed):
    r = np.random.default_rng(seed)
    count = int(r.integers(1, 25))
    edges = r.integers(0, count, (int(r.integers(0, 2 * count)), 2))
    graph = nx.DiGraph()
    graph.add_nodes_from(range(count))
    graph.add_edges_from(edges.tolist())
    circles = nx.condensation(graph)
    order = nx.lexicographical_topological_sort(
        circles, key=lambda circle: min(circles.nodes[circle]["members"])
    )
    expected = [sorted(circles.nodes[circle]["members"]) for circle in order]
    assert sources_first(count, edges) == expected
