"""Leaky integrate-and-fire neurons: the float reference against their equations, their integers, and their programs.

Weights may be dense or sparse, and delays may differ from synapse to synapse.
"""

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
from tests.support.networks import UNIT, check_bit_for_bit, recordings, single

CHIP = hw.chip("loihi-sim")


def brute_force(network, played):
    """Return spikes and potentials of one recording (steps, channels), neuron by neuron and synapse by synapse."""
    (population,) = network.populations
    neuron = population.neuron
    n = population.size
    steps = len(played)
    spikes = np.zeros((steps, n), dtype=int)
    potentials = np.zeros((steps, n))
    current = np.zeros(n)
    voltage = np.zeros(n)
    free_at = np.zeros(n, dtype=int)  # the first step in which a neuron may spike again
    for t in range(steps):
        for i in range(n):
            arrived = 0.0
            for p in network.projections:
                weights = p.weights.toarray() if sparse.issparse(p.weights) else p.weights
                delays = np.broadcast_to(p.delay, weights.shape)
                sent = played if p.source == "touch" else spikes
                for j in range(weights.shape[1]):
                    s = t - 1 - delays[i, j]
                    if s >= 0:
                        arrived += weights[i, j] * sent[s, j]
            current[i] = (1 - neuron.decay_u[i]) * current[i] + arrived
            v = (1 - neuron.decay_v[i]) * voltage[i] + current[i] + neuron.bias[i]
            if t < free_at[i]:
                v = 0.0
            elif v > neuron.threshold[i] or (neuron.rule == ">=" and v == neuron.threshold[i]):
                spikes[t, i] = 1
                free_at[i] = t + neuron.refractory[i]
            potentials[t, i] = v
            voltage[i] = 0.0 if spikes[t, i] else v
    return spikes, potentials


def random_network(seed, *, steps=25, size=3, channels=4, rule=">"):
    """Return a recurrent population with random parameters and delays; ``rule``: it spikes above or at its threshold."""
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
    reference = evaluate(network, played, potentials=True)
    spikes, potentials = brute_force(network, played[0])
    assert np.array_equal(reference.spikes["n"][0], spikes)
    np.testing.assert_allclose(reference.potential["n"][0], potentials, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize(("rule", "spikes"), [(">", 0), (">=", 1)])
def test_a_potential_exactly_at_threshold_spikes_by_its_rule(rule, spikes):
    network = single(Cuba.of(1, decay_v=1.0, threshold=0.75, rule=rule), [[0.75]])
    played = np.zeros((1, 20, 1), dtype=np.uint8)
    played[0, 3] = 1
    levels = lower(network, CHIP, weight_bits=8)
    match = compare(Observed(levels, played))
    assert match.spikes.reference_spikes == spikes
    assert match.spikes.chip_spikes == spikes


@settings(max_examples=20, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1), rule=st.sampled_from([">", ">="]), bits=st.sampled_from([2, 8])
)
def test_the_program_is_the_rounded_network_bit_for_bit(seed, rule, bits):
    network = random_network(seed, rule=rule, steps=40)
    played = recordings(network, samples=2, seed=seed)
    levels = lower(network, CHIP, bits)
    check_bit_for_bit(levels, played)


@pytest.mark.parametrize("seed", range(4))
def test_a_network_whose_numbers_the_chip_holds_spikes_as_in_float(seed):
    """Weights in 256ths of the threshold, decays on the grid, no bias: only states are rounded."""
    r = np.random.default_rng(seed)
    # The published neurons keep 0.2 of their potential per step; 4096 * 0.8 is 3276.8.
    neuron = Cuba.of(6, decay_u=1.0, decay_v=3277 / 4096, threshold=0.5)
    weights = r.integers(-255, 256, (6, 8)) / 512
    network = single(neuron, weights, steps=80)
    levels = lower(network, CHIP, weight_bits=8)
    match = compare(Observed(levels, recordings(network, samples=4, seed=seed)))
    assert match.spikes.reference_spikes > 100
    assert match.spikes.agreement > 0.995


@pytest.mark.parametrize(("rule", "units_above"), [(">", 0), (">=", 1)])
def test_all_neurons_have_one_threshold_and_each_its_scale(rule, units_above):
    """The chip spikes above its threshold, so a neuron that spikes at its threshold reaches one unit more."""
    theta = np.array([0.1, 1.0, 30.0])
    neuron = Cuba.of(3, decay_v=0.2, threshold=theta, rule=rule)
    population = quantize(single(neuron, np.ones((3, 2))), CHIP).population("n")
    mantissa = population.neuron.threshold
    assert len(set(mantissa.tolist())) == 1
    assert population.scale * theta == pytest.approx(UNIT * mantissa + units_above, rel=1e-15)


def test_sparse_weights_make_the_same_program_as_dense_ones():
    r = np.random.default_rng(0)
    weights = r.normal(0, 1, (20, 30)) * (r.random((20, 30)) < 0.2)
    neuron = Cuba.of(20, decay_v=0.2, threshold=1.0)
    dense = single(neuron, weights)
    thin = single(neuron, sparse.csr_array(weights))
    played = recordings(dense, samples=3)
    assert np.array_equal(evaluate(dense, played).spikes["n"], evaluate(thin, played).spikes["n"])
    dense_program = lower(dense, CHIP, weight_bits=8).program
    sparse_program = lower(thin, CHIP, weight_bits=8).program
    (dense_core,) = dense_program.cores
    (sparse_core,) = sparse_program.cores
    for name in ("mantissa", "target", "delay", "list_start"):
        assert np.array_equal(getattr(dense_core.axons, name), getattr(sparse_core.axons, name))
    # Zeros of a dense matrix are counted as pruned synapses; a sparse matrix does not store them.
    zeros = (weights == 0).sum()
    assert dense_program.synapses_pruned - sparse_program.synapses_pruned == zeros


def columns_first(weights):
    return sparse.csc_array(weights)


def coordinates(weights):
    return sparse.coo_array(weights)


def rows_backwards(weights):
    """Return a CSR matrix whose rows hold their entries from the last column to the first."""
    backwards = sparse.csr_array(weights)
    for first, last in itertools.pairwise(backwards.indptr):
        backwards.indices[first:last] = backwards.indices[first:last][::-1].copy()
        backwards.data[first:last] = backwards.data[first:last][::-1].copy()
    return sparse.csr_array((backwards.data, backwards.indices, backwards.indptr))


@pytest.mark.parametrize("as_stored", [columns_first, coordinates, rows_backwards])
def test_read_only_sparse_weights_are_stored_row_by_row(as_stored):
    """A read-only matrix is not copied, unless, as here, its entries are in another order than CSR's canonical one."""
    sparse_weights = as_stored(np.array([[0.0, 2.0, 5.0], [3.0, 0.0, 0.0]]))
    sparse_weights.data.setflags(write=False)
    stored = Projection("x", "n", sparse_weights).weights
    assert stored.format == "csr"
    assert stored.data.tolist() == [2.0, 5.0, 3.0]
    assert stored.indices.tolist() == [1, 2, 0]


def test_delays_of_sparse_weights_belong_to_their_entries():
    """A weight of 2 from channel 1 to neuron 0 after 5 steps, and one of 3 from channel 0 to neuron 1 at once."""
    weights = sparse.csr_array(np.array([[0.0, 2.0], [3.0, 0.0]]))
    network = single(Cuba.of(2, decay_v=1.0, threshold=1.0), weights, delay=np.array([5, 0]))
    played = np.zeros((1, 20, 2), dtype=np.uint8)
    played[0, 0] = 1
    program = lower(network, CHIP, weight_bits=8).program
    in_float = evaluate(network, played).spikes["n"][0]
    on_chip = hw.simulate(program, played[0]).spikes["n"]
    steps_and_neurons = [[1, 1], [6, 0]]
    assert np.argwhere(in_float).tolist() == steps_and_neurons
    assert np.argwhere(on_chip).tolist() == steps_and_neurons


@settings(max_examples=40)
@given(a=st.floats(0, 0.99), b=st.floats(0, 0.99), c=st.floats(0, 0.99), d=st.floats(0, 0.99))
def test_the_gain_is_the_least_squares_one(a, b, c, d):
    """The response of factors (c, d), which current and voltage keep per step, times the gain is nearest to that of (a, b)."""

    def response(x, y):
        return np.convolve(x ** np.arange(4000.0), y ** np.arange(4000.0))[:4000]

    in_float = response(a, b)
    on_chip = response(c, d)
    (gain,) = best_gain(*(np.array([factor]) for factor in (a, b, c, d)))
    assert gain == pytest.approx((in_float @ on_chip) / (on_chip @ on_chip), rel=1e-6)


@pytest.mark.parametrize(
    ("a", "b", "c", "d", "gain"),
    [(0.5, 1.0, 0.6, 1.0, 0.8), (1.0, 1.0, 1.0, 1.0, 1.0), (0.0, 1.0, 0.0, 1.0, 1.0)],
    ids=["integrator with current", "two integrators", "integrate-and-fire"],
)
def test_the_gain_of_an_integrator_keeps_the_value_at_which_it_ends(a, b, c, d, gain):
    """An integrator keeps all of its voltage (a factor of 1), so its response has no finite sum of squares."""
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
def test_a_neuron_that_no_scale_fits_is_refused(neuron, message):
    with pytest.raises(TargetError) as caught:
        quantize(single(neuron), CHIP)
    assert str(caught.value) == message


def test_a_population_without_inputs_runs_on_its_bias():
    network = single(Cuba.of(1, decay_v=0.1, threshold=1.0, bias=0.3), np.zeros((1, 1)), steps=30)
    levels = lower(network, CHIP, weight_bits=8)
    match = compare(Observed(levels, np.zeros((1, 30, 1), dtype=np.uint8)))
    assert match.spikes.reference_spikes == match.spikes.common_spikes == 7


def test_populations_are_stepped_together_only_where_they_feed_each_other():
    """Here b and c feed each other; d feeds only itself, and n hears nothing."""
    network = single(Cuba.of(1, decay_v=1.0, threshold=1.0))
    neuron = network.populations[0].neuron
    names = ("d", "c", "b", "a", "n")
    edges = (("touch", "a"), ("a", "b"), ("b", "c"), ("c", "b"), ("c", "d"), ("d", "d"))
    weight = matrix([[1.0]], np.float64)
    network = replace(
        network,
        populations=tuple(Population(name, "time", 1, neuron) for name in names),
        projections=tuple(Projection(source, target, weight) for source, target in edges),
    )
    groups = [[population.name for population in group] for group in evaluation_order(network)]
    assert groups == [["a"], ["c", "b"], ["d"], ["n"]]


def test_the_fit_of_a_threshold_beyond_the_charge_of_a_step_is_measured_without_a_wrap():
    """Outputs that are read by potential have such thresholds."""
    network = single(Cuba.of(1, decay_v=1.0, threshold=1.0), [[0.001]])
    population = quantize(network, CHIP).population("n")
    assert 64 * population.neuron.threshold[0] >= 2**CHIP.registers.charge_bits
    assert population.fit.input_max == 0.0
    assert population.fit.input_rms == 0.0
