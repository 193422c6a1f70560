"""Margins against potentials and registers counted by hand."""

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
    """It at every level, with weights of 4 bits."""
    return lower(network, CHIP, weight_bits=4)


@pytest.fixture(scope="module")
def played(network):
    return recordings(network, samples=18)


def margins_of_all(levels, played):
    observed = Observed(levels, played)
    return margins(observed, observed.numbers)


@pytest.fixture(scope="module")
def found(levels, played):
    return margins_of_all(levels, played)


def test_distances_are_those_of_the_float_potentials(found, network, played):
    wanted = evaluate(network, played, potentials=True).potential
    for name, one in found.populations.items():
        distance = np.sort(np.abs(wanted[name] - 10.0).ravel() / 10.0)
        assert one.neuron_steps == len(distance) == one.distance_histogram.sum()
        for share, value in one.nearest.items():
            assert value == pytest.approx(np.quantile(distance, share))
        near = one.distance_histogram[EDGES[1:] <= 0.11].sum()
        assert near == (distance < EDGES[EDGES <= 0.11].max()).sum()


def test_without_a_spike_the_error_is_the_simulators(network, played):
    """No threshold is reached, so both sides see the same spikes: none."""
    quiet = replace(
        network,
        populations=tuple(
            replace(p, neuron=replace(NEURON, theta=1e4)) for p in network.populations
        ),
    )
    levels = lower(quiet, CHIP, weight_bits=4)
    wanted = evaluate(quiet, played, potentials=True)
    chip = hw.simulate(levels.program, played, probe=("potential",))
    for name, one in margins_of_all(levels, played).populations.items():
        scale = levels.quantized.population(name).scale
        error = np.abs(chip.potential[name] / scale - wanted.potential[name]) / 1e4
        assert not wanted.spikes[name].any()
        assert one.error[1.0] == pytest.approx(error.max())
        assert one.error[0.5] == pytest.approx(np.median(error))
        assert (one.within_error, one.decided_otherwise) == (0.0, 0.0)
        assert one.error_histogram.sum() == (error > 0).sum()


def test_a_decision_changes_only_within_the_error(found):
    every = found.populations.values()
    assert all(one.decided_otherwise <= one.within_error < 1 for one in every)
    assert any(one.decided_otherwise > 0 for one in every)


def test_registers_are_the_simulators(found, levels, played):
    chip = hw.simulate(levels.program, played, probe=("u", "potential"))
    assert set(found.registers) == set(chip.u)
    for name, use in found.registers.items():
        assert (use.peak_u, use.peak_v) == (
            np.abs(chip.u[name]).max(),
            np.abs(chip.potential[name]).max(),
        )
        events = chip.events.get(name, {})
        assert use.wraps + use.clips == sum(events.values())


@pytest.mark.parametrize(
    ("peak_u", "peak_v", "bits"),
    [(0, 0, None), (1 << 23, 0, 0.0), (1 << 20, 100, 3.0), (0, (1 << 23) - 1, 0.0)],
    ids=["nothing", "full current", "three bits", "full voltage"],
)
def test_headroom_is_that_of_the_fuller_register(peak_u, peak_v, bits):
    use = RegisterUse(peak_u, 1 << 23, peak_v, (1 << 23) - 1, 0, 0)
    assert use.headroom_bits == bits


def test_a_silent_recording_is_at_the_distance_of_rest(levels, network):
    silent = np.zeros((1, network.steps, network.channels), dtype=np.uint8)
    for one in margins_of_all(levels, silent).populations.values():
        assert set(one.nearest.values()) == {1.0}
        assert set(one.error.values()) == {0.0}
        assert one.error_histogram.sum() == 0
