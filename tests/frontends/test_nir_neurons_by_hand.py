"""The neurons that a NIR node becomes, at the limits of every rule; the expected numbers are worked out by hand."""

import math
from fractions import Fraction

import nir
import numpy as np
import pytest
from scipy import sparse

from locsnn_compile.errors import InputError
from locsnn_compile.frontends.nir.graph import NirNode
from locsnn_compile.frontends.nir.neurons import Reading, neurons_of
from locsnn_compile.frontends.nir.signals import Signal, compact
from locsnn_compile.network.neurons import Cuba, SoftCuba
from tests.support.nir_graphs import DT, chain, lif, linear, load_graph

RNG = np.random.default_rng(2)
# Parameters of nodes, with time constants in steps.
LIF = {"tau": 4.0, "r": 1.0, "v_leak": 0.0, "v_reset": 0.0, "v_threshold": 1.0}
CUBA = {
    "tau_syn": 2.0,
    "tau_mem": 4.0,
    "r": 1.0,
    "w_in": 1.0,
    "v_leak": 0.0,
    "v_reset": 0.0,
    "v_threshold": 1.0,
}
LI = {"tau": 2.0, "r": 1.0, "v_leak": 0.0}


def two_neurons(
    kind, parameters, how="euler", reset="zero", weights=((1.0,), (1.0,)), constant=0.0
):
    """Return the neurons of a node of two neurons, behind weights and a constant; a step lasts 1 s."""
    node = NirNode(kind, {name: np.array(value) for name, value in parameters.items()})
    matrix = sparse.csr_array(np.array(weights))
    signal = Signal.of_source("x", matrix.shape[1]).through(matrix, constant, "n")
    return neurons_of(node, signal, 2, Reading(dt=1.0, discretisation=how, reset=reset), "n")


REFUSED = {
    "tau of 0": ("LIF", LIF | {"tau": 0.0}, "exact", "n: tau must be above 0 (0). Correct it."),
    "threshold at the reset": (
        "LIF",
        LIF | {"v_threshold": 0.0},
        "euler",
        "n: the threshold is not above the reset (by 0). Train with a threshold above v_reset and v_leak, and above 0.",
    ),
    "r without end": (
        "LIF",
        LIF | {"r": np.inf},
        "euler",
        "n: r is infinite, and its tau is not. Give both as numbers.",
    ),
    "r and tau without end, downwards": (
        "LIF",
        LIF | {"r": -np.inf, "tau": np.inf},
        "euler",
        "n: r is infinite, and its tau is not. Give both as numbers.",
    ),
}


@pytest.mark.parametrize(("kind", "parameters", "how", "message"), REFUSED.values(), ids=REFUSED)
def test_parameters_that_are_refused(kind, parameters, how, message):
    with pytest.raises(InputError) as caught:
        two_neurons(kind, parameters, how)
    assert str(caught.value) == message


@pytest.mark.parametrize(
    ("leak", "start"), [(0.5, 0.5), (1.0, 0.0), (1.5, 0.0)], ids=["below", "at", "above"]
)
def test_neurons_start_at_rest_where_that_is_below_the_threshold(leak, start):
    neurons = two_neurons("LIF", LIF | {"v_leak": leak})
    assert neurons.start_potential.tolist() == [start, start]


@pytest.mark.parametrize(
    ("tau_syn", "kind"), [([1.0, 1.0], Cuba), ([1.0, 2.0], SoftCuba)], ids=["none has", "one has"]
)
def test_neurons_with_subtraction_are_soft_if_any_of_them_has_a_current(tau_syn, kind):
    assert (
        type(two_neurons("CubaLIF", CUBA | {"tau_syn": tau_syn}, reset="subtract").neuron) is kind
    )


@pytest.mark.parametrize(
    ("leak", "above"),
    [([0.3, 0.3], [0.0, 0.0]), ([0.3, 0.4], [0.3, 0.4])],
    ids=["one for all", "one each"],
)
def test_potentials_of_a_readout_are_counted_from_rest_where_that_is_one_for_all(leak, above):
    readout = two_neurons("LI", LI | {"v_leak": leak})
    assert readout.start_potential.tolist() == above
    # A bias of v_leak * dt / tau, with a tau of 2 steps, holds the potential there.
    assert readout.neuron.bias.tolist() == [value / 2 for value in above]


def test_a_readout_has_the_threshold_that_no_input_of_any_neuron_reaches():
    """In every step, half of the input is added and half of the potential lost, so steady input settles at its sum.

    The largest is that of the second neuron, downwards: -9 by a spike and -4 by the constant. A tenth more leaves room
    for rounding.
    """
    readout = two_neurons("LI", LI, weights=[[1.0, -1.0], [3.0, -9.0]], constant=-4.0)
    assert readout.neuron.threshold.tolist() == [13.0 * 1.1] * 2


def test_the_exact_response_of_equal_and_other_time_constants():
    """With tau_mem 4: exp(-1/4) / 4^2 if tau_syn is 4 too, else (exp(-1/4) - exp(-1/2)) / (4 - 2) for tau_syn 2."""
    neurons = two_neurons("CubaLIF", CUBA | {"tau_syn": [4.0, 2.0]}, how="exact")
    gains = neurons.signal.terms[0].weights.toarray().ravel()
    of_equal_taus = math.exp(-1 / 4) / 4**2
    of_other_taus = (math.exp(-1 / 4) - math.exp(-1 / 2)) / (4 - 2)
    assert gains == pytest.approx([of_equal_taus, of_other_taus], rel=1e-12)


def test_r_and_tau_without_end_are_those_of_neurons_that_add_whole_weights():
    neurons = two_neurons("LIF", LIF | {"r": np.inf, "tau": np.inf}, weights=[[3.0], [4.0]])
    assert neurons.neuron.decay_v.tolist() == [0.0, 0.0]
    assert neurons.signal.terms[0].weights.toarray().tolist() == [[3.0], [4.0]]


@pytest.mark.parametrize(
    ("weights", "is_dense"),
    [([[1.0, 2.0], [3.0, 0.0]], True), ([[1.0, 2.0], [0.0, 0.0]], True), ([[1.0, 0.0], [0.0, 0.0]], False)],
    ids=["three of four", "half", "a quarter"],
)  # fmt: skip
def test_weights_are_held_densely_from_half_of_all_connections_up(weights, is_dense):
    held = compact(sparse.csr_array(np.array(weights)))
    assert sparse.issparse(held) is not is_dense
    assert (held if is_dense else held.toarray()).tolist() == weights


def test_a_start_is_set_by_charges_of_which_a_current_keeps_nothing(tmp_path):
    """With the potential at 0.5 before step 0, (1 - decay_v)^2 of it is missing in step 1: a quarter with tau_mem 2.

    The current of the second neuron keeps half of this charge, which is taken back a step later.
    """
    parameters = {name: np.full(2, value) for name, value in CUBA.items()}
    parameters |= {
        "tau_syn": np.array([1.0, 2.0]),
        "tau_mem": np.full(2, 2.0),
        "v_leak": np.full(2, 0.5),
    }
    graph = chain((1,), ("w", nir.Linear(np.ones((2, 1)))), ("n", nir.CubaLIF(**parameters)))
    network = load_graph(graph, tmp_path, dt=1.0)
    starts = [p for p in network.projections if (p.source, p.target) == ("nir/start", "n")]
    charges = {p.delay: np.asarray(p.weights).ravel().tolist() for p in starts}
    assert charges == {0: [0.125, 0.125], 1: [0.0, -0.0625]}


def test_weights_for_another_number_of_inputs_are_refused(tmp_path):
    graph = chain((3,), ("w", nir.Linear(np.ones((2, 4)))), ("n", lif(RNG, 2)))
    with pytest.raises(InputError) as caught:
        load_graph(graph, tmp_path)
    assert str(caught.value) == (
        "model 'graph.nir', node 'w': its input has another size (3 against 4). Correct its weight."
    )


def test_a_constant_passes_through_weights_scales_and_delays():
    weights = sparse.csr_array(np.array([[1.0, 2.0], [0.0, 4.0]]))
    signal = (
        Signal.of_source("x", 2)
        .through(weights, np.array([1.0, 2.0]), "n")
        .through(weights, 0.5, "n")
    )
    assert signal.constant.tolist() == [5.5, 8.5]
    assert signal.scaled(np.array([3.0, 0.5])).constant.tolist() == [16.5, 4.25]
    delayed = signal.delayed(np.array([1, 0]))
    assert delayed.constant.tolist() == [5.5, 8.5]
    assert [(onset.delay, onset.values.tolist()) for onset in delayed.constants] == [
        (0, [0.0, 8.5]),
        (1, [5.5, 0.0]),
    ]


@pytest.mark.parametrize(
    ("delay", "measured"), [(2.3, "2.3"), (2.02, "2.02"), (-1.0, "-1"), (1e7, "1e+07")]
)
def test_delays_between_steps_or_out_of_range_are_refused(delay, measured, tmp_path):
    graph = chain(
        (3,),
        ("d", nir.Delay(np.full(3, delay * DT))),
        ("w", linear(RNG, outs=3, ins=3)),
        ("n", lif(RNG, 3)),
    )
    with pytest.raises(InputError) as caught:
        load_graph(graph, tmp_path)
    assert str(caught.value) == (
        "model 'graph.nir', node 'd': a delay is not a whole number of steps from 0 to 1e+06 "
        f"({measured} steps of 0.001 s). Correct it, or give another --dt."
    )


def test_a_delay_of_more_steps_than_a_float_holds_is_refused_without_a_warning(tmp_path):
    """1e308 s are 1e311 steps, more than float64 holds. Warnings are errors in these tests."""
    delay = nir.Delay(np.array([1e308]))
    graph = chain((1,), ("d", delay), ("w", linear(RNG, outs=1, ins=1)), ("n", lif(RNG, 1)))
    with pytest.raises(InputError) as caught:
        load_graph(graph, tmp_path)
    assert str(caught.value) == (
        "model 'graph.nir', node 'd': a delay is not a whole number of steps from 0 to 1e+06 "
        "(inf steps of 0.001 s). Correct it, or give another --dt."
    )


@pytest.mark.parametrize("dt", [DT, 1e-4, 1 / 300, 7e-5])
@pytest.mark.parametrize("off", [0.0, 0.009, -0.009])
def test_delays_are_the_nearest_whole_steps(dt, off, tmp_path):
    """Files hold delays in seconds, steps times dt in floats, which may be off by up to a hundredth of a step."""
    steps = np.arange(1, 60)
    delay = nir.Delay((steps + off) * dt)
    graph = chain((59,), ("d", delay), ("w", nir.Linear(np.eye(59))), ("n", lif(RNG, 59)))
    (projection,) = load_graph(graph, tmp_path, dt=dt).projections
    assert np.asarray(projection.delay).ravel().tolist() == steps.tolist()
    # Fractions of the same floats have no rounding error of their own.
    exact = [round(Fraction(float(seconds)) / Fraction(dt)) for seconds in delay.delay]
    assert exact == steps.tolist()


def test_potentials_count_from_where_the_deepest_readout_begins(tmp_path):
    one = np.ones(2)
    readout = nir.LI(tau=0.01 * one, r=one, v_leak=0 * one)
    nodes = {
        "input": nir.Input(np.array([3])),
        "w": linear(RNG, outs=2, ins=3),
        "near": readout,
        "lif": lif(RNG, 2),
    }
    nodes |= {"w2": linear(RNG, outs=2, ins=2), "far": readout, "output": nir.Output(np.array([2]))}
    edges = [
        ("input", "w"),
        ("w", "near"),
        ("w", "lif"),
        ("lif", "w2"),
        ("w2", "far"),
        ("near", "output"),
    ]
    network = load_graph(
        nir.NIRGraph(nodes, [*edges, ("far", "output")], type_check=False), tmp_path
    )
    assert (network.readout.populations, network.readout.potentials_from) == (("near", "far"), 2)
