"""NIR graphs of every primitive spike as plain Euler steps of their equations do, one step later per population.

The expected spikes are those of ``tests/support/nir_forward.py: run``, which steps the equations of a graph.
"""

import nir
import numpy as np
import pytest

import locsnn_compile as lc
from locsnn_compile.reference.evaluate import evaluate
from tests.support.nir_forward import run
from tests.support.nir_graphs import DT, chain, graphs, lif, linear, load_graph, random_spikes

GRAPHS = graphs()
DEPTH = {"lif": 1, "l1": 1, "l2": 2, "out": 2, "sub.lif": 1}
"""How many steps each population is behind the equations, by the name of its node; 1 for all others."""


POPULATIONS = {
    "biases": ["l1", "l2"],
    "two layers": ["l1", "l2"],
    "conv2d": ["lif", "out"],
    "nested": ["sub.lif", "lif"],
}
"""The populations of graphs that have several, or one of another name than its first."""


def flattened(graph):
    """Return a graph without inner graphs, for the plain forward pass; only the graph ``nested`` has one."""
    if not any(isinstance(n, nir.NIRGraph) for n in graph.nodes.values()):
        return graph
    inner = graph.nodes["sub"]
    nodes = {k: n for k, n in graph.nodes.items() if k != "sub"} | {
        f"sub.{k}": n for k, n in inner.nodes.items() if type(n).__name__ not in ("Input", "Output")
    }
    edges = [
        ("input", "sub.w"),
        ("sub.w", "sub.lif"),
        ("sub.lif", "fc"),
        ("fc", "lif"),
        ("lif", "output"),
    ]
    return nir.NIRGraph(nodes, edges, type_check=False)


@pytest.mark.parametrize("name", GRAPHS)
def test_the_reference_spikes_as_plain_euler_steps_do(name, tmp_path):
    graph, shape = GRAPHS[name]
    events = random_spikes(shape)
    by_equations = run(flattened(graph), events, DT)
    network = load_graph(graph, tmp_path)
    ours = evaluate(network, events.reshape(1, len(events), -1)).spikes
    assert [p.name for p in network.populations if p.name != "nir/bias"] == POPULATIONS.get(
        name, [p.name for p in network.populations][:1]
    )
    for population in network.populations:
        if population.name == "nir/bias":
            continue
        depth = DEPTH.get(population.name, 1)
        if name == "nested" and population.name == "lif":
            depth = 2  # behind the inner graph
        expected = by_equations[population.name].reshape(len(events), -1)
        assert expected.sum() > 10
        np.testing.assert_array_equal(
            ours[population.name][0, depth:], expected[:-depth], err_msg=population.name
        )


@pytest.mark.parametrize("name", GRAPHS)
def test_every_graph_compiles_and_the_chip_follows_it(name, tmp_path):
    graph, shape = GRAPHS[name]
    events = random_spikes(shape).reshape(1, 60, -1)
    compiled = lc.compile(load_graph(graph, tmp_path), events=events, diagnosis=False)
    assert compiled.match.spikes.agreement > 0.85


def test_populations_of_any_length_play_recordings_as_long_as_they_are(tmp_path):
    compiled = lc.compile(
        load_graph(GRAPHS["lif"][0], tmp_path),
        events=random_spikes((10,), 33)[None],
        diagnosis=False,
    )
    assert lc.verify(compiled, random_spikes((10,), 150)[None]).spikes.reference_spikes > 100


def test_potentials_are_counted_from_v_reset_and_settle_at_v_leak(tmp_path):
    graph = chain(
        (4,),
        ("fc", linear(np.random.default_rng(0), outs=3, ins=4)),
        ("lif", lif(np.random.default_rng(1), 3, v_leak=-0.5, v_reset=-0.8, v_threshold=0.4)),
    )
    neuron = load_graph(graph, tmp_path).populations[0].neuron
    np.testing.assert_allclose(neuron.threshold, 1.2)
    np.testing.assert_allclose(neuron.bias / neuron.decay_v, 0.3)


def test_a_bias_settles_where_the_equation_does(tmp_path):
    rng = np.random.default_rng(0)
    affine = nir.Affine(rng.normal(0, 1, (3, 4)), np.array([0.1, 0.0, -0.2]))
    neuron = lif(rng, 3)
    network = load_graph(chain((4,), ("fc", affine), ("lif", neuron)), tmp_path)
    brought = next(p for p in network.projections if p.source == "nir/bias").weights
    np.testing.assert_allclose(
        brought[:, 0] / network.populations[0].neuron.decay_v, neuron.r * affine.bias
    )


def test_files_without_v_reset_reset_to_0(tmp_path):
    import h5py

    nir.write(tmp_path / "old.nir", GRAPHS["lif"][0])
    with h5py.File(tmp_path / "old.nir", "a") as file:
        del file["node/nodes/lif/v_reset"]
    assert lc.load(tmp_path / "old.nir", dt=DT).populations[0].size == 12


def test_several_inputs_are_lines_one_after_the_other_by_name(tmp_path):
    rng = np.random.default_rng(9)
    first, second, neurons = linear(rng, outs=6, ins=4), linear(rng, outs=6, ins=3), lif(rng, 6)
    ends = {"n": neurons, "output": nir.Output(np.array([6]))}
    two = {
        "b": nir.Input(np.array([3])),
        "a": nir.Input(np.array([4])),
        "v": second,
        "w": first,
        **ends,
    }
    edges = [("a", "w"), ("b", "v"), ("w", "n"), ("v", "n"), ("n", "output")]
    network = load_graph(nir.NIRGraph(two, edges, type_check=False), tmp_path)
    joined = chain(
        (7,), ("w", nir.Linear(np.hstack([first.weight, second.weight]))), ("n", neurons)
    )
    events = random_spikes((7,))
    assert (network.channels, [v.name for v in network.views]) == (7, ["nir/inputs"])
    np.testing.assert_array_equal(
        evaluate(network, events[None]).spikes["n"],
        evaluate(load_graph(joined, tmp_path), events[None]).spikes["n"],
    )


def test_files_that_hold_the_type_of_a_flatten_as_a_group(tmp_path):
    import h5py

    nir.write(tmp_path / "old.nir", GRAPHS["conv2d"][0])
    with h5py.File(tmp_path / "old.nir", "a") as file:
        del file["node/nodes/flat/input_type"]
        file["node/nodes/flat/input_type/input"] = np.array([4, 3, 3])
    assert [p.name for p in lc.load(tmp_path / "old.nir", dt=DT).populations] == ["lif", "out"]


@pytest.mark.parametrize("kind", ["LI", "CubaLI"])
def test_a_readout_never_spikes_and_its_potential_is_the_equations(kind, tmp_path):
    import hw_model as hw

    rng = np.random.default_rng(5)
    tau, ones = rng.uniform(4e-3, 2e-2, 3), np.ones(3)
    node = (
        nir.LI(tau=tau, r=tau / DT, v_leak=0 * ones)
        if kind == "LI"
        else nir.CubaLI(tau_syn=tau / 2, tau_mem=tau, r=tau / DT, v_leak=0 * ones, w_in=2 * ones)
    )
    graph = chain(
        (10,),
        ("fc", linear(rng, outs=8, ins=10)),
        ("lif", lif(rng, 8)),
        ("w", linear(rng, outs=3, ins=8)),
        ("read", node),
    )
    events = random_spikes((10,))
    by_equations = run(graph, events, DT)["read"]
    compiled = lc.compile(load_graph(graph, tmp_path), events=events[None], diagnosis=False)
    result = hw.simulate(compiled.program, events, probe=("spikes", "v"))
    ours = result.v["read"] / compiled.levels.quantized.population("read").scale
    assert result.spikes["read"].sum() == 0
    # The hidden spikes are the chip's own. Where they equal the framework's, potentials differ by rounding only.
    assert np.corrcoef(ours[2:].ravel(), by_equations[:-2].ravel())[0, 1] > 0.99
    # No potential passes the threshold, so the register needs no headroom above it. With headroom, the score errors of LI
    # and CubaLI would be 0.006 and 0.044.
    assert compiled.report["match"]["score_error"] < 0.005


def impulse(kind, tau, tau_syn, how, tmp_path):
    """Return the potential after one spike of weight 1, (steps,), and the solution of the equation at the same times.

    The neuron has r = w_in = 1.
    """
    one = np.ones(1)
    node = (
        nir.LI(tau=tau * one, r=one, v_leak=0 * one)
        if kind == "LI"
        else nir.CubaLI(tau_syn=tau_syn * one, tau_mem=tau * one, r=one, v_leak=0 * one, w_in=one)
    )
    network = load_graph(
        chain((1,), ("fc", nir.Linear(np.ones((1, 1)))), ("read", node)),
        tmp_path,
        discretisation=how,
    )
    events = np.zeros((1, 60, 1), dtype=np.uint8)
    events[0, 0] = 1
    ours = evaluate(network, events, potentials=True).potential["read"][0, 1:, 0]
    # The charge arrives at the start of its step, and the potential is that of the step's end.
    t = np.arange(1, 60) * DT
    if kind == "LI":
        return ours, DT / tau * np.exp(-t / tau)
    return ours, DT * (np.exp(-t / tau) - np.exp(-t / tau_syn)) / (tau - tau_syn)


ODE_ERRORS = [
    # kind, tau, tau_syn in steps, largest error of euler as a share of the response's peak
    ("LI", 20, None, 0.06),
    ("LI", 10, None, 0.12),
    ("LI", 5, None, 0.25),
    ("CubaLI", 20, 10, 0.05),
    ("CubaLI", 10, 5, 0.11),
    ("CubaLI", 5, 2.5, 0.25),
]


@pytest.mark.parametrize(("kind", "tau", "tau_syn", "bound"), ODE_ERRORS, ids=lambda v: str(v))
def test_the_error_of_both_discretisations_against_the_equation(
    kind, tau, tau_syn, bound, tmp_path
):
    errors = {}
    for how in ("euler", "exact"):
        ours, by_equations = impulse(kind, tau * DT, tau_syn and tau_syn * DT, how, tmp_path)
        errors[how] = float(np.abs(ours - by_equations).max() / by_equations.max())
    assert errors["exact"] < 1e-12
    assert 0.3 * bound < errors["euler"] < bound
