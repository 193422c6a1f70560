"""Random NIR graphs and lava-dl layers, read, written and read again: every number of the file and the network stays.

hypothesis draws the files; the datasets of both files are compared, and both networks.
"""

import itertools
import tempfile
from pathlib import Path

import hypothesis.strategies as st
import nir
import numpy as np
import pytest
from hypothesis import given, settings

import hw_model as hw
import locsnn_compile as lc
from locsnn_compile.backends.exchange import exchange_file
from locsnn_compile.network.chip_neurons import ChipSrm
from locsnn_compile.network.projections import values_of
from locsnn_compile.passes.quantize import quantize
from tests.support.datasets import assert_equal_datasets, datasets_of
from tests.support.net_files import dense, even, neuron, write_net
from tests.support.nir_graphs import DT

CHIP = hw.chip("loihi-sim")
RARELY = settings(max_examples=12, deadline=None)
"""Few examples, because each writes two files and quantises a network."""


@st.composite
def neurons(draw, size, rng, shared):
    """Draw neurons with one number per neuron, or one for all if these may be ``shared``, as float32 or float64."""
    kind = draw(st.sampled_from(["LIF", "CubaLIF", "IF", "Threshold"]))
    dtype = draw(st.sampled_from([np.float32, np.float64]))
    n = 1 if shared and draw(st.booleans()) else size
    floor, leak = (
        rng.uniform(-0.5, 0.5, n) if draw(st.booleans()) else np.zeros(n) for _ in range(2)
    )
    limit = np.maximum(np.maximum(floor, leak), 0) + rng.uniform(0.3, 2, n)
    tau = rng.uniform(2e-3, 3e-2, n)
    if kind == "Threshold":
        return nir.Threshold(limit.astype(dtype))
    if kind == "IF":
        return nir.IF(
            *(
                v.astype(dtype)
                for v in (1 / DT * rng.uniform(0.5, 2, n), limit, np.minimum(floor, 0))
            )
        )
    common = {"r": tau / DT, "v_leak": leak, "v_threshold": limit, "v_reset": floor}
    if kind == "LIF":
        return nir.LIF(**{key: v.astype(dtype) for key, v in {"tau": tau, **common}.items()})
    cuba = {"tau_mem": tau, "tau_syn": tau / 2, "w_in": rng.uniform(0.5, 2, n), **common}
    return nir.CubaLIF(**{key: v.astype(dtype) for key, v in cuba.items()})


@st.composite
def layers(draw, ins, rng, shared):
    """Draw the nodes of a layer, as (name, node), and its size; recurrent weights are called ``back``."""
    size = draw(st.integers(1, 5))
    weight = rng.normal(0.2, 1, (size, ins))
    named = [
        (
            "w",
            nir.Affine(weight, rng.normal(0, 0.1, size))
            if draw(st.booleans())
            else nir.Linear(weight),
        )
    ]
    if draw(st.booleans()):
        named.append(("s", nir.Scale(rng.uniform(0.5, 2, size))))
    if draw(st.booleans()):
        named.append(("d", nir.Delay(DT * rng.integers(0, 6, size))))
    named.append(("n", draw(neurons(size, rng, shared))))
    if draw(st.booleans()):
        named.append(("back", nir.Linear(rng.normal(0, 0.3, (size, size)))))
    return named, size


@st.composite
def graphs(draw, depth=1):
    """Draw a graph of one to three layers, some of them nested."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    size = lines = draw(st.integers(1, 6))
    nodes, edges, before = {"input": nir.Input(np.array([lines]))}, [], "input"
    for number in range(draw(st.integers(1, 3))):
        nested = depth > 0 and draw(st.booleans())
        named, outs = draw(layers(size, rng, shared=not nested))
        inside, links = {}, []
        for name, node in named:
            inside[name] = node
            links += [(name, "n"), ("n", name)] if name == "back" else []
        chain = [name for name in inside if name != "back"]
        links += itertools.pairwise(chain)
        if nested:
            inner_nodes = {
                "in": nir.Input(np.array([size])),
                **inside,
                "out": nir.Output(np.array([outs])),
            }
            nodes[f"sub{number}"] = nir.NIRGraph(
                inner_nodes, [("in", chain[0]), *links, ("n", "out")], type_check=False
            )
            edges, before = [*edges, (before, f"sub{number}")], f"sub{number}"
        else:
            nodes |= {f"{name}{number}": node for name, node in inside.items()}
            edges += [
                (before, f"{chain[0]}{number}"),
                *((f"{a}{number}", f"{b}{number}") for a, b in links),
            ]
            before = f"n{number}"
        size = outs
    nodes["output"] = nir.Output(np.array([size]))
    return nir.NIRGraph(
        nodes, draw(st.permutations([*edges, (before, "output")])), type_check=False
    )


@st.composite
def nets(draw):
    """Draw one to three layers of a ``.net`` file."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    ins, layers_of_file = draw(st.integers(1, 6)), []
    if draw(st.booleans()):
        layers_of_file.append({"type": "input", "shape": np.array([ins])})
    for _ in range(draw(st.integers(1, 3))):
        outs = draw(st.integers(1, 5))
        each = outs if draw(st.booleans()) else 1
        layer = dense(
            rng,
            outs,
            ins,
            neuron=neuron(
                *(rng.integers(low, high, each) for low, high in ((0, 4097), (0, 4097), (50, 4000)))
            ),
        )
        if draw(st.booleans()):
            layer["bias"] = rng.integers(-60, 61, outs).astype(np.float32)
        if draw(st.booleans()):
            layer["delay"] = rng.uniform(0, 70, outs).astype(np.float32)
        if draw(st.booleans()):
            layer |= {"type": "dense_rec", "weight_rec": even(rng, outs, outs)}
        layers_of_file, ins = [*layers_of_file, layer], outs
    return layers_of_file


def assert_same_network(before, after):
    """Compare the neurons and the weights of two networks, number by number."""
    assert [p.name for p in before.populations] == [p.name for p in after.populations]
    for first, second in zip(before.populations, after.populations, strict=True):
        for key, value in vars(first.neuron).items():
            np.testing.assert_array_equal(getattr(second.neuron, key), value)
    for first, second in zip(before.projections, after.projections, strict=True):
        assert (first.source, first.target) == (second.source, second.target)
        np.testing.assert_array_equal(first.delay, second.delay)
        matrices = [p.mantissa if hasattr(p, "mantissa") else p.weights for p in (first, second)]
        np.testing.assert_array_equal(*map(values_of, matrices))


@pytest.mark.slow
@given(graphs(), st.sampled_from(["zero", "subtract"]))
@RARELY
def test_a_nir_graph_that_is_read_and_written_is_the_same(graph, reset):
    with tempfile.TemporaryDirectory() as folder:
        before, after = (Path(folder) / f"{name}.nir" for name in ("before", "after"))
        nir.write(before, graph)
        network = lc.load(before, dt=DT, reset=reset)
        quantized = quantize(network, CHIP)
        after.write_bytes(exchange_file("nir", quantized))
        assert_equal_datasets(datasets_of(before, "node"), datasets_of(after, "node"))
        assert_same_network(network, lc.load(after, dt=DT, reset=reset))
        metadata = nir.read(after, type_check=False).metadata
    for k, p in enumerate(quantized.projections):
        dense_form = p.mantissa if isinstance(p.mantissa, np.ndarray) else p.mantissa.toarray()
        rows, columns, mantissas = (
            metadata[f"quantized.projection{k}.{key}"] for key in ("rows", "columns", "mantissa")
        )
        np.testing.assert_array_equal(dense_form[rows, columns], mantissas)
        assert np.count_nonzero(dense_form) == np.count_nonzero(mantissas)
    for q in quantized.populations:
        if isinstance(q.neuron, ChipSrm):
            taps = metadata[f"quantized.{q.population.name}.refractory.mantissa"]
            np.testing.assert_array_equal(taps, q.neuron.refractory.mantissa)
        np.testing.assert_array_equal(
            metadata[f"quantized.{q.population.name.replace('/', '.')}.threshold"],
            q.neuron.threshold,
        )


@pytest.mark.slow
@given(nets())
@RARELY
def test_a_lava_dl_file_that_is_read_and_written_is_the_same(layers_of_file):
    with tempfile.TemporaryDirectory() as folder:
        before, after = (Path(folder) / f"{name}.net" for name in ("before", "after"))
        write_net(before, layers_of_file, {"Ts": 1.0, "tSample": 80})
        network = lc.load(before)
        after.write_bytes(exchange_file("net", quantize(network, CHIP)))
        assert_equal_datasets(datasets_of(before, "layer"), datasets_of(after, "layer"))
        assert_equal_datasets(datasets_of(before, "simulation"), datasets_of(after, "simulation"))
        assert_same_network(network, lc.load(after))
