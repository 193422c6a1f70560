"""Paths of different lengths that meet: spikes that meet in one step of a framework meet in one step here.

Read from NIR, networks must spike as the equations of the graph (``tests/support/nir_forward.py``); written as NIR, the
equations of the graph must spike as the network.
"""

import itertools

import nir
import numpy as np
import pytest

import locsnn_compile as lc
from hw_model import chip
from locsnn_compile.backends.exchange import exchange_file
from locsnn_compile.passes.quantize import quantize
from locsnn_compile.reference.evaluate import evaluate
from tests.support.nir_forward import run
from tests.support.nir_graphs import DT, lif, linear, load_graph, random_spikes

RNG = np.random.default_rng(31)
SIZES = {"input": 10, "a": 12, "b": 11, "c": 9, "d": 7}
"""Lines of the input, and neurons of the populations that a graph can have."""


def graph(*connections):
    """Return a graph with a layer of weights and biases for each connection, such as ``a b +2 back``.

    A connection names its source and its target. ``+2`` delays it by two steps, and ``back`` gives it small weights, for
    loops.
    """
    nodes = {"input": nir.Input(np.array([10])), "output": nir.Output(np.array([7]))}
    edges = [("d", "output")]
    for connection in connections:
        source, target, *options = connection.split()
        name = f"{source}_{target}"
        scale = 0.2 if "back" in options else 1.0
        delay = sum(int(option) for option in options if option != "back")
        weight = linear(RNG, SIZES[target], SIZES[source], scale)
        nodes[name] = nir.Affine(weight.weight, RNG.normal(0.05, 0.05, SIZES[target]))
        nodes |= {target: nodes.get(target, lif(RNG, SIZES[target]))}
        edges.append((name, target))
        if delay:
            nodes[f"{name}_delay"] = nir.Delay(np.full(SIZES[source], delay * DT))
            edges += [(source, f"{name}_delay"), (f"{name}_delay", name)]
        else:
            edges.append((source, name))
    return nir.NIRGraph(nodes, edges, type_check=False)


CHAIN = ("input a", "a b", "b c", "c d")
# Connections, and the expected depths of a, b, c and d: the populations on the longest path from the input.
GRAPHS = {
    "over one": ((*CHAIN, "a c"), [1, 2, 3, 4]),
    "over two": ((*CHAIN, "a d"), [1, 2, 3, 4]),
    "from the input": ((*CHAIN, "input c", "input d"), [1, 2, 3, 4]),
    "all": ((*CHAIN, "a c", "b d", "a d", "input b"), [1, 2, 3, 4]),
    "two branches": (("input a", "a b", "input c", "b d", "c d"), [1, 2, 1, 3]),
    "with delays of its own": ((*CHAIN, "a c +3", "b d +1"), [1, 2, 3, 4]),
    "around a loop of one": ((*CHAIN, "b b back", "a c"), [1, 2, 3, 4]),
    "a loop of one that is delayed": ((*CHAIN, "b b +2 back", "a c"), [1, 2, 3, 4]),
    "a loop of two": ((*CHAIN, "c b +1 back"), [1, 2, 3, 4]),
    "a loop of three": ((*CHAIN, "d b +2 back"), [1, 2, 3, 4]),
    "a loop with more delay": ((*CHAIN, "c a +5 back"), [1, 2, 3, 4]),
    "a path that skips one within a loop": ((*CHAIN, "a c", "c a +2 back"), [1, 2, 3, 4]),
    "loops in a loop": ((*CHAIN, "c b +1 back", "d a +3 back", "b b back"), [1, 2, 3, 4]),
}


@pytest.mark.parametrize(("connections", "depths"), GRAPHS.values(), ids=GRAPHS)
def test_paths_that_meet_are_aligned(connections, depths, tmp_path):
    nir_graph = graph(*connections)
    events = random_spikes((10,))
    expected = run(nir_graph, events, DT)
    ours = evaluate(load_graph(nir_graph, tmp_path), events[None]).spikes
    for node, depth in zip("abcd", depths, strict=True):
        assert expected[node].sum() > 10
        np.testing.assert_array_equal(ours[node][0, depth:], expected[node][:-depth], err_msg=node)


@pytest.mark.parametrize(
    ("connection", "endings"),
    [
        ("b a back", ["spikes of 'b' reach 'a' a step later"]),
        ("d a +1 back", ["spikes of 'd' reach 'a' 2 steps later"]),
        ("b a +1 back", []),
        ("b b back", []),
    ],
)
def test_a_loop_that_is_slower_than_a_frameworks_is_an_assumption(connection, endings, tmp_path):
    start = "A loop over several populations takes a step for each of them here, and one step in a framework"
    # The first two assumptions are those on the reset and the discretisation.
    assert load_graph(graph(*CHAIN, connection), tmp_path).assumptions[2:] == tuple(
        f"{start}: {ending}." for ending in endings
    )


LOOP = {"input a": 0, "a b": 0, "b a": 0, "b c": 0}
# Networks of the chip: the delay of every connection, in steps.
CHIPS = {
    "a path as long as the other": {"input a": 0, "a b": 0, "input b": 1},
    "a longer one": {"input a": 0, "a b": 0, "input b": 4},
    "a shorter one": {"input a": 0, "a b": 0, "input b": 0},
    "shorter ones": {
        "input a": 0,
        "a b": 0,
        "b c": 2,
        "input c": 1,
        "a c": 0,
        "c d": 0,
        "input d": 0,
    },
    "a shorter one told last": {"c d": 0, "b d": 0, "b c": 0, "a b": 0, "input a": 0, "input c": 0},
    "a loop of two": LOOP,
    "a loop of three": {**LOOP, "b a": 3, "c a": 0},
    "a loop and a shorter path": {**LOOP, "input c": 0},
    "two that feed each other": {"input a": 0, "input b": 0, "a b": 0, "b a": 2, "a c": 0},
}
EXPECTED_DELAYS = [[], [3], [1], [3, 2], [1, 2], [1], [4, 2], [1, 2], [2]]
"""The delays of the Delay nodes with which each of these networks is written as NIR, in steps."""


def by_hand(delays, names=None):
    """Return a network in integers, of populations of six neurons, with these delays by connection.

    ``names`` are those of the populations; the last one is read out.
    """
    cells = lc.ChipCuba.of(6, decay_u=4096, decay_v=0, threshold=400)
    projections = tuple(
        lc.ChipProjection(
            *connection.split(), 2 * RNG.integers(-40, 120, (6, 6)), 0, 8, delay=delay
        )
        for connection, delay in delays.items()
    )
    names = names or sorted({connection.split()[1] for connection in delays})
    network = lc.Network(
        "skips",
        channels=6,
        steps=40,
        views=(lc.InputView("input", "time", 6),),
        populations=tuple(lc.Population(name, "time", 6, cells) for name in names),
        projections=projections,
        readout=lc.Readout((names[-1],), (1.0,)),
    )
    return quantize(network, chip("loihi-sim"))


def written(quantized, path):
    """Write a network as NIR, and return the graph that the ``nir`` package reads from the file."""
    path.write_bytes(exchange_file("nir", quantized))
    return nir.read(path, type_check=False)


@pytest.mark.parametrize("name", [name for name in CHIPS if name != "two that feed each other"])
def test_what_is_written_spikes_in_a_framework_as_on_the_chip(name, tmp_path):
    quantized = by_hand(CHIPS[name])
    events = random_spikes((6,))
    in_framework = run(written(quantized, tmp_path / "model.nir"), events, 1e-4)
    on_chip = evaluate(quantized.on_grid(), events[None]).spikes
    for population in quantized.network.populations:
        ours = on_chip[population.name][0]
        theirs = in_framework[population.name]
        # The chip is later by the depth of the population.
        assert any((ours[late:] == theirs[:-late]).all() for late in range(1, 5)), population.name
        assert theirs.sum() > 10


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "expected_delays"), list(zip(CHIPS, EXPECTED_DELAYS, strict=True)), ids=CHIPS
)
def test_what_is_written_has_the_same_relative_delays_when_it_is_read_again(
    name, expected_delays, tmp_path
):
    quantized = by_hand(CHIPS[name])
    events = random_spikes((6,))
    graph = written(quantized, tmp_path / "model.nir")
    delays = [
        node.delay[0] / 1e-4
        for _, node in sorted(graph.nodes.items())
        if isinstance(node, nir.Delay)
    ]
    assert np.rint(delays).tolist() == expected_delays
    read_back = lc.load(tmp_path / "model.nir")
    # The first three assumptions are those on the step, the reset and the discretisation.
    assert read_back.assumptions[3:] == ()
    before = evaluate(quantized.on_grid(), events[None]).spikes
    after = evaluate(read_back, events[None]).spikes
    steps = len(events)
    for population in quantized.network.populations:
        ours = before[population.name][0]
        theirs = after[population.name][0]
        assert ours.sum() > 10
        # A reader may delay all inputs of a population more than the network did.
        assert any((ours[: steps - late] == theirs[late:]).all() for late in range(4)), (
            population.name
        )


@pytest.mark.parametrize(
    "names", [("a/b", "c"), ("weights0", "c"), ("c.output", "c"), ("a", "a_", "a/b", "a.b")]
)
def test_every_name_of_a_population_can_be_written(names, tmp_path):
    """HDF5 takes a slash as a group, and the writer adds nodes of its own, so such names have to change in the file."""
    chained = by_hand({f"{a} {b}": 0 for a, b in itertools.pairwise(["input", *names])}, names)
    written(chained, tmp_path / "model.nir")
    events = random_spikes((6,))[None]
    before = evaluate(chained.on_grid(), events).spikes
    after = evaluate(lc.load(tmp_path / "model.nir"), events).spikes
    for (name, ours), (name_in_file, theirs) in zip(before.items(), after.items(), strict=True):
        # A slash becomes a dot, and names that are taken get underscores.
        assert name_in_file.rstrip("_") == name.replace("/", ".").rstrip("_")
        assert ours.any()
        np.testing.assert_array_equal(ours, theirs)
