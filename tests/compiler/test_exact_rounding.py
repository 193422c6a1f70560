"""Every integer of a quantised network against exact fractions: weights, split weights, biases, own spikes, and decays.

The expected integers are worked out here in a few lines of exact arithmetic. The compiler computes in floats, which may
fall on either side of a tie, so near a tie both neighbours are accepted. Where all floats are exact, ties go to the even
number.
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
"""The largest exponent of a weight."""


def near(value: Fraction, step: int = 1, most: int | None = None) -> set[int]:
    """Return the multiples of ``step`` that floats may take for the nearest to a value, half to even, clipped to ``most``."""
    multiples = {step * round(value * (1 + error) / step) for error in (-SLACK, 0, SLACK)}
    if most is None:
        return multiples
    return {max(-most, min(most, multiple)) for multiple in multiples}


def check_near(rounded: int, value: Fraction, step: int = 1, most: int | None = None) -> None:
    """Check that a number is the rounded value."""
    assert rounded in near(value, step, most), (rounded, float(value), step, most)


def quanta_of(quantized, shape: tuple[int, int]) -> list[list[Fraction]]:
    """Return the effective weights of the chip in quanta (units of 64): floor(mantissa * 2^exponent).

    Weights between the same two neurons are added.
    """
    total: dict[tuple[int, int], Fraction] = defaultdict(Fraction)
    for p in quantized.projections:
        for (i, j), m in np.ndenumerate(p.mantissa):
            total[i, j] += Fraction(int(m)) * Fraction(2) ** p.exponent // 1
    return [[total[i, j] for j in range(shape[1])] for i in range(shape[0])]


# --- one format ---


@pytest.mark.parametrize("mode", SIGN_MODES)
@pytest.mark.parametrize("bits", WEIGHT_BITS)
def test_a_format_rounds_half_to_even_and_clips(bits, mode):
    """Tested at every half step of the grid and beyond its ends, and at the neighbouring floats."""
    step = 2 ** (9 - bits if mode == "mixed" else 8 - bits)
    low, high = {
        "mixed": (-256, 256 - step),
        "excitatory": (0, 256 - step),
        "inhibitory": (step - 256, 0),
    }[mode]
    ties = np.arange(-530, 531) * step / 2
    values = np.concatenate((np.nextafter(ties, -np.inf), ties, np.nextafter(ties, np.inf)))
    rounded = [step * round(Fraction(value) / step) for value in values.tolist()]
    expected = [max(low, min(high, value)) for value in rounded]
    assert weight_grid(bits, mode).round(values).tolist() == expected


def exact_gain(neuron: Cuba, decay_u: int, decay_v: int) -> Fraction:
    """Return the gain with which the response of the rounded decays is nearest to that of the neuron's decays.

    A response is the convolution of two geometric series, of current and voltage; the least-squares gain is the overlap
    of both responses divided by that of the rounded one with itself.
    """
    keep_u = 1 - Fraction(float(neuron.decay_u[0]))
    keep_v = 1 - Fraction(float(neuron.decay_v[0]))
    rounded_u = 1 - Fraction(decay_u, 4096)
    rounded_v = 1 - Fraction(decay_v, 4096)

    def overlap(a, b, c, d):
        """Return the sum over steps of the product of the responses of (a, b) and of (c, d)."""
        return (1 - a * b * c * d) / ((1 - a * c) * (1 - a * d) * (1 - b * c) * (1 - b * d))

    with_neuron = overlap(keep_u, keep_v, rounded_u, rounded_v)
    return with_neuron / overlap(rounded_u, rounded_v, rounded_u, rounded_v)


FADING = st.sampled_from([1.0, 0.5, 0.1, 0.3, 0.0123])
"""Decays above 0, for which the sums over steps are finite."""


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
    decay_u, decay_v = decays
    neuron = Cuba.of(2, decay_u=decay_u, decay_v=decay_v, threshold=threshold, rule=rule)
    quantized = quantize(single(neuron, weights), CHIP, bits)
    chip = quantized.populations[0].neuron
    assert chip.decay_u[0] == round(4096 * Fraction(decay_u))
    assert chip.decay_v[0] == round(4096 * Fraction(decay_v))
    # The chip spikes above its threshold, so a neuron that spikes at its threshold has one unit more.
    chip_threshold = 64 * int(chip.threshold[0]) + (rule == ">=")
    scale = Fraction(chip_threshold) / Fraction(threshold)
    gain = exact_gain(neuron, int(chip.decay_u[0]), int(chip.decay_v[0]))
    (projection,) = quantized.projections
    step = 2 ** (8 - bits)
    for (i, j), weight in np.ndenumerate(weights):
        exact = Fraction(float(weight)) * gain * scale / (64 * Fraction(2) ** projection.exponent)
        check_near(int(projection.mantissa[i, j]), exact, step, 256 - step)


@settings(deadline=None)
@given(bits=BITS, data=st.data())
def test_weights_halfway_between_two_of_a_format_are_even(bits, data):
    """The first weight fills the format, so that the scale is a power of two, and all floats are exact."""
    step = 2 ** (8 - bits)
    largest = 2 ** (bits + 1) - 2  # in halves of a step
    drawn = data.draw(st.lists(st.integers(-largest, largest), min_size=1, max_size=9))
    halves = [largest, *drawn]
    weights = [[step * half / 2 for half in halves]]
    quantized = quantize(single(Cuba.of(1, decay_v=1.0, threshold=1.0), weights), CHIP, bits)
    (projection,) = quantized.projections
    assert projection.mantissa[0].tolist() == [step * round(Fraction(half, 2)) for half in halves]


# --- several formats, and two synapses for a weight ---


def grades_for(largest: Fraction, bits: int, count: int, any_split: bool) -> list[int]:
    """Return the grades of a population's weights, finest first: grade k holds 1 to 2^bits - 1 times 2^k quanta.

    There are ``count`` grades, up to the finest that holds the largest weight. Split weights have a second synapse,
    which adds grades finer by ``bits``.
    """
    coarsest = LAST_EXPONENT + 8 - bits
    highest = coarsest
    for grade in range(coarsest):
        if round(largest / 2**grade) <= 2**bits - 1:
            highest = grade
            break
    first = set(range(max(0, highest - count + 1), highest + 1))
    second = {max(0, grade - bits) for grade in first} if any_split else set()
    return sorted(first | second)


def grade_of(magnitude: Fraction, bits: int, grades: list[int]) -> int:
    """Return the finest grade that holds a magnitude with one more step (with 1 bit: that holds it), else the coarsest."""
    most_steps = 2**bits - 1 - (bits > 1)
    for grade in grades:
        if magnitude <= most_steps * 2**grade:
            return grade
    return grades[-1]


def exact_quanta(
    values: list[Fraction], bits: int, count: int, split: list[bool]
) -> list[set[int]]:
    """Return what each weight may be rounded to, in quanta; near the end of a grade, floats may take either grade."""
    grades = grades_for(max(map(abs, values)), bits, count, any(split))
    roundings = []
    for value, is_split in zip(values, split, strict=True):
        allowed = set()
        for error in (-SLACK, SLACK):
            grade = grade_of(abs(value) * (1 + error), bits, grades)
            finest = grade
            if is_split:
                finest = next(second for second in grades if second >= grade - bits)
            allowed |= near(value, step=2**finest, most=(2**bits - 1) * 2**grade)
        roundings.append(allowed)
    return roundings


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
    # The largest weights are split.
    largest_first = np.argsort(-np.abs(weights.ravel()), kind="stable")
    split_weights = set(largest_first[: round(share * weights.size)].tolist())
    split = [i in split_weights for i in range(len(values))]
    allowed = exact_quanta(values, bits, count=3 if share else 4, split=split)
    rounded = [quanta for row in quanta_of(quantized, weights.shape) for quanta in row]
    for number, quanta in enumerate(rounded):
        assert quanta in allowed[number], number
    synapses = np.sum([p.mantissa.ravel() != 0 for p in quantized.projections], axis=0)
    assert (synapses <= 1 + np.array(split)).all()
    assert quantized.weights_pruned == rounded.count(0)


def test_a_weight_of_two_synapses_by_hand():
    """With 4 bits and a threshold of 7, the weight 1000 is 7000 quanta, nearest to 13 * 512 + 11 * 32."""
    weights = np.array([[1000.0, 999.0, 900.0, -13.0, 3.5]])
    neuron = Cuba.of(1, decay_v=1.0, threshold=1.0)
    rounding = Rounding(graded=True, split=0.4)
    quantized = quantize(single(neuron, weights), CHIP, weight_bits=4, rounding=rounding)
    assert quantized.populations[0].neuron.threshold.tolist() == [7]
    # Mantissas have four high bits of eight, so a step is 16 times 2^exponent: 512, 32 and 8 quanta.
    steps = {p.exponent: (p.mantissa[0] // 16).tolist() for p in quantized.projections}
    assert steps == {5: [13, 13, 12, 0, 0], 1: [11, 11, 0, 0, 0], -1: [0, 0, 0, -11, 3]}


# --- biases, own spikes, decays and delays ---


@settings(deadline=None)
@given(
    biases=st.lists(st.floats(-50, 50), min_size=1, max_size=5),
    threshold=st.floats(0.02, 10),
    decay=st.sampled_from([1.0, 0.25, 0.1]),
)
def test_biases_are_the_nearest_with_all_bits_of_a_mantissa(biases, threshold, decay):
    """The potential bias / decay, at which a bias settles, is kept: the bias is scaled as rounding scales the decay."""
    neuron = Cuba.of(len(biases), decay_v=decay, threshold=threshold, bias=biases)
    chip = quantize(single(neuron, np.zeros((len(biases), 1))), CHIP).populations[0].neuron
    most = 2**CHIP.registers.bias_mantissa_bits - 1
    for i, bias in enumerate(biases):
        decay_ratio = Fraction(int(chip.decay_v[i]), 4096) / Fraction(decay)
        scale = 64 * int(chip.threshold[i]) / Fraction(threshold)
        value = Fraction(bias) * decay_ratio * scale
        exponent = int(chip.bias_exponent[i])
        mantissa = int(chip.bias_mantissa[i])
        check_near(mantissa, value / 2**exponent, step=1, most=most)
        assert abs(value) * (1 - SLACK) <= most * 2**exponent
        assert exponent <= CHIP.registers.bias_exponent_max
        # The exponent is the smallest that holds the value.
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
    """A spike is to subtract the drop once. A synapse to itself does so, but the current keeps a part of it.

    A second synapse, one step later, therefore gives back what the current keeps.
    """
    neuron = SoftCuba.of(1, decay_u=decay, decay_v=0.1, threshold=threshold, drop=drop * threshold)
    chip = quantize(single(neuron, [[threshold / 3]]), CHIP).populations[0].neuron
    taps = chip.refractory
    subtracted = [Fraction(0), Fraction(0)]  # by the delay of the synapse, in quanta
    for delay, (mantissa,), exponent in zip(taps.delay, taps.mantissa, taps.exponent, strict=True):
        subtracted[delay] -= Fraction(int(mantissa)) * Fraction(2) ** int(exponent)
    exact_drop = Fraction(drop * threshold) / Fraction(threshold) * int(chip.threshold[0])
    check_near(int(subtracted[0]), exact_drop)
    given_back = round(subtracted[0] * (4096 - int(chip.decay_u[0])) / 4096)
    assert subtracted == [int(subtracted[0]), -given_back]


def test_decays_are_the_nearest_half_to_even():
    """Tested at every half of a decay, and at the neighbouring floats; fractions that round to 0 are refused elsewhere."""
    halves = np.arange(2, 8193) / 8192
    shares_lost = np.concatenate((halves, np.nextafter(halves, 0), np.nextafter(halves[:-1], 1)))
    expected = [round(4096 * Fraction(share)) for share in shares_lost.tolist()]
    assert nearest_decays(shares_lost, "n").tolist() == expected
