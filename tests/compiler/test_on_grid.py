"""Networks of integers: kept exactly, and the reference's integers against both engines' on random networks."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from networks import on_grid, recordings

import hw_model as hw
from locsnn_compile.integer_neurons import effective, kept
from locsnn_compile.matching import compare
from locsnn_compile.pipeline import lower
from locsnn_compile.reference import evaluate

CHIP = hw.chip("loihi-sim")


@settings(max_examples=25, deadline=None, derandomize=True)
@given(seed=st.integers(0, 2**32 - 1))
def test_the_reference_has_the_integers_of_both_engines(seed):
    network = on_grid(seed)
    played = recordings(network, samples=2, seed=seed)
    wanted = evaluate(network, played, potentials=True)
    program = lower(network, CHIP, 8).program
    for engine in ("fast", "reference"):
        found = hw.simulate(program, played, engine=engine, probe=("spikes", "potential"))
        for population in network.populations:
            name = population.name
            assert np.array_equal(found.potential[name], wanted.potential[name]), (engine, name)
            assert np.array_equal(found.spikes[name], wanted.spikes[name]), (engine, name)


def test_the_random_networks_spike_wrap_and_clip():
    """The property above would hold of silent networks too."""
    spikes = wraps = clips = 0
    for seed in range(10):
        network = on_grid(seed)
        played = recordings(network, samples=1, seed=seed)
        counts = hw.simulate(lower(network, CHIP, 8).program, played).counts
        spikes, wraps, clips = spikes + counts.spikes, wraps + counts.wraps, clips + counts.clips
    assert spikes > 500
    assert wraps > 50
    assert clips > 100


@pytest.mark.parametrize("strategy", ["dendrite", "delay-line", "reset"])
@pytest.mark.parametrize("bits", [1, 8])
def test_quantize_keeps_integers_whatever_is_asked_for_float_neurons(strategy, bits):
    network = on_grid(7)
    quantized = lower(network, CHIP, bits, strategy).quantized
    assert set(quantized.projections) == set(network.projections)
    for population in quantized.populations:
        assert population.neuron is population.population.neuron
        assert (population.scale == 1).all()
        assert population.fit is None


def test_verify_finds_no_difference():
    network = on_grid(1)
    levels = lower(network, CHIP, 8)
    match = compare(levels.quantized, levels.program, recordings(network, samples=8))
    assert match.spikes.reference_spikes > 500
    assert match.spikes.mismatches == 0
    assert match.first_divergence is None
    assert match.prediction_agreement == 1.0


@settings(max_examples=50, derandomize=True)
@given(x=st.integers(-(2**24), 2**24), d=st.integers(0, 4096))
def test_what_is_kept_is_truncated_toward_zero(x, d):
    assert int(kept(np.array(x), d)) == int(abs(x) * (4096 - d) // 4096) * (1 if x >= 0 else -1)


@pytest.mark.parametrize(
    ("mantissa", "exponent", "weight"),
    [(3, 0, 192), (3, 2, 768), (-3, -1, -128), (3, -1, 64), (-1, -8, -64), (1, -8, 0)],
)
def test_a_negative_exponent_floors_every_weight(mantissa, exponent, weight):
    assert int(effective(np.array(mantissa), exponent)) == weight
