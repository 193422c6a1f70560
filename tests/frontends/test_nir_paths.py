"""Paths of different lengths that meet: what meets in one step of a framework meets in one step here."""

import nir
import numpy as np
import pytest
from nir_forward import run
from nir_graphs import DT, lif, linear
from test_nir import load, spikes

import locsnn_compile as lc
from hw_model import chip
from locsnn_compile.backends.exchange import exchange_file
from locsnn_compile.passes.quantize import quantize
from locsnn_compile.reference.evaluate import evaluate

RNG = np.random.default_rng(31)
SIZES = {"input": 10, "a": 12, "b": 11, "c": 9, "d": 7}


def graph(*ways, bias=True):
    """Return a graph with a layer of weights for each way ``source target``, delayed by so many steps after a ``+``."""
    nodes, edges = {"input": nir.Input(np.array([10])), "output": nir.Output(np.array([7]))}, [("d", "output")]
    for way in ways:
        source, target, *late = way.split()
        name, ins, outs = f"{source}_{target}", SIZES[source], SIZES[target]
        gain, steps = 0.2 if late == ["back"] else 1.0, int((late or ["0"])[0].strip("+back") or 0)
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
}


@pytest.mark.parametrize(("ways", "depths"), GRAPHS.values(), ids=GRAPHS)
def test_paths_that_meet_are_aligned(ways, depths, tmp_path):
    made, given = graph(*ways), spikes((10,))
    wanted = run(made, given, DT)
    found = evaluate(load(made, tmp_path), given[None]).spikes
    for node, depth in zip("abcd", depths, strict=True):
        assert wanted[node].sum() > 10
        np.testing.assert_array_equal(found[node][0, depth:], wanted[node][:-depth], err_msg=node)


def by_hand(late):
    """Return integers of a chain of two populations, the first of which hears the input, the second both."""
    cells = lc.ChipCuba.of(6, decay_u=4096, decay_v=900, threshold=150)
    pairs = (("touch", "a", 0), ("a", "b", 0), ("touch", "b", late))
    onto = tuple(
        lc.ChipProjection(source, target, 2 * RNG.integers(-40, 120, (6, 6)), 0, 8, delay=delay)
        for source, target, delay in pairs
    )
    view, readout = lc.InputView("touch", "time", 6), lc.Readout(("b",), (1.0,))
    populations = tuple(lc.Population(name, "time", 6, cells) for name in "ab")
    return quantize(lc.Network("skips", 6, 40, (view,), populations, onto, readout), chip("loihi-sim"))


@pytest.mark.parametrize(("late", "held"), [(1, []), (4, [3])], ids=["as long as the other path", "longer"])
def test_what_is_written_has_the_same_delays_when_it_is_read_again(late, held, tmp_path):
    quantized, given = by_hand(late), spikes((6,))
    (tmp_path / "model.nir").write_bytes(exchange_file("nir", quantized))
    written = nir.read(tmp_path / "model.nir", type_check=False)
    steps = [node.delay[0] / 1e-4 for node in written.nodes.values() if isinstance(node, nir.Delay)]
    assert np.rint(steps).tolist() == held
    again = lc.load(tmp_path / "model.nir")
    assert [p.delay for p in again.projections] == [p.delay for p in quantized.projections]
    wanted, found = (evaluate(n, given[None]).spikes for n in (quantized.on_grid(), again))
    assert (wanted["b"] & found["b"]).sum() > 0.9 * wanted["b"].sum() > 10


def test_a_path_that_is_shorter_than_another_is_refused_on_the_way_out():
    with pytest.raises(lc.InputError) as caught:
        exchange_file("nir", by_hand(0))
    what = "spikes of 'touch' come before those on a longer path, and NIR's take no step (a delay of 0 against 1)"
    assert str(caught.value) == f"--emit nir, population 'b': {what}. Delay them, or emit another kind."
