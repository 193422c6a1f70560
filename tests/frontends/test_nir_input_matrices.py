"""A ``w_in`` that is a matrix means weights before the neurons, and errors about edges name their inner graph."""

import h5py
import nir
import numpy as np
import pytest

import locsnn_compile as lc
from locsnn_compile.errors import InputError
from locsnn_compile.reference.evaluate import evaluate
from tests.support.nir_graphs import DT, chain, cuba, lif, load_graph

RNG = np.random.default_rng(8)
WEIGHTS = RNG.normal(0.2, 0.6, (7, 5))


def with_matrix(path, weights: np.ndarray) -> None:
    """Write neurons behind an input of 5 lines whose ``w_in`` is these weights (neurons, lines)."""
    nir.write(path, chain((5,), ("n", cuba(np.random.default_rng(1), 7))))
    with h5py.File(path, "r+") as file:
        del file["node/nodes/n/w_in"]
        file["node/nodes/n/w_in"] = weights


def test_an_input_matrix_equals_a_linear_before_a_w_in_of_1(tmp_path):
    neurons = cuba(np.random.default_rng(1), 7)
    neurons.w_in = np.ones(7)
    with_linear = load_graph(chain((5,), ("w", nir.Linear(WEIGHTS)), ("n", neurons)), tmp_path)
    with_matrix(tmp_path / "matrix.nir", WEIGHTS)
    with_w_in = lc.load(tmp_path / "matrix.nir", dt=DT)
    spikes = (RNG.random((1, 60, 5)) < 0.5).astype(np.uint8)
    expected = evaluate(with_linear, spikes).spikes["n"]
    assert expected.sum() > 20
    assert np.array_equal(evaluate(with_w_in, spikes).spikes["n"], expected)
    assert [population.name for population in with_w_in.populations] == ["n"]


def test_an_input_matrix_of_another_width_is_refused(tmp_path):
    with_matrix(tmp_path / "matrix.nir", WEIGHTS[:, :4])
    with pytest.raises(InputError) as refused:
        lc.load(tmp_path / "matrix.nir", dt=DT)
    assert str(refused.value) == (
        "model 'matrix.nir', node 'n (w_in)': its input has another size (5 against 4). "
        "Correct its weight."
    )


def test_an_edge_to_nowhere_names_the_inner_graph(tmp_path):
    inner = nir.NIRGraph(
        {"in": nir.Input(np.array([5])), "n": lif(RNG, 5), "out": nir.Output(np.array([5]))},
        [("in", "n"), ("n", "out")],
    )
    nir.write(tmp_path / "nested.nir", chain((5,), ("block", inner)))
    with h5py.File(tmp_path / "nested.nir", "r+") as file:
        group = file["node/nodes/block"]
        del group["edges"]
        group["edges"] = np.array([["in", "n"], ["gone", "out"]], dtype=h5py.string_dtype())
    with pytest.raises(InputError) as refused:
        lc.load(tmp_path / "nested.nir", dt=DT)
    assert str(refused.value) == (
        "model 'nested.nir', graph 'block': the edge 'gone' -> 'out' names a node that does not "
        "exist. Choose one of: in, n, out."
    )
