"""``--emit graphml`` and ``--emit dot``: the files are read by networkx and pydot, and agree with the program's tables."""

from __future__ import annotations

import io

import networkx as nx
import numpy as np
import pydot
import pytest

import hw_model as hw
from locsnn_compile.backends.graphs import dot_file, graphml_file
from tests.support.emitted_programs import CHIP, everything, two_phases

# pydot calls pyparsing by names that it deprecates.
pytestmark = pytest.mark.filterwarnings("ignore:.*deprecated:DeprecationWarning")


def read_graphml(program):
    """Return the GraphML of a program as networkx reads it."""
    return nx.read_graphml(io.BytesIO(graphml_file(program)["program.graphml"]))


def read_dot(program):
    """Return the dot file of a program as pydot reads it."""
    (graph,) = pydot.graph_from_dot_data(dot_file(program)["program.dot"].decode())
    return graph


def of_kind(items, kind):
    """Return the nodes or edges of a kind; their data come last."""
    return [item for item in items if item[-1]["kind"] == kind]


@pytest.mark.parametrize(
    "program", [everything(), everything(chip=CHIP), two_phases()], ids=["cores", "core", "phases"]
)
def test_counts_in_graphml_are_those_of_the_program(program):
    graph = read_graphml(program)
    assert graph.is_directed()
    assert (graph.graph["name"], graph.graph["target"]) == (program.name, "loihi-sim")
    nodes = list(graph.nodes(data=True))
    edges = list(graph.edges(data=True))
    slices = of_kind(nodes, "compartments")
    assert sum(data["size"] for _, data in slices) == sum(program.populations.values())
    input_sizes = {data["name"]: data["size"] for _, data in of_kind(nodes, "input")}
    assert input_sizes == {
        program_input.name: program_input.size for program_input in program.inputs
    }
    for core in program.cores:
        slices_of_core = {node: data for node, data in slices if data["core"] == core.number}
        assert sum(data["size"] for data in slices_of_core.values()) == core.compartments
        tiles = {(data["tile_x"], data["tile_y"]) for data in slices_of_core.values()}
        assert tiles == {program.chip.tile_of(core.slot)}
        synapses = [
            data["synapses"]
            for _, target, data in of_kind(edges, "synapses")
            if target in slices_of_core
        ]
        assert sum(synapses) == len(core.axons.target)
        joined = [
            data["compartments"]
            for _, target, data in of_kind(edges, "joined")
            if target in slices_of_core
        ]
        assert sum(joined) == (core.parent >= 0).sum()


def test_edges_of_a_tiny_program_are_those_counted_by_hand():
    """Input x leads to a on one core, and a to b on another core."""
    b = hw.ProgramBuilder(CHIP, name="tiny")
    x = b.add_input("x", 3)
    first = b.add_compartments("a", 2, threshold=1)
    # A core has one pair of voltage limits, so other limits ask for another core.
    second = b.add_compartments("b", 1, threshold=1, vmin=-1)
    b.connect(x, first, [[2, 0, 4], [2, 0, 0]])
    b.connect(first, second, [[2, 0]])
    graph = read_graphml(b.build())
    names = {node: data["name"] for node, data in graph.nodes(data=True)}
    synapses_and_axons = {
        (names[source], names[target]): (data["synapses"], data["axons"])
        for source, target, data in graph.edges(data=True)
    }
    assert synapses_and_axons == {("x", "a"): (3, 2), ("a", "b"): (1, 1)}


def test_dot_has_the_same_nodes_and_edges():
    program = everything()
    graph = read_graphml(program)
    dot = read_dot(program)
    clusters = dot.get_subgraphs()
    assert [cluster.get_name() for cluster in clusters] == [
        f"cluster_core{core.number}" for core in program.cores
    ]
    names = [node.get_name() for subgraph in (dot, *clusters) for node in subgraph.get_nodes()]
    # "node" is the row that gives all nodes their shape.
    assert sorted(set(names) - {"node"}) == sorted(graph.nodes)
    edges = sorted((edge.get_source(), edge.get_destination()) for edge in dot.get_edges())
    assert edges == sorted(graph.edges)


HOSTILE = '<script>"\\n&]]>\x00\n$end -> {é}'


def test_hostile_names_stay_text():
    b = hw.ProgramBuilder(CHIP, name=HOSTILE)
    b.connect(b.add_input("x", 1), b.add_compartments(HOSTILE, 1, threshold=1), np.array([[2]]))
    program = b.build()
    graph = read_graphml(program)
    shown = HOSTILE.replace("\x00", "\ufffd")
    assert graph.graph["name"] == shown
    assert graph.nodes["c0s0"]["name"] == shown
    (cluster,) = read_dot(program).get_subgraphs()
    label = cluster.get_node("c0s0")[0].get_label()
    assert label == '"<script>\\"\\\\n&]]>\ufffd\ufffd$end -> {é}\\n0 to 0"'
