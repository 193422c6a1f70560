"""How well the chip's integers fit the responses of float neurons, against a simulation of both step by step.

All decays are multiples of 1 / 4096, so that they are not rounded, and only truncated registers differ from the floats.
"""

import math

import numpy as np
import pytest

import hw_model as hw
from locsnn_compile.network.neurons import Cuba, SoftCuba
from locsnn_compile.passes.quantize import quantize
from tests.support.networks import single

CHIP = hw.chip("loihi-sim")


def kept(x: int, decay: float) -> int:
    """Return what a step keeps of a register, truncated toward zero."""
    return math.copysign(abs(x) * round(4096 * (1 - decay)) // 4096, x)


def errors(chip: list[float], exact: list[float]) -> tuple[float, float]:
    """Return the largest and the root mean square error of a response, relative to the exact one."""
    difference = np.array(chip) - np.array(exact)
    energy = float((np.array(exact) ** 2).sum())
    largest = float(np.abs(difference).max() / np.abs(exact).max())
    return largest, math.sqrt(float((difference**2).sum()) / energy)


def compared_steps(*shares_kept: float) -> int:
    """Return twelve time constants of the slowest state, and twelve steps more."""
    tau = -1 / math.log(max(shares_kept))
    return math.ceil(12 * tau) + 12


def input_errors(decay_u: float, decay_v: float, threshold: int, steps: int) -> tuple[float, float]:
    """Return the errors of the response to a charge that brings a neuron to its threshold, in counts of a register."""
    current, potential = 1.0, 0.0
    response = []
    for _ in range(steps):
        potential = (1 - decay_v) * potential + current
        current *= 1 - decay_u
        response.append(potential)
    weight = threshold / max(response)
    u, v = round(weight), 0
    chip = []
    for _ in range(steps):
        v = kept(v, decay_v) + u
        u = kept(u, decay_u)
        chip.append(v)
    return errors(chip, [weight * value for value in response])


def drop_errors(decay_v: float, drop: int, steps: int) -> tuple[float, float]:
    """Return the errors of what a spike takes from a potential, in counts of a register."""
    exact = [-drop * (1 - decay_v) ** lag for lag in range(steps)]
    v = -drop
    chip = []
    for _ in range(steps):
        chip.append(v)
        v = kept(v, decay_v)
    return errors(chip, exact)


def worst(rows: list[tuple[float, float]]) -> tuple[float, float]:
    """Return the largest of each kind of error over neurons."""
    return max(row[0] for row in rows), max(row[1] for row in rows)


DECAYS = [(1 / 4, 1 / 2), (1.0, 1 / 64)]
"""The decays of current and voltage of two neurons."""


def test_the_fit_of_leaky_neurons_is_that_of_the_worst():
    decay_u, decay_v = zip(*DECAYS, strict=True)
    neuron = Cuba.of(2, decay_u=decay_u, decay_v=decay_v, threshold=1.0)
    population = quantize(single(neuron, [[0.5], [0.25]]), CHIP).populations[0]
    threshold = 64 * int(population.neuron.threshold[0])
    steps = compared_steps(*(1 - decay for pair in DECAYS for decay in pair))
    expected = worst([input_errors(u, v, threshold, steps) for u, v in DECAYS])
    fit = population.fit
    assert (fit.input_max, fit.input_rms) == pytest.approx(expected, rel=1e-6)
    assert (fit.refractory_max, fit.refractory_rms) == (None, None)


def test_the_fit_of_what_spikes_subtract_is_that_of_the_worst():
    """Both neurons subtract their threshold; the second keeps it for longer."""
    decays = [1 / 2, 1 / 64]
    neuron = SoftCuba.of(2, decay_u=1.0, decay_v=decays, threshold=1.0, drop=1.0)
    population = quantize(single(neuron, [[0.5], [0.25]]), CHIP).populations[0]
    threshold = 64 * int(population.neuron.threshold[0])
    steps = compared_steps(*(1 - decay for decay in decays))
    of_input = worst([input_errors(1.0, decay, threshold, steps) for decay in decays])
    of_drop = worst([drop_errors(decay, threshold, steps) for decay in decays])
    fit = population.fit
    assert (fit.input_max, fit.input_rms) == pytest.approx(of_input, rel=1e-6)
    assert (fit.refractory_max, fit.refractory_rms) == pytest.approx(of_drop, rel=1e-6)
