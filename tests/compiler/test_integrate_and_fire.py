"""Leaky integrate-and-fire neurons: reference against the equations, and what quantising and lowering makes of them."""

import itertools
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import sparse

import hw_model as hw
from locsnn_compile.errors import TargetError
from locsnn_compile.network.network import Population
from locsnn_compile.network.neurons import Cuba
from locsnn_compile.network.projections import Projection, matrix
from locsnn_compile.passes.kernels import best_gain
from locsnn_compile.passes.quantize import quantize
from locsnn_compile.pipeline import lower
from locsnn_compile.reference.evaluate import evaluate, evaluation_order
from locsnn_compile.verification.matching import compare
from locsnn_compile.verification.observation import Observed
from tests.support.networks import UNIT, recordings, single

CHIP = hw.chip("loihi-sim")


def brute_force(network, played):
    """The equations neuron by neuron and synapse by synapse, on one recording (steps, channels)."""
    population, neuron = network.populations[0], network.populations[0].neuron
    n, steps = population.size, len(played)
    spikes, potentials = np.zeros((steps, n), dtype=int), np.zeros((steps, n))
    current, voltage, free_at = np.zeros(n), np.zeros(n), np.zeros(n, dtype=int)
    for t in range(steps):
        for i in range(n):
            arrived = 0.0
            for p in network.projections:
                weights = p.weights.toarray() if sparse.issparse(p.weights) else p.weights
                delays = np.broadcast_to(p.delay, weights.shape)
                sent = played if p.source == "touch" else spikes
                for j in range(weights.shape[1]):
                    s = t - 1 - delays[i, j]
                    arrived += weights[i, j] * sent[s, j] if s >= 0 else 0.0
            current[i] = (1 - neuron.decay_u[i]) * current[i] + arrived
            v = (1 - neuron.decay_v[i]) * voltage[i] + current[i] + neuron.bias[i]
            if t < free_at[i]:
                v = 0.0
            elif v > neuron.threshold[i] or (neuron.rule == ">=" and v == neuron.threshold[i]):
                spikes[t, i], free_at[i] = 1, t + neuron.refractory[i]
            potentials[t, i] = v
            voltage[i] = 0.0 if spikes[t, i] else v
    return spikes, potentials


def random_network(seed, *, steps=25, size=3, channels=4, rule=">"):
    r = np.random.default_rng(seed)
    neuron = Cuba.of(
        size,
        decay_u=r.choice([0.3, 1.0]),
        decay_v=r.uniform(0, 1, size),
        threshold=r.uniform(0.3, 1.5, size),
        bias=r.normal(0, 0.1, size),
        refractory=r.integers(1, 5, size),
        rule=rule,
    )
    weights = np.round(r.normal(0.2, 0.5, (size, channels)), 2)
    delay = r.integers(0, 4, size=weights.shape) if r.random() < 0.5 else int(r.integers(0, 3))
    return single(
        neuron,
        weights,
        steps=steps,
        recurrent=np.round(r.normal(0, 0.4, (size, size)), 2),
        delay=delay,
    )


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), rule=st.sampled_from([">", ">="]))
def test_the_reference_is_the_equations(seed, rule):
    network = random_network(seed, rule=rule)
    played = recordings(network, samples=1, seed=seed)
    found = evaluate(network, played, potentials=True)
    spikes, potentials = brute_force(network, played[0])
    assert np.array_equal(found.spikes["n"][0], spikes)
    np.testing.assert_allclose(found.potential["n"][0], potentials, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize(("rule", "spikes"), [(">", 0), (">=", 1)])
def test_a_potential_exactly_at_threshold(rule, spikes):
    network = single(Cuba.of(1, decay_v=1.0, threshold=0.75, rule=rule), [[0.75]])
    played = np.zeros((1, 20, 1), dtype=np.uint8)
    played[0, 3] = 1
    levels = lower(network, CHIP, weight_bits=8)
    match = compare(Observed(levels, played))
    assert (match.spikes.reference_spikes, match.spikes.chip_spikes) == (spikes, spikes)


@settings(max_examples=20, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1), rule=st.sampled_from([">", ">="]), bits=st.sampled_from([2, 8])
)
def test_the_program_is_the_rounded_network_bit_for_bit(seed, rule, bits):
    network = random_network(seed, rule=rule, steps=40)
    played = recordings(network, samples=2, seed=seed)
    levels = lower(network, CHIP, bits)
    wanted = evaluate(levels.quantized.on_grid(), played, potentials=True)
    found = hw.simulate(levels.program, played, probe=("spikes", "potential"))
    assert np.array_equal(found.spikes["n"], wanted.spikes["n"])
    assert np.array_equal(found.potential["n"], wanted.potential["n"])


@pytest.mark.parametrize("seed", range(4))
def test_a_network_whose_numbers_the_chip_holds_spikes_as_in_float(seed):
    """Weights in 256ths of the threshold, decays on the grid, no bias: only states are rounded."""
    r = np.random.default_rng(seed)
    # 3277 is the decay of the published 0.2 that is kept: 4096 * 0.8 is 3276.8.
    neuron = Cuba.of(6, decay_u=1.0, decay_v=3277 / 4096, threshold=0.5)
    weights = r.integers(-255, 256, (6, 8)) / 512
    network = single(neuron, weights, steps=80)
    levels = lower(network, CHIP, weight_bits=8)
    match = compare(Observed(levels, recordings(network, samples=4, seed=seed)))
    assert match.spikes.reference_spikes > 100
    assert match.spikes.agreement > 0.995


def test_one_threshold_for_all_and_a_scale_for_each():
    theta = np.array([0.1, 1.0, 30.0])
    for rule, over in ((">", 0), (">=", 1)):
        quantized = quantize(
            single(Cuba.of(3, decay_v=0.2, threshold=theta, rule=rule), np.ones((3, 2))), CHIP
        )
        population = quantized.population("n")
        mantissa = population.neuron.threshold
        assert len(set(mantissa.tolist())) == 1
        assert population.scale * theta == pytest.approx(UNIT * mantissa + over, rel=1e-15)


def test_sparse_weights_make_the_same_program_as_dense_ones():
    r = np.random.default_rng(0)
    weights = r.normal(0, 1, (20, 30)) * (r.random((20, 30)) < 0.2)
    neuron = Cuba.of(20, decay_v=0.2, threshold=1.0)
    dense, thin = (single(neuron, w) for w in (weights, sparse.csr_array(weights)))
    played = recordings(dense, samples=3)
    assert np.array_equal(evaluate(dense, played).spikes["n"], evaluate(thin, played).spikes["n"])
    of_dense = lower(dense, CHIP, weight_bits=8).program
    of_sparse = lower(thin, CHIP, weight_bits=8).program
    (dense_core,) = of_dense.cores
    (sparse_core,) = of_sparse.cores
    for name in ("mantissa", "target", "delay", "list_start"):
        assert np.array_equal(getattr(dense_core.axons, name), getattr(sparse_core.axons, name))
    # A dense matrix has its zeros pruned, which a sparse one does not hold.
    assert of_dense.synapses_pruned - of_sparse.synapses_pruned == (weights == 0).sum()


def columns_first(weights):
    return sparse.csc_array(weights)


def coordinates(weights):
    return sparse.coo_array(weights)


def entries_of_a_row_in_any_order(weights):
    backwards = sparse.csr_array(weights)
    for first, last in itertools.pairwise(backwards.indptr):
        backwards.indices[first:last] = backwards.indices[first:last][::-1].copy()
        backwards.data[first:last] = backwards.data[first:last][::-1].copy()
    return sparse.csr_array((backwards.data, backwards.indices, backwards.indptr))


@pytest.mark.parametrize("stored", [columns_first, coordinates, entries_of_a_row_in_any_order])
def test_weights_that_cannot_be_written_to_are_held_row_by_row(stored):
    """Only what is read-only and in canonical order already is held as it is."""
    weights = np.array([[0.0, 2.0, 5.0], [3.0, 0.0, 0.0]])
    given = stored(weights)
    given.data.setflags(write=False)
    held = Projection("x", "n", given).weights
    assert held.format == "csr"
    assert held.data.tolist() == [2.0, 5.0, 3.0]
    assert held.indices.tolist() == [1, 2, 0]


def test_delays_of_sparse_weights_go_with_their_entries():
    weights = sparse.csr_array(np.array([[0.0, 2.0], [3.0, 0.0]]))
    network = single(Cuba.of(2, decay_v=1.0, threshold=1.0), weights, delay=np.array([5, 0]))
    played = np.zeros((1, 20, 2), dtype=np.uint8)
    played[0, 0] = 1
    for spikes in (
        evaluate(network, played).spikes["n"][0],
        hw.simulate(lower(network, CHIP, weight_bits=8).program, played[0]).spikes["n"],
    ):
        assert np.argwhere(spikes).tolist() == [[1, 1], [6, 0]]


@settings(max_examples=40)
@given(
    a=st.floats(0, 0.99), b=st.floats(0, 0.99), c=st.floats(0, 0.99), d=st.floats(0, 0.99)
)  # fmt: skip
def test_the_gain_is_the_least_squares_one(a, b, c, d):
    def answer(x, y):
        return np.convolve(x ** np.arange(4000.0), y ** np.arange(4000.0))[:4000]

    wanted, own = answer(a, b), answer(c, d)
    (gain,) = best_gain(*(np.array([x]) for x in (a, b, c, d)))
    assert gain == pytest.approx((wanted @ own) / (own @ own), rel=1e-6)


@pytest.mark.parametrize(
    ("a", "b", "c", "d", "gain"),
    [(0.5, 1.0, 0.6, 1.0, 0.8), (1.0, 1.0, 1.0, 1.0, 1.0), (0.0, 1.0, 0.0, 1.0, 1.0)],
    ids=["integrator with current", "two integrators", "integrate-and-fire"],
)
def test_of_an_integrator_the_end_is_kept(a, b, c, d, gain):
    assert best_gain(*(np.array([x]) for x in (a, b, c, d))) == pytest.approx([gain])


def test_a_bias_settles_where_it_does_in_float():
    neuron = Cuba.of(4, decay_v=0.013, threshold=1.0, bias=np.array([0.0, 0.001, -0.02, 0.0129]))
    quantized = quantize(single(neuron, np.full((4, 1), 0.1)), CHIP).population("n")
    bias = quantized.neuron.bias_mantissa << quantized.neuron.bias_exponent
    settled = bias / (quantized.neuron.decay_v / 4096) / quantized.scale
    assert settled == pytest.approx(neuron.bias / neuron.decay_v, abs=1e-4)


@pytest.mark.parametrize(
    ("neuron", "message"),
    [
        (
            Cuba.of(1, decay_v=1e-5, threshold=1.0),
            "population 'n': decay_v: the decay rounds to 0, so the potential would never decay "
            "(1e-05 lost in a step against at least 0.000122). Use a shorter time constant or a longer step.",
        ),
        (
            Cuba.of(1, decay_v=0.5, threshold=1e-6),
            "population 'n': no scale holds both the threshold and the largest weight "
            "(one weight reaches 1e+06 thresholds against 32640). Train with smaller weights, or a higher threshold.",
        ),
    ],
    ids=["decay", "threshold"],
)
def test_what_no_scale_fits(neuron, message):
    with pytest.raises(TargetError) as caught:
        quantize(single(neuron), CHIP)
    assert str(caught.value) == message


def test_a_population_without_inputs_runs_on_its_bias():
    network = single(Cuba.of(1, decay_v=0.1, threshold=1.0, bias=0.3), np.zeros((1, 1)), steps=30)
    levels = lower(network, CHIP, weight_bits=8)
    match = compare(Observed(levels, np.zeros((1, 30, 1), dtype=np.uint8)))
    assert match.spikes.reference_spikes == match.spikes.common_spikes == 7


def test_populations_are_stepped_together_only_where_they_feed_each_other():
    network = single(Cuba.of(1, decay_v=1.0, threshold=1.0))
    neuron = network.populations[0].neuron
    names = ("d", "c", "b", "a", "n")
    edges = (("touch", "a"), ("a", "b"), ("b", "c"), ("c", "b"), ("c", "d"), ("d", "d"))
    one = matrix([[1.0]], np.float64)
    bigger = replace(
        network,
        populations=tuple(Population(name, "time", 1, neuron) for name in names),
        projections=tuple(Projection(a, b, one) for a, b in edges),
    )
    assert [[p.name for p in together] for together in evaluation_order(bigger)] == [
        ["a"],
        ["c", "b"],
        ["d"],
        ["n"],
    ]


def test_the_fit_of_a_threshold_beyond_the_charge_of_a_step_is_measured_without_a_wrap():
    """Outputs that are read by potential have such thresholds."""
    found = quantize(single(Cuba.of(1, decay_v=1.0, threshold=1.0), [[0.001]]), CHIP).population(
        "n"
    )
    assert 64 * found.neuron.threshold[0] >= 2**CHIP.registers.charge_bits
    assert (found.fit.input_max, found.fit.input_rms) == (0.0, 0.0)
