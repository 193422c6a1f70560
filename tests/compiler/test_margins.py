"""Margins: how near potentials come to thresholds, how far chip and network differ, and how full registers are.

They are checked against potentials and registers of whole runs.
"""

from dataclasses import replace

import numpy as np
import pytest

import hw_model as hw
from locsnn_compile.pipeline import lower
from locsnn_compile.reference.evaluate import evaluate
from locsnn_compile.verification.diagnosis import EDGES, RegisterUse, margins
from locsnn_compile.verification.observation import Observed
from tests.support.networks import NEURON, hybrid, recordings

CHIP = hw.chip("loihi-sim")


@pytest.fixture(scope="module")
def network():
    """A small hybrid of spike response neurons, with 12 channels and 50 steps."""
    return hybrid(1, steps=50, hidden=6, channels=12)


@pytest.fixture(scope="module")
def levels(network):
    """The compiled levels of the network with weights of 4 bits."""
    return lower(network, CHIP, weight_bits=4)


@pytest.fixture(scope="module")
def played(network):
    """Random recordings, more than are played at a time."""
    return recordings(network, samples=18)


def margins_of_all(levels, played):
    """Return the margins over all recordings."""
    observed = Observed(levels, played)
    return margins(observed, observed.numbers)


@pytest.fixture(scope="module")
def network_margins(levels, played):
    """The margins of the network over all recordings."""
    return margins_of_all(levels, played)


def test_distances_are_those_of_the_float_potentials(network_margins, network, played):
    theta = NEURON.theta
    potential = evaluate(network, played, potentials=True).potential
    for name, margin in network_margins.populations.items():
        distance = np.sort(np.abs(potential[name] - theta).ravel() / theta)
        assert margin.neuron_steps == len(distance) == margin.distance_histogram.sum()
        for share, value in margin.nearest.items():
            assert value == pytest.approx(np.quantile(distance, share))
        # Bins up to a tenth of the threshold; the edge itself may be rounded up.
        near = margin.distance_histogram[EDGES[1:] <= 0.11].sum()
        assert near == (distance < EDGES[EDGES <= 0.11].max()).sum()


def test_without_a_spike_the_error_is_the_simulators(network, played):
    """No threshold is reached, so network and chip have the same spikes: none."""
    theta = 1e4
    silent_neuron = replace(NEURON, theta=theta)
    populations = tuple(replace(p, neuron=silent_neuron) for p in network.populations)
    silent_network = replace(network, populations=populations)
    levels = lower(silent_network, CHIP, weight_bits=4)
    reference = evaluate(silent_network, played, potentials=True)
    chip = hw.simulate(levels.program, played, probe=("potential",))
    for name, margin in margins_of_all(levels, played).populations.items():
        scale = levels.quantized.population(name).scale
        error = np.abs(chip.potential[name] / scale - reference.potential[name]) / theta
        assert not reference.spikes[name].any()
        assert margin.error[1.0] == pytest.approx(error.max())
        assert margin.error[0.5] == pytest.approx(np.median(error))
        assert margin.within_error == 0.0
        assert margin.decided_otherwise == 0.0
        assert margin.error_histogram.sum() == (error > 0).sum()


def test_a_decision_changes_only_within_the_error(network_margins):
    of_populations = network_margins.populations.values()
    for margin in of_populations:
        assert margin.decided_otherwise <= margin.within_error < 1
    assert any(margin.decided_otherwise > 0 for margin in of_populations)


def test_peaks_of_registers_are_those_of_the_simulator(network_margins, levels, played):
    chip = hw.simulate(levels.program, played, probe=("u", "potential"))
    assert set(network_margins.registers) == set(chip.u)
    for name, use in network_margins.registers.items():
        assert use.peak_u == np.abs(chip.u[name]).max()
        assert use.peak_v == np.abs(chip.potential[name]).max()
        events = chip.events.get(name, {})
        assert use.wraps + use.clips == sum(events.values())


@pytest.mark.parametrize(
    ("peak_u", "peak_v", "bits"),
    [(0, 0, None), (1 << 23, 0, 0.0), (1 << 20, 100, 3.0), (0, (1 << 23) - 1, 0.0)],
    ids=["nothing", "full current", "three bits", "full voltage"],
)
def test_headroom_is_that_of_the_fuller_register(peak_u, peak_v, bits):
    use = RegisterUse(
        peak_u=peak_u,
        limit_u=1 << 23,
        peak_v=peak_v,
        limit_v=(1 << 23) - 1,
        wraps=0,
        clips=0,
    )
    assert use.headroom_bits == bits


def test_silent_neurons_stay_a_whole_threshold_away(levels, network):
    silent = np.zeros((1, network.steps, network.channels), dtype=np.uint8)
    for margin in margins_of_all(levels, silent).populations.values():
        assert set(margin.nearest.values()) == {1.0}
        assert set(margin.error.values()) == {0.0}
        assert margin.error_histogram.sum() == 0
