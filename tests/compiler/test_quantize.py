"""Quantising: the scale of a population, and its weights, decays and thresholds in the chip's integers.

A scale is how many units of the registers a potential of 1 becomes.
"""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import hw_model as hw
from hw_model.arithmetic.fixed_point import WEIGHT_BITS
from locsnn_compile.errors import TargetError
from locsnn_compile.network.neurons import Cuba, SoftCuba
from locsnn_compile.network.projections import values_of
from locsnn_compile.passes.kernels import one_decay
from locsnn_compile.passes.quantize import quantize
from locsnn_compile.passes.rounding.task import HEADROOM, Rounding
from locsnn_compile.pipeline import lower
from tests.support.networks import NEURON, UNIT, hybrid, single

CHIP = hw.chip("loihi-sim")


@settings(max_examples=60, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    bits=st.sampled_from(WEIGHT_BITS),
    scale=st.floats(1e-3, 1e3),
    theta=st.floats(0.1, 100),
)
def test_every_weight_is_within_half_a_grid_step(seed, bits, scale, theta):
    network = hybrid(seed, scale=scale, neuron=replace(NEURON, theta=theta))
    quantized = quantize(network, CHIP, bits)
    gain = one_decay(NEURON.tau_sr, "tau_sr").gain
    for p, q in zip(network.projections, quantized.projections, strict=True):
        population = quantized.population(p.target)
        exact = p.weights * gain * population.scale[0] / (UNIT * 2.0**q.exponent)
        step = 1 << (8 - bits)
        largest_mantissa = 256 - step
        is_near = (np.abs(exact - q.mantissa) <= step / 2 * (1 + 1e-9)).all()
        # With few bits, the largest weights of a population may be cut.
        is_cut = largest_mantissa * 1.01 < np.abs(exact).max()
        assert is_near or is_cut
        assert (np.sign(q.mantissa) * np.sign(p.weights) >= 0).all()
        assert UNIT * HEADROOM * population.neuron.threshold[0] <= CHIP.registers.voltage_max


@given(theta=st.floats(0.1, 100), v=st.integers(-(2**23), 2**23))
@settings(max_examples=40, deadline=None)
def test_the_threshold_rule_is_exact(theta, v):
    """``u >= theta`` in float is ``v > 64 * threshold`` in integers for every v, since the scale is chosen for it."""
    population = quantize(hybrid(neuron=replace(NEURON, theta=theta)), CHIP).populations[0]
    exact = v * 1.0 >= population.scale[0] * theta * (1 - 1e-12)
    assert exact == (v > UNIT * population.neuron.threshold[0])


@pytest.mark.parametrize(
    ("tau", "decay"), [(10.0, 390), (1.0, 2589), (0.05, 4096), (100.0, 41), (4000.0, 1)]
)
def test_decays_are_the_nearest(tau, decay):
    """The exact values 4096 * (1 - exp(-1 / tau)) are 389.8, 2589.2, 4096.0, 40.8 and 1.02."""
    assert one_decay(tau, "tau")[:2] == (decay, decay)


@pytest.mark.parametrize("tau", [0.3, 1.0, 3.0, 10.0, 77.0])
def test_gain_and_error_are_those_of_the_least_squares_fit(tau):
    decay, _, gain, error = one_decay(tau, "tau")
    k = np.arange(1, 20_000, dtype=float)
    kernel = k / tau * np.exp(1 - k / tau)
    response = k * ((4096 - decay) / 4096) ** (k - 1)
    best_gain = (kernel @ response) / (response @ response)
    squared_error = ((kernel - best_gain * response) ** 2).sum() / (kernel @ kernel)
    assert gain == pytest.approx(best_gain, rel=1e-9)
    assert error == pytest.approx(math.sqrt(squared_error), rel=1e-4, abs=1e-7)


# The limits in the messages:
# - 8191 steps: for a longer time constant, 4096 * (1 - exp(-1 / tau)) is below a half.
# - 32138 thresholds: the largest weight, 255 * 2^7 mantissas, over the smallest threshold, 1 + 1/64.
# - 32767 thresholds: the largest charge, just below 2^21 units, which are 32,768 mantissas of 64.
@pytest.mark.parametrize(
    ("network", "message"),
    [
        (
            hybrid(neuron=replace(NEURON, tau_sr=1e5)),
            "population 'time_hidden': tau_sr: the decay rounds to 0, so the potential would never decay "
            "(100000 steps against at most 8191). Use a shorter time constant or a longer step.",
        ),
        (
            hybrid(scale=1e9),
            "population 'time_hidden': no scale holds both the threshold and the largest weight "
            "(one weight reaches 3.21e+07 thresholds against 32138). Train with smaller weights, or a higher threshold.",
        ),
        (
            single(SoftCuba.of(1, decay_u=1.0, decay_v=0.1, threshold=1.0, drop=1e6)),
            "population 'n': no scale holds both the threshold and the drop of a spike (a spike takes 1e+06 thresholds "
            "against 32767). Train with a smaller drop, or a higher threshold.",
        ),
    ],
    ids=["tau too long", "weights too large", "a drop too large"],
)
def test_a_network_that_no_scale_fits_is_refused(network, message):
    with pytest.raises(TargetError) as caught:
        quantize(network, CHIP)
    assert str(caught.value) == message


def test_weights_of_zero_stay_zero():
    quantized = quantize(hybrid(scale=0.0), CHIP)
    assert all((p.mantissa == 0).all() for p in quantized.projections)


@pytest.mark.parametrize(
    ("sources", "several"), [(1024, True), (1025, False)], ids=["room", "no room"]
)
def test_weights_take_several_formats_where_a_core_has_room(sources, several):
    """In 4 exponents of 2 signs, a source has 8 synapse lists of a word or more.

    Lists of 1,024 sources then take half of a core's 16,384 words, which is the limit for several formats.
    """
    weights = np.append(np.geomspace(0.0005, 0.01, sources - 1), 1.0)[None, :]
    network = single(Cuba.of(1, decay_v=1.0, threshold=1.0), weights)
    quantized = quantize(network, CHIP, rounding=Rounding(graded=True))
    assert (len({p.exponent for p in quantized.projections}) > 1) == several


@pytest.mark.parametrize("sign", [1, -1])
def test_inputs_that_all_come_at_once_do_not_wrap(sign):
    weights = sign * np.linspace(0.5, 1.5, 60)[None, :]
    network = single(Cuba.of(1, decay_v=1.0, threshold=1.0), weights, steps=6)
    levels = lower(network, CHIP, weight_bits=8)
    # No bit of the weights is given up for it.
    for projection in levels.quantized.projections:
        assert np.abs(values_of(projection.mantissa)).max() == 255
    result = hw.simulate(levels.program, np.ones((6, 60), dtype=np.uint8))
    spikes = int(sign > 0)
    assert result.spikes["n"].ravel().tolist() == [0] + [spikes] * 5
    assert result.counts.charge_wraps == 0
    assert result.counts.current_wraps == 0
