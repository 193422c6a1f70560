"""The float reference against brute-force sums of kernels, written from the equations alone."""

import math

import numpy as np
import pytest
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
from tests.support.networks import hybrid, recordings


def srm_response(drive, neuron):
    """Spikes and potentials (batch, steps, n) of weighted input spikes, each of which acts one step later."""
    state = SrmSteps(neuron, len(drive), drive.shape[2])
    arriving = np.concatenate((np.zeros_like(drive[:, :1]), drive[:, :-1]), axis=1)
    both = [state.step(arriving[:, t]) for t in range(drive.shape[1])]
    return tuple(np.stack(part, axis=1) for part in zip(*both, strict=True))


def brute_force(drive, neuron):
    """Sum both kernels over all earlier spikes, step by step."""

    def eps(k):
        return k / neuron.tau_sr * math.exp(1 - k / neuron.tau_sr)

    def nu(k):
        return (
            -neuron.scale_ref * neuron.theta * k / neuron.tau_ref * math.exp(1 - k / neuron.tau_ref)
        )

    steps, n = drive.shape
    spikes, potentials = np.zeros((steps, n), dtype=int), np.zeros((steps, n))
    for t in range(steps):
        for i in range(n):
            u = sum(drive[s, i] * eps(t - s) for s in range(t + 1)) + sum(
                spikes[s, i] * nu(t - s) for s in range(t)
            )
            potentials[t, i], spikes[t, i] = u, u >= neuron.theta
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
    wanted_spikes, wanted_potentials = brute_force(drive[0], neuron)
    assert np.array_equal(spikes[0], wanted_spikes)
    np.testing.assert_allclose(potentials[0], wanted_potentials, rtol=1e-9, atol=1e-8)


@pytest.mark.parametrize("neuron", [SrmAlpha(theta=10.0, tau_sr=10.0, tau_ref=1.0, scale_ref=2.0)])
def test_a_potential_exactly_at_threshold_spikes(neuron):
    drive = np.zeros((1, 12, 1))
    drive[0, 0, 0] = 1.0
    _, potentials = srm_response(
        drive, SrmAlpha(theta=1e9, tau_sr=10.0, tau_ref=1.0, scale_ref=2.0)
    )
    peak = potentials.max()
    spikes, _ = srm_response(drive, SrmAlpha(float(peak), tau_sr=10.0, tau_ref=1.0, scale_ref=2.0))
    assert spikes.sum() == 1


def test_the_location_branch_sees_the_transposed_recording_in_walk_order():
    network = hybrid()
    played = recordings(network, samples=1)
    seen = evaluate(network, played).spikes["touch_transposed"][0]
    walk = network.views[1].walk
    for position in range(network.channels):
        for step in range(network.steps):
            assert seen[position, step] == played[0, step, walk[position]]


def test_scores_add_the_spikes_of_both_branches_and_ties_go_to_the_first_class():
    network = hybrid()
    result = evaluate(network, recordings(network))
    counts = result.spikes["time_output"].sum(axis=1) + result.spikes["location_output"].sum(axis=1)
    assert np.array_equal(result.scores, counts)
    silent = evaluate(network, np.zeros((1, network.steps, network.channels), dtype=np.uint8))
    assert silent.scores.tolist() == [[0.0, 0.0]]
    assert silent.prediction.tolist() == [0]


def test_drive_wraps_with_its_bias():
    """The current alone fits its register; with the bias it does not, and comes back at the other end."""
    neuron = ChipCuba.of(1, decay_u=0, decay_v=4096, threshold=131071, bias_mantissa=64)
    state = ChipCubaSteps(neuron, 1, 1, hw.chip("loihi-sim").registers)
    state.u[:] = 2**23 - 10
    fired, potential = state.step(np.zeros((1, 1), dtype=np.int64))
    assert (fired.tolist(), potential.tolist(), state.u.tolist()) == (
        [[False]],
        [[54 - 2**23]],
        [[2**23 - 10]],
    )


def test_calibration_takes_recordings_from_the_first_to_the_last(monkeypatch):
    monkeypatch.setattr(evaluation, "SAMPLES", 3)
    network = hybrid()
    played = recordings(network, samples=7)
    found = calibrate(
        network,
        Recordings(played, labels=None, step_seconds=None, source="seven"),
        hw.chip("loihi-sim").registers,
    )
    wanted = evaluate(network, played[[0, 3, 6]]).spikes
    assert found.samples == 3
    assert all(np.array_equal(found.spikes[name], spikes) for name, spikes in wanted.items())
    assert len({spikes.tobytes() for spikes in played}) == 7
