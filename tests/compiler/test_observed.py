"""``Observed``: network and chip play the recordings of a check once, and small results are remembered.

Verification asks it for spikes and registers many times. These tests count how often the float network is evaluated.
"""

import numpy as np
import pytest

import hw_model as hw
import locsnn_compile as lc
import locsnn_compile.reference.evaluate as reference_module
import locsnn_compile.verification.observation as module
from locsnn_compile.data.recordings import BATCH
from locsnn_compile.pipeline import lower
from locsnn_compile.reference.evaluate import FloatRuns, evaluate
from locsnn_compile.verification.observation import Observed
from tests.support.networks import hybrid, recordings

CHIP = hw.chip("loihi-sim")


@pytest.fixture(scope="module")
def network():
    """A small hybrid whose weights of 20 make many spikes."""
    return hybrid(3, scale=20.0)


@pytest.fixture(scope="module")
def levels(network):
    """The compiled levels of the network with weights of 4 bits."""
    return lower(network, CHIP, weight_bits=4)


@pytest.fixture
def evaluated(monkeypatch):
    """A list to which each evaluation of the float network adds its number of recordings."""
    calls = []

    def counted(network, spikes, **options):
        calls.append(len(spikes))
        return evaluate(network, spikes, **options)

    monkeypatch.setattr(module, "evaluate", counted)
    monkeypatch.setattr(reference_module, "evaluate", counted)
    return calls


def test_registers_of_a_sample_are_played_once_however_often_they_are_asked_for(
    levels, network, evaluated
):
    observed = Observed(levels, recordings(network, samples=BATCH + 2))
    for _ in range(3):
        for seen in observed.closely(observed.numbers):
            assert seen.reference.potential
    assert evaluated == [BATCH, 2]


def test_registers_of_large_samples_are_played_again_and_not_kept(
    levels, network, evaluated, monkeypatch
):
    monkeypatch.setattr(module, "REMEMBERED_NEURON_STEPS", 1)
    observed = Observed(levels, recordings(network, samples=BATCH + 2))
    for _ in range(2):
        samples = [len(seen.reference.scores) for seen in observed.closely(observed.numbers)]
        assert samples == [BATCH, 2]
    assert evaluated == [BATCH, 2] * 2


def test_an_observed_recording_has_the_spikes_and_potentials_of_both_sides(levels, network):
    played = recordings(network, samples=4)
    seen = Observed(levels, played).recording(2)
    reference = evaluate(network, played[2:3], potentials=True)
    chip = hw.simulate(levels.program, played[2:3], probe=("spikes", "u", "potential"))
    for name in [population.name for population in network.populations]:
        assert np.array_equal(seen.reference.spikes[name], reference.spikes[name])
        assert np.array_equal(seen.reference.potential[name], reference.potential[name])
        assert np.array_equal(seen.chip.spikes[name], chip.spikes[name])
        assert np.array_equal(seen.chip.potential[name], chip.potential[name])


@pytest.mark.parametrize("bits", [1 << 31, 0], ids=["remembered", "played anew"])
def test_a_float_network_plays_a_batch_the_same_each_time(network, bits, evaluated, monkeypatch):
    monkeypatch.setattr(reference_module, "REMEMBERED_BITS", bits)
    played = recordings(network, samples=5)
    runs = FloatRuns(network, played, CHIP.registers)
    rows = slice(1, 4)
    expected = evaluate(network, played[rows])
    for _ in range(2):
        result = runs.batch(rows)
        assert set(result.spikes) == set(expected.spikes)
        for name, spikes in expected.spikes.items():
            assert np.array_equal(result.spikes[name], spikes)
        assert np.array_equal(result.scores, expected.scores)
    assert evaluated == [3] if bits else [3, 3]


def test_auto_plays_the_float_network_once_for_all_candidates(network, evaluated):
    played = recordings(network, samples=6)
    compiled = lc.compile(network, events=played, calibration=played, diagnosis=False)
    assert len(compiled.choice.candidates) > 1
    # Once for the rounding of weights, which needs potentials, once for all candidates, and once for the check.
    assert evaluated == [6, 6, 6]


def test_short_recordings_are_padded_before_they_are_observed(network):
    short = recordings(network, samples=3)[:, :25]
    compiled = lc.compile(network, events=short, diagnosis=False)
    assert compiled.observed.recordings.shape == (3, network.steps, network.channels)
    assert not compiled.observed.recordings[:, 25:].any()
