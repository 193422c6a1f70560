"""NIR's neurons with every reset, rest and discretisation spike as plain steps of their equations do.

The expected spikes are those of ``tests/support/nir_forward.py: run``.
"""

import itertools

import nir
import numpy as np
import pytest

import hw_model as hw
import locsnn_compile as lc
from locsnn_compile.pipeline import lower
from locsnn_compile.reference.evaluate import evaluate
from tests.support.nir_forward import run
from tests.support.nir_graphs import (
    DT,
    chain,
    cuba,
    integrate,
    lif,
    linear,
    load_graph,
    random_spikes,
)

RNG = np.random.default_rng(21)
RESETS = ("zero", "subtract", "late-zero", "late-subtract", "none")
NEURONS = {
    "LIF": lif(RNG, 12),
    "CubaLIF": cuba(RNG, 12),
    "IF": integrate(RNG, 12),
    "LIF at rest off 0": lif(RNG, 12, v_leak=0.3, v_reset=0.1, v_threshold=0.9),
    "LIF at rest below its reset": lif(RNG, 12, v_leak=-0.4, v_reset=0.2, v_threshold=0.8),
    "CubaLIF at rest off 0": cuba(RNG, 12, v_leak=0.3, v_reset=-0.2, v_threshold=1.1),
    "LIF of a tau of one step": nir.LIF(
        tau=np.full(12, DT),
        r=np.ones(12),
        v_leak=np.zeros(12),
        v_threshold=np.ones(12),
        v_reset=np.zeros(12),
    ),
    "IF of a reset off 0": nir.IF(
        r=np.full(12, 1 / DT), v_threshold=np.full(12, 1.5), v_reset=np.full(12, -0.7)
    ),
}
BACK = linear(RNG, outs=12, ins=12, scale=0.2)
"""Recurrent weights of the first layer."""


def two_layers(neuron, bias=True):
    """Return a graph of 12 of these neurons, with input and recurrent weights, and a second layer of LIF neurons."""
    first = linear(RNG, outs=12, ins=10)
    nodes = {
        "input": nir.Input(np.array([10])),
        "fc": nir.Affine(first.weight, RNG.normal(0, 0.1, 12)) if bias else first,
        "first": neuron,
        "back": BACK,
        "fc2": linear(RNG, outs=5, ins=12),
        "second": lif(RNG, 5),
        "output": nir.Output(np.array([5])),
    }
    edges = [
        *itertools.pairwise(k for k in nodes if k != "back"),
        ("first", "back"),
        ("back", "first"),
    ]
    return nir.NIRGraph(nodes, edges, type_check=False)


@pytest.mark.parametrize("reset", RESETS)
@pytest.mark.parametrize("name", NEURONS)
def test_the_reference_is_the_equation_with_every_reset(name, reset, tmp_path):
    graph, events = two_layers(NEURONS[name]), random_spikes((10,))
    expected = run(graph, events, DT, reset=reset)
    ours = evaluate(load_graph(graph, tmp_path, reset=reset), events[None]).spikes
    for depth, node in enumerate(("first", "second"), start=1):
        assert expected[node].sum() > 10
        np.testing.assert_array_equal(ours[node][0, depth:], expected[node][:-depth], err_msg=node)


@pytest.mark.slow
@pytest.mark.parametrize("reset", RESETS)
@pytest.mark.parametrize("name", ["LIF", "CubaLIF", "CubaLIF at rest off 0"])
def test_the_chip_follows_the_reference_and_equals_its_own_integers(name, reset, tmp_path):
    events = random_spikes((10,), 80)[None]
    network = load_graph(two_layers(NEURONS[name]), tmp_path, reset=reset)
    compiled = lc.compile(network, events=events, diagnosis=reset == "subtract")
    by_population = compiled.match.by_population
    assert min(by_population[node].agreement for node in ("first", "second")) > 0.6
    exact = evaluate(compiled.levels.quantized.on_grid(), events).spikes
    for engine in ("fast", "reference"):
        result = hw.simulate(compiled.program, events, engine=engine)
        for node in ("first", "second"):
            np.testing.assert_array_equal(result.spikes[node], exact[node])


def test_a_subtracted_threshold_is_exact_except_for_what_the_current_keeps(tmp_path):
    network = load_graph(two_layers(NEURONS["CubaLIF"], bias=False), tmp_path, reset="subtract")
    q = lower(network, hw.chip("loihi-sim"), weight_bits=8).quantized.population("first")
    assert q.strategy == "delay-line"
    assert q.fit.refractory_max < 2e-3


def test_neurons_with_a_current_have_a_dendrite_and_others_a_single_compartment(tmp_path):
    sizes = {}
    for kind in ("LIF", "CubaLIF"):
        levels = lower(
            load_graph(two_layers(NEURONS[kind]), tmp_path, reset="subtract"),
            hw.chip("loihi-sim"),
            weight_bits=8,
        )
        sizes[kind] = [g.name for g in levels.compartments.groups if g.name.startswith("first")]
    assert sizes == {"LIF": ["first"], "CubaLIF": ["first", "first/dendrite"]}


def test_a_potential_that_no_spike_resets_has_room_below(tmp_path):
    """Half of the inputs inhibit six times as strongly as the others excite, and nothing wraps or is clipped."""
    weights = np.where(np.arange(10) < 5, 1.0, -6.0) * np.ones((12, 1))
    graph = chain((10,), ("fc", nir.Linear(weights)), ("lif", lif(RNG, 12)))
    events = random_spikes((10,), 100, rate=0.6)[None]
    compiled = lc.compile(
        load_graph(graph, tmp_path, reset="subtract"), events=events, diagnosis=False
    )
    assert compiled.match.wraps_and_clips == {}


@pytest.mark.parametrize("name", ["LIF", "CubaLIF", "CubaLIF at rest off 0"])
def test_inputs_held_for_a_step(name, tmp_path):
    graph, events = two_layers(NEURONS[name]), random_spikes((10,))
    expected = run(graph, events, DT, how="hold")
    ours = evaluate(load_graph(graph, tmp_path, discretisation="hold"), events[None]).spikes
    for depth, node in enumerate(("first", "second"), start=1):
        np.testing.assert_array_equal(ours[node][0, depth:], expected[node][:-depth], err_msg=node)


@pytest.mark.parametrize("dt", [1e-4, 1e-3, 1.0])
def test_integrators_of_r_1_add_weights_whatever_the_step(dt, tmp_path):
    neuron = nir.IF(r=np.ones(12), v_threshold=np.full(12, 1.5), v_reset=np.zeros(12))
    graph, events = (
        chain((10,), ("fc", linear(RNG, outs=12, ins=10)), ("if", neuron)),
        random_spikes((10,)),
    )
    expected = run(graph, events, 1.0)["if"]
    ours = evaluate(load_graph(graph, tmp_path, dt=dt), events[None]).spikes["if"]
    assert expected.sum() > 10
    np.testing.assert_array_equal(ours[0, 1:], expected[:-1])


@pytest.mark.parametrize("kind", ["LIF", "CubaLIF"])
def test_a_tau_without_end_integrates(kind, tmp_path):
    endless, zero = np.full(12, np.inf), np.zeros(12)
    common = {"r": endless, "v_leak": zero, "v_threshold": zero + 1.5, "v_reset": zero}
    node = (
        nir.LIF(tau=endless, **common)
        if kind == "LIF"
        else nir.CubaLIF(tau_mem=endless, tau_syn=zero + DT, w_in=zero + 1, **common)
    )
    integrator = nir.IF(r=zero + 1 / DT, v_threshold=zero + 1.5, v_reset=zero)
    weights, events = linear(RNG, outs=12, ins=10), random_spikes((10,))
    expected = run(chain((10,), ("fc", weights), ("n", integrator)), events, DT)["n"]
    ours = evaluate(
        load_graph(chain((10,), ("fc", weights), ("n", node)), tmp_path), events[None]
    ).spikes["n"]
    np.testing.assert_array_equal(ours[0, 1:], expected[:-1])


@pytest.mark.parametrize("shorter_by", [0.0, 1e-7, 1e-5, 0.05])
def test_a_tau_of_a_step_is_one_only_up_to_rounding(shorter_by, tmp_path):
    tau, one = DT / (1 + shorter_by), np.ones(12)
    node = nir.LIF(tau=tau * one, r=one, v_leak=0 * one, v_threshold=one, v_reset=0 * one)
    graph = chain((10,), ("fc", linear(RNG, outs=12, ins=10)), ("lif", node))
    if shorter_by < 1e-6:
        assert (load_graph(graph, tmp_path).populations[0].neuron.decay_v == 1).all()
        return
    with pytest.raises(lc.InputError) as caught:
        load_graph(graph, tmp_path)
    assert str(caught.value) == (
        f"model 'graph.nir', node 'lif': tau is shorter than a step ({tau:g} s against 0.001 s). "
        "Give a smaller --dt, or --discretisation exact or hold."
    )


# The reset, a parameter of the neurons, and the error.
REFUSED = [
    ("zero", {"v_reset": 1.5}, "the threshold is not above the reset (by -0.5)"),
    ("subtract", {"v_leak": 1.5}, "the threshold is not above v_leak, where it starts (by -0.5)"),
]


@pytest.mark.parametrize(("reset", "parameters", "what"), REFUSED, ids=[row[0] for row in REFUSED])
def test_neurons_that_spike_for_ever_are_refused(reset, parameters, what, tmp_path):
    graph = chain((10,), ("fc", linear(RNG, outs=12, ins=10)), ("lif", lif(RNG, 12, **parameters)))
    with pytest.raises(lc.InputError) as caught:
        load_graph(graph, tmp_path, reset=reset)
    message = f"model 'graph.nir', node 'lif': {what}. Train with a threshold above v_reset and v_leak, and above 0."
    assert str(caught.value) == message


TONIC_RNG = np.random.default_rng(22)
# Neurons whose rest is at their threshold or above, so that they spike without input.
TONIC = {
    "LIF": lif(TONIC_RNG, 12, v_leak=1.5),
    "some of them": lif(TONIC_RNG, 12, v_leak=np.linspace(0.2, 1.8, 12), v_reset=-0.2),
    "CubaLIF": cuba(TONIC_RNG, 12, v_leak=1.4, v_reset=0.3),
    "at the threshold": lif(TONIC_RNG, 12, v_leak=1.0),
}


@pytest.mark.parametrize("reset", ["zero", "late-zero"])
@pytest.mark.parametrize("how", ["euler", "hold"])
@pytest.mark.parametrize("name", TONIC)
def test_neurons_whose_rest_is_above_their_threshold_start_there_and_spike_without_input(
    name, how, reset, tmp_path
):
    graph, events = two_layers(TONIC[name]), random_spikes((10,))
    graph.nodes["second"] = TONIC[name]
    graph.nodes["fc2"] = linear(RNG, outs=12, ins=12, scale=0.3)
    expected = run(graph, events, DT, how=how, reset=reset)
    ours = evaluate(
        load_graph(graph, tmp_path, reset=reset, discretisation=how), events[None]
    ).spikes
    for depth, node in enumerate(("first", "second"), start=1):
        assert expected[node][0].any()
        np.testing.assert_array_equal(ours[node][0, depth:], expected[node][:-depth], err_msg=node)


@pytest.mark.parametrize("reset", ["zero", "subtract"])
def test_weights_of_several_delays_fit_the_formats_of_a_core(reset, tmp_path):
    layer = {
        "input": nir.Input(np.array([10])),
        "n": cuba(RNG, 12),
        "output": nir.Output(np.array([12])),
    }
    edges = [("n", "output"), ("n", "back"), ("back", "n")]
    for delay in (0, 1, 3, 7):
        layer |= {
            f"d{delay}": nir.Delay(np.full(10, delay * DT)),
            f"w{delay}": linear(RNG, outs=12, ins=10),
        }
        edges += [("input", f"d{delay}"), (f"d{delay}", f"w{delay}"), (f"w{delay}", "n")]
    graph = nir.NIRGraph({**layer, "back": BACK}, edges, type_check=False)
    events = random_spikes((10,))[None]
    match = lc.compile(
        load_graph(graph, tmp_path, reset=reset), events=events, diagnosis=False
    ).match
    assert match.spikes.agreement > 0.7
