"""Compiling refuses a population all of whose weights round to 0 if an input alone could have made it spike.

The limit is worked out by hand: a weight w onto a neuron adds up to ``answer * w`` thresholds if its input spikes in
each of four steps.
"""

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
"""The sum of the kernel over the spikes of four steps; the spike of the last step acts after the end."""
LEAKY_TWICE = Cuba.of(1, decay_u=0.5, decay_v=0.5, threshold=2.0)
SOFT = SoftCuba.of(1, decay_u=0.5, decay_v=0.5, threshold=2.0, drop=1.0)
NEURONS = [
    pytest.param(Cuba.of(1, decay_u=1.0, decay_v=1.0, threshold=2.0), 1 / 2, id="one step"),
    pytest.param(Cuba.of(1, decay_u=0.5, decay_v=1.0, threshold=2.0), 2 / 2, id="leaky"),
    pytest.param(LEAKY_TWICE, 4 / 2, id="leaky twice"),
    pytest.param(Cuba.of(1, decay_u=1.0, decay_v=0.0, threshold=2.0), 4 / 2, id="integrator"),
    pytest.param(SOFT, 4 / 2, id="soft"),
    pytest.param(SRM, KERNEL / 4, id="spike response"),
]
"""Neurons, and the thresholds that a weight of 1 adds up to in four steps, or in any number of steps where states decay."""


def check(neuron, weight, mantissa=0):
    """Check a neuron with one weight that was rounded to ``mantissa``."""
    population = Population("n", "time", size=1, neuron=neuron)
    weights = np.array([[0.0, weight]])
    rounded = ChipProjection("x", "n", np.array([[0, mantissa]]), exponent=0, weight_bits=8)
    task = Task(
        population=population,
        incoming=(Projection("x", "n", weights),),
        chip=hw.chip("loihi-sim"),
        grid=weight_grid(8, "excitatory"),
        setting=Setting("dendrite", weight_bits=8),
        rounding=NEAREST,
        calibration=None,
    )
    check_heard(task, [[rounded]], STEPS)


@pytest.mark.parametrize(("neuron", "answer"), NEURONS)
def test_a_lost_input_that_would_reach_the_threshold_is_an_error(neuron, answer):
    just_below = 0.999 / answer
    check(neuron, just_below)
    twice_the_limit = 2 / answer
    check(neuron, twice_the_limit, mantissa=1)
    with pytest.raises(TargetError) as caught:
        check(neuron, 1.0001 / answer)
    fix = "Use larger weights, or smaller biases."
    if isinstance(neuron, SrmAlpha):
        fix = "Use larger weights, a shorter tau_sr, or a smaller scale_ref."
    assert str(caught.value) == (
        "population 'n': every weight rounds to 0, so no input reaches it "
        f"(one input that spikes in every step could reach 1 thresholds). {fix}"
    )


def test_reaching_the_threshold_exactly_is_enough():
    with pytest.raises(TargetError):
        check(LEAKY_TWICE, 0.5)
