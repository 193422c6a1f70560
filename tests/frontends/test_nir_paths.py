"""Paths of different lengths that meet: what meets in one step of a framework meets in one step here."""

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


def graph(*ways, bias=True):
    """Return a graph with a layer of weights for each way ``source target``, delayed by so many steps after a ``+``."""
    nodes, edges = (
        {"input": nir.Input(np.array([10])), "output": nir.Output(np.array([7]))},
        [("d", "output")],
    )
    for way in ways:
        source, target, *late = way.split()
        name, ins, outs = f"{source}_{target}", SIZES[source], SIZES[target]
        gain, steps = (
            0.2 if "back" in late else 1.0,
            sum(int(word) for word in late if word != "back"),
        )
        weight = linear(RNG, outs, ins, gain)
        nodes[name] = nir.Affine(weight.weight, RNG.normal(0.05, 0.05, outs)) if bias else weight
        nodes |= {target: nodes.get(target, lif(RNG, outs))}
        edges.append((name, target))
        if steps:
            nodes[f"{name}_late"] = nir.Delay(np.full(ins, steps * DT))
            edges += [(source, f"{name}_late"), (f"{name}_late", name)]
        else:
            edges.append((source, name))
    return nir.NIRGraph(nodes, edges, type_check=False)


CHAIN = ("input a", "a b", "b c", "c d")
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


@pytest.mark.parametrize(("ways", "depths"), GRAPHS.values(), ids=GRAPHS)
def test_paths_that_meet_are_aligned(ways, depths, tmp_path):
    made, given = graph(*ways), random_spikes((10,))
    wanted = run(made, given, DT)
    found = evaluate(load_graph(made, tmp_path), given[None]).spikes
    for node, depth in zip("abcd", depths, strict=True):
        assert wanted[node].sum() > 10
        np.testing.assert_array_equal(found[node][0, depth:], wanted[node][:-depth], err_msg=node)


@pytest.mark.parametrize(
    ("way", "said"),
    [
        ("b a back", ["spikes of 'b' reach 'a' a step later"]),
        ("d a +1 back", ["spikes of 'd' reach 'a' 2 steps later"]),
        ("b a +1 back", []),
        ("b b back", []),
    ],
)
def test_a_loop_that_is_slower_than_a_frameworks_is_told(way, said, tmp_path):
    start = "A loop over several populations takes a step for each of them here, and one step in a framework"
    assert load_graph(graph(*CHAIN, way), tmp_path).assumptions[2:] == tuple(
        f"{start}: {text}." for text in said
    )


LOOP = {"input a": 0, "a b": 0, "b a": 0, "b c": 0}
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
HELD = [[], [3], [1], [3, 2], [1, 2], [1], [4, 2], [1, 2], [2]]
"""The delays that a graph of each of them needs, in steps."""


def by_hand(ways, names=None):
    """Return integers of populations of six with such delays between them."""
    cells = lc.ChipCuba.of(6, decay_u=4096, decay_v=0, threshold=400)
    onto = tuple(
        lc.ChipProjection(*way.split(), 2 * RNG.integers(-40, 120, (6, 6)), 0, 8, delay=late)
        for way, late in ways.items()
    )
    names = names or sorted({way.split()[1] for way in ways})
    view, readout = lc.InputView("input", "time", 6), lc.Readout((names[-1],), (1.0,))
    populations = tuple(lc.Population(name, "time", 6, cells) for name in names)
    return quantize(
        lc.Network("skips", 6, 40, (view,), populations, onto, readout), chip("loihi-sim")
    )


def written(quantized, path):
    path.write_bytes(exchange_file("nir", quantized))
    return nir.read(path, type_check=False)


@pytest.mark.parametrize("name", [name for name in CHIPS if name != "two that feed each other"])
def test_what_is_written_spikes_in_a_framework_as_on_the_chip(name, tmp_path):
    quantized, given = by_hand(CHIPS[name]), random_spikes((6,))
    found = run(written(quantized, tmp_path / "model.nir"), given, 1e-4)
    wanted = evaluate(quantized.on_grid(), given[None]).spikes
    for population in quantized.network.populations:
        ours, theirs = wanted[population.name][0], found[population.name]
        assert any((ours[late:] == theirs[:-late]).all() for late in range(1, 5)), population.name
        assert theirs.sum() > 10


@pytest.mark.slow
@pytest.mark.parametrize(("name", "held"), list(zip(CHIPS, HELD, strict=True)), ids=CHIPS)
def test_what_is_written_has_the_same_relative_delays_when_it_is_read_again(name, held, tmp_path):
    quantized, given = by_hand(CHIPS[name]), random_spikes((6,))
    graph = written(quantized, tmp_path / "model.nir")
    delays = [
        node.delay[0] / 1e-4
        for _, node in sorted(graph.nodes.items())
        if isinstance(node, nir.Delay)
    ]
    assert np.rint(delays).tolist() == held
    again = lc.load(tmp_path / "model.nir")
    assert again.assumptions[3:] == ()
    wanted, found = (evaluate(n, given[None]).spikes for n in (quantized.on_grid(), again))
    for population in quantized.network.populations:
        ours, theirs = wanted[population.name][0], found[population.name][0]
        assert ours.sum() > 10
        assert any((ours[: 60 - late] == theirs[late:]).all() for late in range(4)), population.name


@pytest.mark.parametrize(
    "names", [("a/b", "c"), ("weights0", "c"), ("c.output", "c"), ("a", "a_", "a/b", "a.b")]
)
def test_every_name_of_a_population_can_be_written(names, tmp_path):
    """A slash made a file that cannot be read; a name of a node that is added was overwritten."""
    chained = by_hand({f"{a} {b}": 0 for a, b in itertools.pairwise(["input", *names])}, names)
    written(chained, tmp_path / "model.nir")
    given = random_spikes((6,))[None]
    wanted, found = (
        evaluate(n, given).spikes for n in (chained.on_grid(), lc.load(tmp_path / "model.nir"))
    )
    for (name, ours), (called, theirs) in zip(wanted.items(), found.items(), strict=True):
        assert called.rstrip("_") == name.replace("/", ".").rstrip("_")
        assert ours.any()
        np.testing.assert_array_equal(ours, theirs)
