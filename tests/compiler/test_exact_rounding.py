"""Every integer of a quantised network against fractions: weights, split weights, biases, own spikes, decays, delays.

The wanted integers are worked out here in a few lines of exact arithmetic. Floats may fall on either side of a tie, so
both neighbours of a value that is nearly one are right; where all floats are exact, ties go to the even number.
"""

from __future__ import annotations

from collections import defaultdict
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import hw_model as hw
from hw_model.arithmetic.fixed_point import SIGN_MODES, WEIGHT_BITS, weight_grid
from locsnn_compile.network.neurons import Cuba, SoftCuba
from locsnn_compile.passes.kernels import nearest_decays
from locsnn_compile.passes.quantize import quantize
from locsnn_compile.passes.rounding.task import Rounding
from tests.support.networks import single

CHIP = hw.chip("loihi-sim")
BITS = st.sampled_from(WEIGHT_BITS)
SLACK = Fraction(1, 10**13)
"""Relative error that floats may have when they are rounded."""
LAST_EXPONENT = 7


def near(value: Fraction, step: int = 1, most: int | None = None) -> set[int]:
    """The multiples of ``step`` nearest to a value, half to even, as far as floats can tell, clipped to ``most``."""
    found = {step * round(value * (1 + side) / step) for side in (-SLACK, 0, SLACK)}
    return found if most is None else {max(-most, min(most, one)) for one in found}


def check_near(found: int, value: Fraction, *limits: int) -> None:
    assert found in near(value, *limits), (found, float(value), limits)


def quanta_of(quantized, shape: tuple[int, int]) -> list[list[Fraction]]:
    """Sums of the weights that join the same ends, in units of 64, as the chip has them: floor(mantissa * 2^exponent)."""
    total: dict[tuple[int, int], Fraction] = defaultdict(Fraction)
    for p in quantized.projections:
        for (i, j), m in np.ndenumerate(p.mantissa):
            total[i, j] += Fraction(int(m)) * Fraction(2) ** p.exponent // 1
    return [[total[i, j] for j in range(shape[1])] for i in range(shape[0])]


# --- one format ---


@pytest.mark.parametrize("mode", SIGN_MODES)
@pytest.mark.parametrize("bits", WEIGHT_BITS)
def test_a_format_rounds_half_to_even_and_clips(bits, mode):
    """At every half step of its grid and beyond its ends, and at the floats on both sides."""
    step = 2 ** (9 - bits if mode == "mixed" else 8 - bits)
    low, high = {
        "mixed": (-256, 256 - step),
        "excitatory": (0, 256 - step),
        "inhibitory": (step - 256, 0),
    }[mode]
    ties = np.arange(-530, 531) * step / 2
    values = np.concatenate((np.nextafter(ties, -np.inf), ties, np.nextafter(ties, np.inf)))
    wanted = [
        max(low, min(high, step * round(Fraction(value) / step))) for value in values.tolist()
    ]
    assert weight_grid(bits, mode).round(values).tolist() == wanted


def exact_gain(neuron: Cuba, decay_u: int, decay_v: int) -> Fraction:
    """The gain that makes the response of the rounded decays nearest to that of the neuron's, which fade."""
    a, b = (1 - Fraction(float(d[0])) for d in (neuron.decay_u, neuron.decay_v))
    c, d = (1 - Fraction(decay, 4096) for decay in (decay_u, decay_v))

    def overlap(a, b, c, d):
        return (1 - a * b * c * d) / ((1 - a * c) * (1 - a * d) * (1 - b * c) * (1 - b * d))

    return overlap(a, b, c, d) / overlap(c, d, c, d)


FADING = st.sampled_from([1.0, 0.5, 0.1, 0.3, 0.0123])


@settings(deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    bits=BITS,
    decays=st.tuples(FADING, FADING),
    threshold=st.floats(1e-3, 1e3),
    rule=st.sampled_from([">", ">="]),
    spread=st.sampled_from([1, 5]),
)
def test_weights_of_one_format_are_the_nearest(seed, bits, decays, threshold, rule, spread):
    """Magnitudes are rounded, so that positive and negative weights are rounded alike."""
    weights = threshold * np.random.default_rng(seed).uniform(-2, 2, (2, 6)) ** spread
    neuron = Cuba.of(2, decay_u=decays[0], decay_v=decays[1], threshold=threshold, rule=rule)
    quantized = quantize(single(neuron, weights), CHIP, bits)
    chip = quantized.populations[0].neuron
    assert [chip.decay_u[0], chip.decay_v[0]] == [round(4096 * Fraction(one)) for one in decays]
    scale = Fraction(64 * int(chip.threshold[0]) + (rule == ">=")) / Fraction(threshold)
    gain = exact_gain(neuron, int(chip.decay_u[0]), int(chip.decay_v[0]))
    (projection,) = quantized.projections
    step = 2 ** (8 - bits)
    for (i, j), weight in np.ndenumerate(weights):
        exact = Fraction(float(weight)) * gain * scale / (64 * Fraction(2) ** projection.exponent)
        check_near(int(projection.mantissa[i, j]), exact, step, 256 - step)


@settings(deadline=None)
@given(bits=BITS, data=st.data())
def test_weights_halfway_between_two_of_a_format_are_even(bits, data):
    """The largest weight fills the format, so that the scale is a power of two, and no float is rounded."""
    step = 2 ** (8 - bits)
    most = 2 ** (bits + 1) - 2
    halves = [most, *data.draw(st.lists(st.integers(-most, most), min_size=1, max_size=9))]
    quantized = quantize(
        single(Cuba.of(1, decay_v=1.0, threshold=1.0), [[step * h / 2 for h in halves]]), CHIP, bits
    )
    (projection,) = quantized.projections
    assert projection.mantissa[0].tolist() == [step * round(Fraction(h, 2)) for h in halves]


# --- several formats, and two synapses for a weight ---


def exact_quanta(
    values: list[Fraction], bits: int, count: int, split: list[bool]
) -> list[set[int]]:
    """What each of some weights is rounded to, in units of 64: in the finest format that holds it with one step more.

    A format holds 1 to 2^bits - 1 times 2^k. A split weight has a second synapse, ``bits`` finer where there is one.
    """
    full, top = 2**bits - 1, LAST_EXPONENT + 8 - bits
    largest = max(map(abs, values))
    highest = next((k for k in range(top) if round(largest / 2**k) <= full), top)
    first = range(max(0, highest - count + 1), highest + 1)
    held = sorted({*first, *(max(0, k - bits) for k in first if any(split))})
    found = []
    for value, two in zip(values, split, strict=True):
        fits = {
            next((k for k in held if size <= (full - (bits > 1)) * 2**k), held[-1])
            for size in (abs(value) * (1 - SLACK), abs(value) * (1 + SLACK))
        }
        steps = {k: next(n for n in held if n >= k - bits) if two else k for k in fits}
        found.append(set().union(*(near(value, 2 ** steps[k], full * 2**k) for k in fits)))
    return found


@settings(deadline=None, max_examples=150)
@given(
    seed=st.integers(0, 2**32 - 1),
    bits=BITS,
    share=st.sampled_from([0.0, 0.2, 0.5, 1.0]),
    spread=st.sampled_from([1, 5, 13]),
    heavy=st.sampled_from([0.5, 4.0, 3000.0]),
)
def test_weights_of_several_formats_add_up_to_the_nearest(seed, bits, share, spread, heavy):
    weights = heavy * np.random.default_rng(seed).uniform(-1, 1, (2, 9)) ** spread
    quantized = quantize(
        single(Cuba.of(2, decay_v=1.0, threshold=1.0), weights),
        CHIP,
        bits,
        rounding=Rounding(graded=True, split=share),
    )
    scale = int(quantized.populations[0].neuron.threshold[0])
    values = [Fraction(float(weight)) * scale for weight in weights.ravel()]
    largest = np.argsort(-np.abs(weights.ravel()), kind="stable")[
        : round(share * weights.size)
    ].tolist()
    split = [i in largest for i in range(len(values))]
    wanted = exact_quanta(values, bits, 3 if share else 4, split)
    found = [one for row in quanta_of(quantized, weights.shape) for one in row]
    assert [
        (i, f, w) for i, (f, w) in enumerate(zip(found, wanted, strict=True)) if f not in w
    ] == []
    parts = np.sum([p.mantissa.ravel() != 0 for p in quantized.projections], axis=0)
    assert (parts <= 1 + np.array(split)).all()
    assert quantized.weights_pruned == found.count(0)


def test_a_weight_of_two_synapses_by_hand():
    """Formats of 4 bits: at a threshold of 7, 1000 is 7000, which 13 * 512 and 11 * 32 are nearest to."""
    weights = np.array([[1000.0, 999.0, 900.0, -13.0, 3.5]])
    neuron, rounding = Cuba.of(1, decay_v=1.0, threshold=1.0), Rounding(graded=True, split=0.4)
    quantized = quantize(single(neuron, weights), CHIP, weight_bits=4, rounding=rounding)
    assert quantized.populations[0].neuron.threshold.tolist() == [7]
    found = {p.exponent: (p.mantissa[0] // 16).tolist() for p in quantized.projections}
    # An exponent of -1 with the four high bits of eight is a step of 8.
    assert found == {5: [13, 13, 12, 0, 0], 1: [11, 11, 0, 0, 0], -1: [0, 0, 0, -11, 3]}


# --- biases, own spikes, decays and delays ---


@settings(deadline=None)
@given(
    biases=st.lists(st.floats(-50, 50), min_size=1, max_size=5),
    threshold=st.floats(0.02, 10),
    decay=st.sampled_from([1.0, 0.25, 0.1]),
)
def test_biases_are_the_nearest_with_all_bits_of_a_mantissa(biases, threshold, decay):
    """What a bias settles at is kept: it is multiplied by what rounding does to the decay."""
    neuron = Cuba.of(len(biases), decay_v=decay, threshold=threshold, bias=biases)
    found = quantize(single(neuron, np.zeros((len(biases), 1))), CHIP).populations[0].neuron
    most = 2**CHIP.registers.bias_mantissa_bits - 1
    for i, bias in enumerate(biases):
        settled = Fraction(int(found.decay_v[i]), 4096) / Fraction(decay)
        value = Fraction(bias) * settled * 64 * int(found.threshold[i]) / Fraction(threshold)
        exponent, mantissa = int(found.bias_exponent[i]), int(found.bias_mantissa[i])
        check_near(mantissa, value / 2**exponent, 1, most)
        assert abs(value) * (1 - SLACK) <= most * 2**exponent
        assert exponent <= CHIP.registers.bias_exponent_max
        assert exponent == 0 or abs(value) * (1 + SLACK) > most * 2 ** (exponent - 1)


@settings(deadline=None)
@given(
    drop=st.floats(0, 4),
    threshold=st.floats(0.01, 10),
    decay=st.sampled_from([1.0, 0.5, 0.1, 0.003]),
)
def test_own_spikes_take_the_nearest_drop_and_give_back_what_the_current_keeps(
    drop, threshold, decay
):
    neuron = SoftCuba.of(1, decay_u=decay, decay_v=0.1, threshold=threshold, drop=drop * threshold)
    found = quantize(single(neuron, [[threshold / 3]]), CHIP).populations[0].neuron
    taps, taken = found.refractory, [Fraction(0), Fraction(0)]
    for delay, (mantissa,), exponent in zip(taps.delay, taps.mantissa, taps.exponent, strict=True):
        taken[delay] -= Fraction(int(mantissa)) * Fraction(2) ** int(exponent)
    exact = Fraction(drop * threshold) / Fraction(threshold) * int(found.threshold[0])
    check_near(int(taken[0]), exact)
    assert taken == [int(taken[0]), -round(taken[0] * (4096 - int(found.decay_u[0])) / 4096)]


def test_decays_are_the_nearest_half_to_even():
    """At every half of a decay, and at the floats on both sides; a fraction that becomes 0 is refused."""
    halves = np.arange(2, 8193) / 8192
    lost = np.concatenate((halves, np.nextafter(halves, 0), np.nextafter(halves[:-1], 1)))
    assert nearest_decays(lost, "n").tolist() == [
        round(4096 * Fraction(one)) for one in lost.tolist()
    ]
