"""A population that would hear nothing: where one input alone would have reached the threshold, and just not."""

from __future__ import annotations

import numpy as np
import pytest

import hw_model as hw
from hw_model.arithmetic.fixed_point import weight_grid
from locsnn_compile.errors import TargetError
from locsnn_compile.network.network import Population
from locsnn_compile.network.neurons import Cuba, SoftCuba, SrmAlpha
from locsnn_compile.network.projections import ChipProjection, Projection
from locsnn_compile.passes.quantize import check_heard
from locsnn_compile.passes.rounding.task import NEAREST, Task
from locsnn_compile.settings import Setting

STEPS = 4
SRM = SrmAlpha(tau_sr=1.0, theta=4.0, tau_ref=1.0, scale_ref=1.0)
KERNEL = sum(k * np.exp(1 - k) for k in (1.0, 2.0, 3.0))
"""What one spike in each of four steps adds up to; the last acts after the end."""
NEURONS = [
    # name, neuron, how many thresholds a weight of 1 adds up to in four steps
    ("one step", Cuba.of(1, decay_u=1.0, decay_v=1.0, threshold=2.0), 1 / 2),
    ("leaky", Cuba.of(1, decay_u=0.5, decay_v=1.0, threshold=2.0), 2 / 2),
    ("leaky twice", Cuba.of(1, decay_u=0.5, decay_v=0.5, threshold=2.0), 4 / 2),
    ("integrator", Cuba.of(1, decay_u=1.0, decay_v=0.0, threshold=2.0), 4 / 2),
    ("soft", SoftCuba(np.array([0.5]), np.array([0.5]), np.array([2.0]), np.array([1.0])), 4 / 2),
    ("spike response", SRM, KERNEL / 4),
]


def check(neuron, weight, mantissa=0):
    population = Population("n", "time", 1, neuron)
    weights = np.array([[0.0, weight]])
    rounded = ChipProjection("x", "n", np.array([[0, mantissa]]), exponent=0, weight_bits=8)
    grid = weight_grid(8, "excitatory")
    task = Task(
        population,
        (Projection("x", "n", weights),),
        hw.chip("loihi-sim"),
        grid,
        Setting("dendrite", weight_bits=8),
        NEAREST,
        None,
    )
    check_heard(task, [[rounded]], STEPS)


@pytest.mark.parametrize(("name", "neuron", "answer"), NEURONS, ids=[row[0] for row in NEURONS])
def test_one_input_that_would_reach_the_threshold_is_missed(name, neuron, answer):
    check(neuron, 0.999 / answer)
    check(neuron, 2 / answer, mantissa=1)
    with pytest.raises(TargetError) as caught:
        check(neuron, 1.0001 / answer)
    fix = "Use larger weights, or smaller biases."
    if isinstance(neuron, SrmAlpha):
        fix = "Use larger weights, a shorter tau_sr, or a smaller scale_ref."
    assert str(caught.value) == (
        "population 'n': every weight rounds to 0, so no input reaches it "
        f"(one input that spikes in every step could reach 1 thresholds). {fix}"
    )


def test_reaching_it_exactly_is_enough():
    with pytest.raises(TargetError):
        check(Cuba.of(1, decay_u=0.5, decay_v=0.5, threshold=2.0), 0.5)
