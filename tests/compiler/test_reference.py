"""The float reference of spike response neurons against sums of their kernels, written from the equations alone.

Also tested are the views of a network, the scores, the bias of an integer neuron, and the choice of calibration recordings.
"""

import math
from dataclasses import replace

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

import hw_model as hw
from locsnn_compile.data.recordings import Recordings
from locsnn_compile.network.chip_neurons import ChipCuba
from locsnn_compile.network.neurons import SrmAlpha
from locsnn_compile.reference import evaluate as evaluation
from locsnn_compile.reference.evaluate import calibrate, evaluate
from locsnn_compile.reference.float_neurons import SrmSteps
from locsnn_compile.reference.integer_neurons import ChipCubaSteps
from tests.support.networks import NEURON, hybrid, recordings
from tests.support.register_units import (
    CURRENT_RANGE,
    FORGETS_AT_ONCE,
    KEEPS_ALL,
    LARGEST_THRESHOLD,
)


def srm_response(drive, neuron):
    """Return spikes and potentials (batch, steps, n) by the reference, for weighted input spikes of the same shape.

    An input spike acts one step later.
    """
    batch, steps, n = drive.shape
    state = SrmSteps(neuron, batch, n)
    arriving = np.concatenate((np.zeros_like(drive[:, :1]), drive[:, :-1]), axis=1)
    spikes = []
    potentials = []
    for t in range(steps):
        fired, potential = state.step(arriving[:, t])
        spikes.append(fired)
        potentials.append(potential)
    return np.stack(spikes, axis=1), np.stack(potentials, axis=1)


def brute_force(drive, neuron):
    """Return spikes and potentials (steps, n) by summing both kernels over all earlier spikes, step by step."""

    def alpha(k, tau):
        return k / tau * math.exp(1 - k / tau)

    steps, n = drive.shape
    spikes = np.zeros((steps, n), dtype=int)
    potentials = np.zeros((steps, n))
    for t in range(steps):
        for i in range(n):
            response = sum(drive[s, i] * alpha(t - s, neuron.tau_sr) for s in range(t + 1))
            refractory = sum(spikes[s, i] * alpha(t - s, neuron.tau_ref) for s in range(t))
            u = response - neuron.scale_ref * neuron.theta * refractory
            potentials[t, i] = u
            spikes[t, i] = u >= neuron.theta
    return spikes, potentials


@settings(max_examples=30, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    tau_sr=st.floats(0.5, 40),
    tau_ref=st.floats(0.5, 10),
    scale_ref=st.floats(0, 5),
)
def test_recursion_equals_the_sum_of_kernels(seed, tau_sr, tau_ref, scale_ref):
    neuron = SrmAlpha(theta=10.0, tau_sr=tau_sr, tau_ref=tau_ref, scale_ref=scale_ref)
    drive = np.random.default_rng(seed).normal(0, 8, (1, 30, 2))
    spikes, potentials = srm_response(drive, neuron)
    expected_spikes, expected_potentials = brute_force(drive[0], neuron)
    assert np.array_equal(spikes[0], expected_spikes)
    np.testing.assert_allclose(potentials[0], expected_potentials, rtol=1e-9, atol=1e-8)


def test_a_potential_exactly_at_threshold_spikes():
    drive = np.zeros((1, 12, 1))
    drive[0, 0, 0] = 1.0
    # The peak of the potential, measured with a threshold that it does not reach, becomes the threshold.
    _, potentials = srm_response(drive, replace(NEURON, theta=1e9))
    spikes, _ = srm_response(drive, replace(NEURON, theta=float(potentials.max())))
    assert spikes.sum() == 1


def test_the_location_branch_hears_the_transposed_recording_in_the_order_of_the_walk():
    network = hybrid()
    played = recordings(network, samples=1)
    transposed = evaluate(network, played).spikes["touch_transposed"][0]
    walk = network.views[1].walk
    for position in range(network.channels):
        for step in range(network.steps):
            assert transposed[position, step] == played[0, step, walk[position]]


def test_scores_add_the_spikes_of_both_branches_and_ties_go_to_the_first_class():
    network = hybrid()
    result = evaluate(network, recordings(network))
    counts = result.spikes["time_output"].sum(axis=1) + result.spikes["location_output"].sum(axis=1)
    assert np.array_equal(result.scores, counts)
    silent = evaluate(network, np.zeros((1, network.steps, network.channels), dtype=np.uint8))
    assert silent.scores.tolist() == [[0.0, 0.0]]
    assert silent.prediction.tolist() == [0]


def test_a_current_wraps_together_with_its_bias():
    """The current alone fits its register; the sum with the bias does not, and wraps to the other end."""
    neuron = ChipCuba.of(
        1,
        decay_u=KEEPS_ALL,
        decay_v=FORGETS_AT_ONCE,
        threshold=LARGEST_THRESHOLD,
        bias_mantissa=64,
    )
    state = ChipCubaSteps(neuron, batch=1, size=1, registers=hw.chip("loihi-sim").registers)
    current = 2**23 - 10
    state.u[:] = current
    fired, potential = state.step(np.zeros((1, 1), dtype=np.int64))
    assert fired.tolist() == [[False]]
    assert potential.tolist() == [[current + 64 - CURRENT_RANGE]]
    assert state.u.tolist() == [[current]]


def test_calibration_takes_recordings_from_the_first_to_the_last(monkeypatch):
    monkeypatch.setattr(evaluation, "SAMPLES", 3)
    network = hybrid()
    played = recordings(network, samples=7)
    seven = Recordings(played, labels=None, step_seconds=None, source="seven")
    calibration = calibrate(network, seven, hw.chip("loihi-sim").registers)
    expected = evaluate(network, played[[0, 3, 6]]).spikes
    assert calibration.samples == 3
    for name, spikes in expected.items():
        assert np.array_equal(calibration.spikes[name], spikes)
    # The recordings differ, so that others would give other spikes.
    assert len({spikes.tobytes() for spikes in played}) == 7
