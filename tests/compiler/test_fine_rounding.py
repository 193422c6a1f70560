"""Formats by size, weights rounded together, fitted decays, and scales of their own: the parts, and what they buy."""

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
from tests.support.networks import NEURON, check_bit_for_bit, hybrid, recordings, single

CHIP = hw.chip("loihi-sim")


def calibrated(network, samples=6, seed=5, rate=0.3):
    """The calibration of a network on random recordings."""
    given = Recordings(
        recordings(network, samples=samples, seed=seed, rate=rate),
        labels=None,
        step_seconds=None,
        source="made up",
    )
    return calibrate(network, given, CHIP.registers)


# --- formats by size ---


@settings(max_examples=100, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    bits=st.sampled_from(WEIGHT_BITS),
    largest=st.floats(0.1, 30_000),
    count=st.sampled_from([1, 2, 3]),
    share=st.sampled_from([0.0, 0.5, 1.0]),
)
def test_parts_are_on_the_grid_and_add_up(seed, bits, largest, count, share):
    r = np.random.default_rng(seed)
    ideal = r.uniform(-largest, largest, (4, 5)) ** 3 / largest**2
    grades = Grades.holding(float(np.abs(ideal).max()), bits, count=count, split=share > 0)
    grade, split = grades.grade(np.abs(ideal)), r.random(ideal.shape) < share
    step = 1 << np.where(split, grades.second_grade(grade), grade)
    quanta = nearest(ideal, step, grades.largest_of(grade))
    parts = list(grades.parts(quanta, grade, split))
    assert np.array_equal(
        sum((effective_weight(m, e) for m, e in parts), start=np.zeros((4, 5))), 64 * quanta
    )
    for mantissa, exponent in parts:
        assert not weight_grid(bits, "excitatory").off_grid(np.abs(mantissa)).any()
        assert exponent in WEIGHT_EXPONENTS
    assert len(parts) <= 6
    held = np.abs(ideal) <= grades.largest_of(grade)
    assert (np.abs(quanta - ideal) <= step / 2)[held].all()


def test_the_finest_grade_that_holds_a_weight_takes_it():
    grades = Grades.holding(1000.0, 8)
    assert grades == Grades(8, (0, 1, 2))
    assert grades.grade(np.array([0.0, 254.0, 254.5, 508.0, 509.0, 1000.0])).tolist() == [
        0,
        0,
        1,
        1,
        2,
        2,
    ]
    assert [grades.exponent(k) for k in grades.numbers] == [0, 1, 2]
    assert Grades.holding(1000.0, 8, count=1) == Grades(8, (2,))
    assert Grades.holding(1e9, 8) == Grades(8, (4, 5, 6, 7))
    assert coarsest(8) == 7


def test_split_weights_of_few_bits_are_as_fine_as_one_of_twice_the_bits():
    grades = Grades.holding(1000.0, 4, count=3, split=True)
    assert grades == Grades(4, (1, 2, 3, 5, 6, 7))
    assert grades.second_grade(np.array([7, 6, 5, 3, 1])).tolist() == [3, 2, 1, 1, 1]


# --- weights rounded together ---


def error(gram, ideal, quanta):
    return np.einsum("ij,jk,ik->i", quanta - ideal, gram, quanta - ideal)


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_few_weights_are_rounded_nearly_as_well_as_any_rounding_could(seed):
    """Against all 3^4 roundings near the ideal weights."""
    r = np.random.default_rng(seed)
    x = r.normal(size=(50, 4)) + r.normal(size=(50, 1)) * 2
    gram, ideal = x.T @ x, r.uniform(-9, 9, (3, 4))
    step, most = r.choice([1, 2, 4], size=(3, 4)), np.full((3, 4), 100)
    found = round_together(Metric.of(gram), ideal, step, most, 32)
    near = np.rint(ideal / step) * step
    tried = [
        error(gram, ideal, near + step * np.array(moves))
        for moves in itertools.product((-1, 0, 1), repeat=4)
    ]
    assert error(gram, ideal, found).sum() <= 1.5 * np.min(tried, axis=0).sum() + 1e-9
    assert (found % step == 0).all()


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), beam=st.sampled_from([1, 4]))
def test_rounding_together_keeps_limits_and_zeros(seed, beam):
    r = np.random.default_rng(seed)
    x = r.normal(size=(60, 9))
    ideal = r.normal(0, 30, (20, 9))
    step = r.choice([0, 1, 8], size=ideal.shape)
    found = round_together(
        Metric.of(x.T @ x + np.eye(9)), ideal, step, np.full(ideal.shape, 24), beam
    )
    assert (np.abs(found) <= 24).all()
    assert (found[step == 0] == 0).all()
    assert (found[step == 8] % 8 == 0).all()


def test_without_correlation_every_weight_is_the_nearest():
    ideal = np.random.default_rng(0).normal(0, 9, (5, 6))
    found = round_together(
        Metric.of(np.diag(np.arange(1.0, 7))), ideal, np.ones((5, 6), int), np.full((5, 6), 99), 4
    )
    assert np.array_equal(found, np.rint(ideal))


# --- decays ---


@pytest.mark.parametrize("tau", [0.05, 0.5, 1.0, 2.0, 10.0, 33.0, 100.0, 4000.0])
def test_two_decays_fit_no_worse_than_one_and_as_stated(tau):
    u, v, gain, left = two_decays(tau, "tau")
    assert left <= one_decay(tau, "tau").error + 1e-9
    k = np.arange(1, int(40 * tau) + 50, dtype=float)
    keep_u, keep_v = 1 - u / 4096, 1 - v / 4096
    answer = k * keep_u ** (k - 1) if u == v else (keep_u**k - keep_v**k) / (keep_u - keep_v)
    kernel = k / tau * np.exp(1 - k / tau)
    assert math.sqrt(((kernel - gain * answer) ** 2).sum() / (kernel**2).sum()) == pytest.approx(
        left, abs=1e-6
    )


def test_the_published_time_constant_takes_two_decays():
    assert two_decays(10.0, "tau")[:2] == (379, 401)
    assert two_decays(-1 / math.log(3706 / 4096), "tau")[:2] == (390, 390)


# --- what is known of the inputs ---


def test_the_moments_are_those_of_the_kernels():
    """Against sums over all pairs of spikes, with the kernels written out."""
    network = single(NEURON, np.random.default_rng(0).normal(0, 4, (2, 3)), steps=12, delay=2)
    calibration = calibrated(network, samples=3)
    u, v, gain, _ = two_decays(10.0, "tau")
    (projection,) = network.projections
    drive = drive_of(NEURON, (projection,), (u, v), gain, calibration)
    spikes = calibration.spikes["touch"].astype(float)
    k = np.arange(1, 13)
    answer = ((1 - u / 4096) ** k - (1 - v / 4096) ** k) / ((v - u) / 4096)
    x, exact = np.zeros((3, 12, 3)), np.zeros((3, 12, 3))
    for t in range(12):
        for lag in range(1, t - 1):
            x[:, t] += answer[lag - 1] * spikes[:, t - lag - 2]
            exact[:, t] += lag / 10 * math.exp(1 - lag / 10) * spikes[:, t - lag - 2]
    x, wanted = x.reshape(-1, 3), exact.reshape(-1, 3) @ projection.weights.T
    gram = x.T @ x
    ridge = RIDGE / 3 * np.trace(gram) / 3
    held = gram + ridge * np.eye(3)
    assert np.allclose(drive.gram * len(x), held)
    assert np.allclose(drive.ideal @ held, wanted.T @ x + ridge * gain * projection.weights)
    assert np.allclose(drive.rate, spikes[:, :-3].sum(axis=(0, 1)) / 3)


def test_strategies_of_the_same_decays_share_what_is_known_of_the_inputs():
    network = single(NEURON, np.random.default_rng(0).normal(0, 4, (2, 3)))
    calibration, (projection,) = calibrated(network), network.projections
    drive = drive_of(NEURON, (projection,), (379, 401), 1.0, calibration)
    assert drive_of(NEURON, (projection,), (379, 401), 1.0, calibration) is drive
    assert drive.metric is drive.metric
    for decays, gain, others in [
        ((390, 390), 1.0, calibration),
        ((379, 401), 2.0, calibration),
        ((379, 401), 1.0, calibrated(network, seed=6)),
    ]:
        assert drive_of(NEURON, (projection,), decays, gain, others) is not drive


@pytest.mark.parametrize(
    ("weights", "delay", "rate"),
    [
        (sparse.csr_array(np.eye(3)), 0, 0.5),
        (np.eye(3), np.arange(9).reshape(3, 3), 0.5),
        (np.eye(3), 0, 0.0),
    ],
    ids=["sparse", "delays", "silence"],
)
def test_where_nothing_is_known_weights_are_rounded_apart(weights, delay, rate):
    network = single(NEURON, weights, delay=delay)
    levels = lower(
        network,
        CHIP,
        weight_bits=8,
        strategy="dendrite",
        rounding=FINE,
        calibration=calibrated(network, rate=rate),
    )
    apart = lower(network, CHIP, weight_bits=8, strategy="dendrite", rounding=FINE)
    assert levels.quantized.population("n").neuron.threshold.tolist() == (
        apart.quantized.population("n").neuron.threshold.tolist()
    )
    assert len(levels.quantized.projections) == len(apart.quantized.projections)


def test_of_many_recordings_some_are_taken():
    assert calibrated(single(NEURON), samples=SAMPLES + 40).samples == SAMPLES


# --- the whole ---


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
    """On recordings that nothing was rounded for; each row adds one to those before it."""
    network = hybrid(3, channels=30, steps=120, hidden=16, classes=4, scale=3.0)
    calibration, played = (
        calibrated(network, samples=12, rate=0.1),
        recordings(network, samples=8, seed=9, rate=0.1),
    )
    rows = [
        NEAREST,
        Rounding(fitted_decays=True, graded=True),
        Rounding(fitted_decays=True, graded=True, error_aware=True),
        Rounding(fitted_decays=True, graded=True, error_aware=True, split=1.0),
    ]
    found = [agreement(network, 4, rounding, calibration, played) for rounding in rows]
    assert found == sorted(set(found))
    assert found[-1] > 0.9


def test_neurons_of_large_potentials_get_small_scales():
    """Inputs that spike in every other step, through weights of which one neuron's cancel."""
    weights = np.array([[3.1, -3.0, 1.0], [3.1, 3.0, 1.0], [30.0, 31.0, 1.0]])
    network = single(NEURON, weights, steps=120)
    levels = lower(
        network,
        CHIP,
        weight_bits=8,
        strategy="dendrite",
        rounding=FINE,
        calibration=calibrated(network, rate=0.5),
    )
    small, larger, largest = levels.quantized.population("n").neuron.threshold
    assert small >= larger > largest


def agreement(network, bits, rounding, calibration, played):
    levels = lower(network, CHIP, bits, "dendrite", rounding, calibration)
    return compare(Observed(levels, played)).spikes.agreement


def test_neurons_get_scales_of_their_own_within_the_profiles_of_a_core():
    network = hybrid(3, channels=30, steps=60, hidden=16, scale=3.0)
    levels = lower(
        network,
        CHIP,
        weight_bits=8,
        strategy="dendrite",
        rounding=FINE,
        calibration=calibrated(network),
    )
    thresholds = levels.quantized.population("time_hidden").neuron.threshold
    assert 1 < len(np.unique(thresholds)) <= 7
    for q in levels.quantized.populations:
        neuron = q.neuron
        assert np.allclose(q.scale * q.population.neuron.theta, 64 * neuron.threshold + 1)
        own = -64.0 * neuron.refractory.mantissa * 2.0**neuron.refractory.exponent
        wanted = 2.0 * one_decay(1.0, "tau_ref").gain * (64 * neuron.threshold + 1)
        assert np.allclose(own, wanted, rtol=2e-4)


def test_a_weight_that_is_0_gets_no_synapse():
    network = hybrid(3, channels=30, steps=60, hidden=16, scale=3.0)
    r = np.random.default_rng(0)
    thinned = replace(
        network,
        projections=tuple(
            replace(p, weights=p.weights * (r.random(p.weights.shape) < 0.5))
            for p in network.projections
        ),
    )
    levels = lower(
        thinned,
        CHIP,
        weight_bits=4,
        strategy="dendrite",
        rounding=replace(FINE, split=1.0),
        calibration=calibrated(thinned),
    )
    zeros = 0
    for p in thinned.projections:
        parts = [
            q for q in levels.quantized.projections if (q.source, q.target) == (p.source, p.target)
        ]
        whole = sum(effective_weight(q.mantissa, q.exponent) for q in parts)
        assert (whole[p.weights == 0] == 0).all()
        zeros += int((whole == 0).sum())
    assert levels.program.synapses_pruned == zeros


def test_the_share_that_is_split_is_no_larger_than_asked_for():
    network = hybrid(3, channels=30, steps=60, hidden=16, scale=3.0)
    calibration = calibrated(network)
    counts = []
    for share in (0.0, 0.3, 1.0):
        levels = lower(
            network,
            CHIP,
            weight_bits=4,
            strategy="dendrite",
            rounding=replace(FINE, split=share),
            calibration=calibration,
        )
        parts = sum((q.mantissa != 0).sum() for q in levels.quantized.projections)
        weights = sum(p.weights.size for p in network.projections)
        assert parts <= (1 + share) * weights + 1
        counts.append(parts)
    assert counts == sorted(counts)


def test_no_own_charge_and_strong_ones():
    for scale_ref in (0.0, 0.3, 20.0):
        neuron = SrmAlpha(theta=10.0, tau_sr=10.0, tau_ref=1.0, scale_ref=scale_ref)
        network = hybrid(1, channels=12, steps=60, hidden=6, neuron=neuron)
        levels = lower(
            network,
            CHIP,
            weight_bits=8,
            strategy="dendrite",
            rounding=FINE,
            calibration=calibrated(network),
        )
        played = recordings(network, samples=4, seed=8)
        match = compare(Observed(levels, played))
        assert match.spikes.agreement > 0.9
        assert not any(found["charge_wraps"] for found in match.wraps_and_clips.values())
