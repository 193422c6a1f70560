"""Networks in the chip's integers: compiling keeps every number, and the reference agrees with both engines.

The reference evaluates such networks in integers, without compartments or cores.
"""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import hw_model as hw
from hw_model.arithmetic.fixed_point import decay, effective_weight
from locsnn_compile.errors import TargetError
from locsnn_compile.network.chip_neurons import ChipCuba
from locsnn_compile.network.projections import ChipProjection, matrix
from locsnn_compile.pipeline import lower
from locsnn_compile.reference.evaluate import evaluate
from locsnn_compile.verification.matching import compare
from locsnn_compile.verification.observation import Observed
from tests.support.networks import on_grid, recordings, single

CHIP = hw.chip("loihi-sim")


@pytest.mark.slow
@settings(max_examples=25, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    together=st.sampled_from([1, 1, 2, 5, 12]),
    silence=st.integers(0, 3),
)
def test_the_reference_has_the_integers_of_both_engines(seed, together, silence):
    network = on_grid(seed, together=together, silence=silence)
    played = recordings(network, samples=2, seed=seed)
    expected = evaluate(network, played, potentials=True)
    program = lower(network, CHIP, weight_bits=8).program
    for engine in ("fast", "reference"):
        result = hw.simulate(program, played, engine=engine, probe=("spikes", "potential"))
        for population in network.populations:
            name = population.name
            assert np.array_equal(result.potential[name], expected.potential[name]), (engine, name)
            assert np.array_equal(result.spikes[name], expected.spikes[name]), (engine, name)


def test_the_random_networks_spike_wrap_and_clip():
    """In silent networks the property above would test nothing."""
    spikes = 0
    wraps = 0
    clips = 0
    for seed in range(10):
        network = on_grid(seed)
        played = recordings(network, samples=1, seed=seed)
        counts = hw.simulate(lower(network, CHIP, weight_bits=8).program, played).counts
        spikes += counts.spikes
        wraps += counts.wraps
        clips += counts.clips
    assert spikes > 500
    assert wraps > 50
    assert clips > 100


@pytest.mark.parametrize("strategy", ["dendrite", "delay-line", "reset"])
@pytest.mark.parametrize("bits", [1, 8])
def test_quantize_keeps_integers_whatever_the_setting_for_float_neurons(strategy, bits):
    network = on_grid(7)
    quantized = lower(network, CHIP, bits, strategy).quantized
    assert set(quantized.projections) == set(network.projections)
    for population in quantized.populations:
        assert population.neuron is population.population.neuron
        assert (population.scale == 1).all()
        assert population.fit is None


def test_chip_and_reference_do_not_differ():
    network = on_grid(1)
    levels = lower(network, CHIP, weight_bits=8)
    match = compare(Observed(levels, recordings(network, samples=8)))
    assert match.spikes.reference_spikes > 500
    assert match.spikes.mismatches == 0
    assert match.first_divergence is None
    assert match.prediction_agreement == 1.0


@settings(max_examples=50)
@given(x=st.integers(-(2**24), 2**24), d=st.integers(0, 4096))
def test_what_is_kept_is_truncated_toward_zero(x, d):
    magnitude = abs(x) * (4096 - d) // 4096
    assert int(decay(np.array(x), d)) == (magnitude if x >= 0 else -magnitude)


@pytest.mark.parametrize(
    ("mantissa", "exponent", "weight"),
    [(3, 0, 192), (3, 2, 768), (-3, -1, -128), (3, -1, 64), (-1, -8, -64), (1, -8, 0)],
)
def test_a_negative_exponent_floors_every_weight(mantissa, exponent, weight):
    assert int(effective_weight(np.array(mantissa), exponent)) == weight


def integers(*, mantissa=((4, -6),), exponent=0, delay=0, signs="apart", **changes):
    """Return a network of one integer neuron behind two channels, with parameters of the neuron changed."""
    parameters = {"decay_u": 4096, "decay_v": 10, "threshold": 5} | changes
    neuron = ChipCuba.of(1, **parameters)
    projection = ChipProjection(
        "touch", "n", matrix(mantissa, np.int64), exponent, weight_bits=8, signs=signs, delay=delay
    )
    return replace(single(neuron, [[1.0, 1.0]]), projections=(projection,))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        pytest.param(
            {"threshold": 1 << 17},
            "compartments 'n': threshold of compartment 0 is out of range (131072 against 0..131071). "
            "Give a 64th of the threshold, or scale the weights down.",
            id="threshold",
        ),
        pytest.param(
            {"decay_u": 4097},
            "compartments 'n': decay_u of compartment 0 is out of range (4097 against 0..4096). "
            "Give an effective decay, what is subtracted from 4096.",
            id="decay",
        ),
        pytest.param(
            {"refractory": 64},
            "compartments 'n': refractory of compartment 0 is out of range (64 against 1..63). "
            "Shorten the refractory period; 1 blocks no step.",
            id="refractory",
        ),
        pytest.param(
            {"bias_mantissa": 4096},
            "compartments 'n': bias_mantissa of compartment 0 is out of range "
            "(4096 against -4096..4095). Raise the bias exponent or scale the bias down.",
            id="bias",
        ),
        pytest.param(
            {"mantissa": ((4, -256),)},
            "synapses 'touch' -> 'n': weight -256 is not on the grid of 8-bit inhibitory weights "
            "(multiples of 1 in -255..0; 1 of 1 weight off). Round the weights onto the grid first.",
            id="apart",
        ),
        pytest.param(
            {"mantissa": ((4, -7),), "signs": "mixed"},
            "synapses 'touch' -> 'n': weight -7 is not on the grid of 8-bit mixed weights "
            "(multiples of 2 in -256..254; 1 of 2 weights off). Round the weights onto the grid first.",
            id="mixed",
        ),
        pytest.param(
            {"exponent": 8},
            "synapses 'touch' -> 'n': the weight exponent is out of range (8 against -8..7). "
            "Rescale the weights.",
            id="exponent",
        ),
        pytest.param(
            {"delay": 63},
            "synapses 'touch' -> 'n': a delay is out of range (63 against 0..62 steps; "
            "1 of 1 delay outside). Relay the spike through 1 compartment, or shorten the delay.",
            id="delay",
        ),
    ],
)
def test_integers_that_the_chip_does_not_hold_are_refused(changes, message):
    with pytest.raises(TargetError) as caught:
        lower(integers(**changes), CHIP, weight_bits=8)
    assert str(caught.value) == message


def test_a_mixed_projection_is_one_format_and_holds_minus_256():
    network = integers(mantissa=((254, -256),), signs="mixed")
    (synapses,) = lower(network, CHIP, weight_bits=8).compartments.synapses
    assert synapses.sign_mode == "mixed"
    assert synapses.mantissa.tolist() == [254, -256]
