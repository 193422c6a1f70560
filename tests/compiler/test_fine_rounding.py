"""Fine rounding: each of its parts alone, and how many spikes it saves.

Its parts are formats (grades) chosen by the size of a weight, a second synapse for the remainder of a weight (split),
weights of a neuron rounded together so that their errors cancel on calibration recordings, decays fitted to a kernel, and
a scale for each neuron. ``FINE`` has all of them, ``NEAREST`` none.
"""

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import sparse

import hw_model as hw
from hw_model.arithmetic.fixed_point import (
    WEIGHT_BITS,
    WEIGHT_EXPONENTS,
    effective_weight,
    weight_grid,
)
from locsnn_compile.data.recordings import Recordings
from locsnn_compile.network.neurons import SrmAlpha
from locsnn_compile.passes.kernels import one_decay, two_decays
from locsnn_compile.passes.rounding.grades import Grades, coarsest, nearest
from locsnn_compile.passes.rounding.task import FINE, NEAREST, Rounding
from locsnn_compile.passes.rounding.together import Metric, round_together
from locsnn_compile.passes.srm.fine import RIDGE, drive_of
from locsnn_compile.pipeline import lower
from locsnn_compile.reference.evaluate import SAMPLES, calibrate
from locsnn_compile.verification.matching import compare
from locsnn_compile.verification.observation import Observed
from tests.support.networks import (
    DECAY_OF_10,
    NEURON,
    TAU_ON_GRID,
    check_bit_for_bit,
    hybrid,
    recordings,
    single,
)

CHIP = hw.chip("loihi-sim")


def calibrated(network, samples=6, seed=5, rate=0.3):
    """Return the calibration of a network (spikes of its inputs and populations) on random recordings."""
    spikes = recordings(network, samples=samples, seed=seed, rate=rate)
    made_up = Recordings(spikes, labels=None, step_seconds=None, source="made up")
    return calibrate(network, made_up, CHIP.registers)


def lower_fine(network, *, weight_bits=8, split=0.0, calibration=None):
    """Return a network at every level with fine rounding; without a calibration, weights are rounded one by one."""
    rounding = replace(FINE, split=split)
    return lower(
        network,
        CHIP,
        weight_bits=weight_bits,
        strategy="dendrite",
        rounding=rounding,
        calibration=calibration,
    )


# --- formats by size ---


@settings(max_examples=100, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    bits=st.sampled_from(WEIGHT_BITS),
    largest=st.floats(0.1, 30_000),
    count=st.sampled_from([1, 2, 3]),
    share=st.sampled_from([0.0, 0.5, 1.0]),
)
def test_synapses_of_a_weight_are_on_the_grid_and_add_up(seed, bits, largest, count, share):
    """Grade k holds multiples of 2^k quanta (a quantum is 64 units); a split weight has a synapse in two grades."""
    r = np.random.default_rng(seed)
    ideal = r.uniform(-largest, largest, (4, 5)) ** 3 / largest**2
    grades = Grades.holding(float(np.abs(ideal).max()), bits, count=count, split=share > 0)
    grade = grades.grade(np.abs(ideal))
    split = r.random(ideal.shape) < share
    step = 1 << np.where(split, grades.second_grade(grade), grade)
    quanta = nearest(ideal, step, grades.largest_of(grade))
    parts = list(grades.parts(quanta, grade, split))
    total = np.zeros(ideal.shape)
    for mantissa, exponent in parts:
        total += effective_weight(mantissa, exponent)
        assert not weight_grid(bits, "excitatory").off_grid(np.abs(mantissa)).any()
        assert exponent in WEIGHT_EXPONENTS
    assert np.array_equal(total, 64 * quanta)
    # Three grades, and as many finer ones for second synapses.
    assert len(parts) <= 6
    fits = np.abs(ideal) <= grades.largest_of(grade)
    assert (np.abs(quanta - ideal) <= step / 2)[fits].all()


def test_a_weight_takes_the_finest_grade_that_holds_it():
    """With 8 bits a grade holds 255 steps; a weight must leave room for one, so 254, 508 and 1016 are the limits."""
    grades = Grades.holding(largest=1000.0, weight_bits=8)
    assert grades == Grades(8, (0, 1, 2))
    magnitudes = np.array([0.0, 254.0, 254.5, 508.0, 509.0, 1000.0])
    assert grades.grade(magnitudes).tolist() == [0, 0, 1, 1, 2, 2]
    assert [grades.exponent(k) for k in grades.numbers] == [0, 1, 2]
    assert Grades.holding(largest=1000.0, weight_bits=8, count=1) == Grades(8, (2,))
    assert Grades.holding(largest=1e9, weight_bits=8) == Grades(8, (4, 5, 6, 7))
    assert coarsest(8) == 7


def test_split_weights_of_few_bits_are_as_fine_as_one_of_twice_the_bits():
    grades = Grades.holding(largest=1000.0, weight_bits=4, count=3, split=True)
    assert grades == Grades(4, (1, 2, 3, 5, 6, 7))
    assert grades.second_grade(np.array([7, 6, 5, 3, 1])).tolist() == [3, 2, 1, 1, 1]


# --- weights rounded together ---


def error(gram, ideal, quanta):
    """Return the mean squared error of each neuron's potential, up to a factor, for rounded weights."""
    return np.einsum("ij,jk,ik->i", quanta - ideal, gram, quanta - ideal)


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_few_weights_are_rounded_nearly_as_well_as_any_rounding_could(seed):
    """Compared with the best of all 3^4 roundings next to the nearest one."""
    r = np.random.default_rng(seed)
    x = r.normal(size=(50, 4)) + r.normal(size=(50, 1)) * 2
    gram = x.T @ x
    ideal = r.uniform(-9, 9, (3, 4))
    step = r.choice([1, 2, 4], size=(3, 4))
    most = np.full((3, 4), 100)
    rounded = round_together(Metric.of(gram), ideal, step, most, beam=32)
    nearest_rounding = np.rint(ideal / step) * step
    errors = []
    for moves in itertools.product((-1, 0, 1), repeat=4):
        errors.append(error(gram, ideal, nearest_rounding + step * np.array(moves)))
    least_errors = np.min(errors, axis=0)
    assert error(gram, ideal, rounded).sum() <= 1.5 * least_errors.sum() + 1e-9
    assert (rounded % step == 0).all()


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), beam=st.sampled_from([1, 4]))
def test_rounding_together_keeps_limits_and_zeros(seed, beam):
    r = np.random.default_rng(seed)
    x = r.normal(size=(60, 9))
    ideal = r.normal(0, 30, (20, 9))
    step = r.choice([0, 1, 8], size=ideal.shape)
    most = 24
    metric = Metric.of(x.T @ x + np.eye(9))
    rounded = round_together(metric, ideal, step, np.full(ideal.shape, most), beam)
    assert (np.abs(rounded) <= most).all()
    assert (rounded[step == 0] == 0).all()
    assert (rounded[step == 8] % 8 == 0).all()


def test_without_correlation_every_weight_is_the_nearest():
    ideal = np.random.default_rng(0).normal(0, 9, (5, 6))
    uncorrelated = Metric.of(np.diag(np.arange(1.0, 7)))
    step = np.ones((5, 6), int)
    most = np.full((5, 6), 99)
    rounded = round_together(uncorrelated, ideal, step, most, beam=4)
    assert np.array_equal(rounded, np.rint(ideal))


# --- decays ---


@pytest.mark.parametrize("tau", [0.05, 0.5, 1.0, 2.0, 10.0, 33.0, 100.0, 4000.0])
def test_two_decays_fit_no_worse_than_one_and_as_stated(tau):
    u, v, gain, stated_error = two_decays(tau, "tau")
    assert stated_error <= one_decay(tau, "tau").error + 1e-9
    k = np.arange(1, int(40 * tau) + 50, dtype=float)
    keep_u = 1 - u / 4096
    keep_v = 1 - v / 4096
    if u == v:
        response = k * keep_u ** (k - 1)
    else:
        response = (keep_u**k - keep_v**k) / (keep_u - keep_v)
    kernel = k / tau * np.exp(1 - k / tau)
    error = math.sqrt(((kernel - gain * response) ** 2).sum() / (kernel**2).sum())
    assert error == pytest.approx(stated_error, abs=1e-6)


def test_the_published_time_constant_takes_two_decays():
    assert two_decays(10.0, "tau")[:2] == (379, 401)
    # A time constant whose decay is exactly 390 takes it twice.
    assert two_decays(TAU_ON_GRID, "tau")[:2] == (DECAY_OF_10, DECAY_OF_10)


# --- statistics of the inputs, from calibration recordings ---


def test_the_moments_are_those_of_the_kernels():
    """Gram matrix and ideal weights against sums over all spikes, with the kernels written out."""
    steps = 12
    delay = 2
    tau = NEURON.tau_sr
    weights = np.random.default_rng(0).normal(0, 4, (2, 3))
    network = single(NEURON, weights, steps=steps, delay=delay)
    calibration = calibrated(network, samples=3)
    u, v, gain, _ = two_decays(tau, "tau")
    (projection,) = network.projections
    drive = drive_of(NEURON, (projection,), (u, v), gain, calibration)
    spikes = calibration.spikes["touch"].astype(float)
    k = np.arange(1, steps + 1)
    chip_response = ((1 - u / 4096) ** k - (1 - v / 4096) ** k) / ((v - u) / 4096)
    # What each input adds to a potential: on the chip, and in the float network.
    on_chip = np.zeros((3, steps, 3))
    in_float = np.zeros((3, steps, 3))
    for t in range(steps):
        for lag in range(1, t - delay + 1):
            sent = spikes[:, t - lag - delay]
            on_chip[:, t] += chip_response[lag - 1] * sent
            in_float[:, t] += lag / tau * math.exp(1 - lag / tau) * sent
    x = on_chip.reshape(-1, 3)
    float_potential = in_float.reshape(-1, 3) @ weights.T
    gram = x.T @ x
    # The ridge keeps weights of silent inputs at their float values.
    ridge = RIDGE / 3 * np.trace(gram) / 3
    with_ridge = gram + ridge * np.eye(3)
    assert np.allclose(drive.gram * len(x), with_ridge)
    assert np.allclose(drive.ideal @ with_ridge, float_potential.T @ x + ridge * gain * weights)
    # Spikes of the last delay + 1 steps act after the end.
    assert np.allclose(drive.rate, spikes[:, : -delay - 1].sum(axis=(0, 1)) / 3)


def test_strategies_of_the_same_decays_share_the_statistics_of_the_inputs():
    network = single(NEURON, np.random.default_rng(0).normal(0, 4, (2, 3)))
    calibration = calibrated(network)
    projections = network.projections
    drive = drive_of(NEURON, projections, (379, 401), 1.0, calibration)
    assert drive_of(NEURON, projections, (379, 401), 1.0, calibration) is drive
    assert drive.metric is drive.metric
    other_calibration = calibrated(network, seed=6)
    assert drive_of(NEURON, projections, (390, 390), 1.0, calibration) is not drive
    assert drive_of(NEURON, projections, (379, 401), 2.0, calibration) is not drive
    assert drive_of(NEURON, projections, (379, 401), 1.0, other_calibration) is not drive


@pytest.mark.parametrize(
    ("weights", "delay", "rate"),
    [
        (sparse.csr_array(np.eye(3)), 0, 0.5),
        (np.eye(3), np.arange(9).reshape(3, 3), 0.5),
        (np.eye(3), 0, 0.0),
    ],
    ids=["sparse", "delays", "silence"],
)
def test_without_statistics_of_the_inputs_weights_are_rounded_one_by_one(weights, delay, rate):
    """Statistics are computed for dense weights of one delay, and need spikes."""
    network = single(NEURON, weights, delay=delay)
    calibrated_levels = lower_fine(network, calibration=calibrated(network, rate=rate))
    plain_levels = lower_fine(network)
    threshold = calibrated_levels.quantized.population("n").neuron.threshold
    plain_threshold = plain_levels.quantized.population("n").neuron.threshold
    assert threshold.tolist() == plain_threshold.tolist()
    projections = calibrated_levels.quantized.projections
    assert len(projections) == len(plain_levels.quantized.projections)


def test_a_calibration_takes_some_of_many_recordings():
    assert calibrated(single(NEURON), samples=SAMPLES + 40).samples == SAMPLES


# --- all parts together ---


@settings(max_examples=8, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    strategy=st.sampled_from(["dendrite", "delay-line", "reset", "paired-dendrite"]),
    bits=st.sampled_from([1, 4, 8]),
    split=st.sampled_from([0.0, 0.5, 1.0]),
    calibrates=st.booleans(),
)
def test_the_program_is_the_rounded_network_bit_for_bit(seed, strategy, bits, split, calibrates):
    network = hybrid(seed, steps=25, hidden=3)
    calibration = calibrated(network, samples=2) if calibrates else None
    levels = lower(network, CHIP, bits, strategy, replace(FINE, split=split), calibration)
    check_bit_for_bit(levels, recordings(network, samples=2, seed=seed))


def test_every_improvement_buys_spikes():
    """Each rounding adds parts to the one before it, and keeps more spikes, on recordings not used for calibration."""
    network = hybrid(3, channels=30, steps=120, hidden=16, classes=4, scale=3.0)
    calibration = calibrated(network, samples=12, rate=0.1)
    played = recordings(network, samples=8, seed=9, rate=0.1)
    roundings = [
        NEAREST,
        Rounding(fitted_decays=True, graded=True),
        Rounding(fitted_decays=True, graded=True, error_aware=True),
        Rounding(fitted_decays=True, graded=True, error_aware=True, split=1.0),
    ]
    agreements = []
    for rounding in roundings:
        levels = lower(network, CHIP, 4, "dendrite", rounding, calibration)
        agreements.append(compare(Observed(levels, played)).spikes.agreement)
    assert agreements == sorted(set(agreements))
    assert agreements[-1] > 0.9


def test_neurons_of_large_potentials_get_small_scales():
    """All inputs spike in every other step; the weights of the first neuron nearly cancel, those of the last are large."""
    weights = np.array([[3.1, -3.0, 1.0], [3.1, 3.0, 1.0], [30.0, 31.0, 1.0]])
    network = single(NEURON, weights, steps=120)
    levels = lower_fine(network, calibration=calibrated(network, rate=0.5))
    # A scale is the threshold in register units over that of the network, which is equal for all neurons.
    of_small, of_larger, of_largest = levels.quantized.population("n").neuron.threshold
    assert of_small >= of_larger > of_largest


@pytest.fixture(scope="module")
def network():
    """A hybrid of 16 hidden neurons per axis behind 30 channels."""
    return hybrid(3, channels=30, steps=60, hidden=16, scale=3.0)


def test_neurons_get_scales_of_their_own_within_the_profiles_of_a_core(network):
    levels = lower_fine(network, calibration=calibrated(network))
    thresholds = levels.quantized.population("time_hidden").neuron.threshold
    assert 1 < len(np.unique(thresholds)) <= 7
    for population in levels.quantized.populations:
        neuron = population.neuron
        # A neuron spikes at its threshold in float, above it on the chip: hence one unit more.
        threshold_units = 64 * neuron.threshold + 1
        assert np.allclose(population.scale * NEURON.theta, threshold_units)
        own_charge = 64.0 * neuron.refractory.mantissa * 2.0**neuron.refractory.exponent
        gain = one_decay(NEURON.tau_ref, "tau_ref").gain
        assert np.allclose(own_charge, -NEURON.scale_ref * gain * threshold_units, rtol=2e-4)


def test_a_weight_that_is_0_gets_no_synapse(network):
    r = np.random.default_rng(0)
    projections = []
    for projection in network.projections:
        is_kept = r.random(projection.weights.shape) < 0.5
        projections.append(replace(projection, weights=projection.weights * is_kept))
    thinned = replace(network, projections=tuple(projections))
    levels = lower_fine(thinned, weight_bits=4, split=1.0, calibration=calibrated(thinned))
    zeros = 0
    for projection in thinned.projections:
        effective = np.zeros(projection.weights.shape)
        for part in levels.quantized.projections:
            if (part.source, part.target) == (projection.source, projection.target):
                effective += effective_weight(part.mantissa, part.exponent)
        assert (effective[projection.weights == 0] == 0).all()
        zeros += int((effective == 0).sum())
    assert levels.program.synapses_pruned == zeros


def test_no_more_weights_are_split_than_the_given_share(network):
    calibration = calibrated(network)
    weights = sum(projection.weights.size for projection in network.projections)
    synapse_counts = []
    for share in (0.0, 0.3, 1.0):
        levels = lower_fine(network, weight_bits=4, split=share, calibration=calibration)
        synapses = sum((part.mantissa != 0).sum() for part in levels.quantized.projections)
        assert synapses <= (1 + share) * weights + 1
        synapse_counts.append(synapses)
    assert synapse_counts == sorted(synapse_counts)


@pytest.mark.parametrize("scale_ref", [0.0, 0.3, 20.0], ids=["none", "weak", "strong"])
def test_refractory_kernels_of_any_strength_are_kept(scale_ref):
    neuron = SrmAlpha(theta=10.0, tau_sr=10.0, tau_ref=1.0, scale_ref=scale_ref)
    network = hybrid(1, channels=12, steps=60, hidden=6, neuron=neuron)
    levels = lower_fine(network, calibration=calibrated(network))
    played = recordings(network, samples=4, seed=8)
    match = compare(Observed(levels, played))
    assert match.spikes.agreement > 0.9
    assert not any(events["charge_wraps"] for events in match.wraps_and_clips.values())
