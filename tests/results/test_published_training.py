"""The weight decays of the published configurations follow from the loss of the released code.

To RMSprop only the ratio of gradient and weight decay counts. The released code sums its loss over a batch and over the
steps of all outputs, ours is the mean over a batch of half the squared error of counts. So our weight decay is the released one
divided by the ratio of the gradients, which is worked out here from the released formula.
"""

from pathlib import Path

import numpy as np
import pytest

from locsnn_compile.training.config import read_config

CONFIGS = Path(__file__).parents[2] / "examples/configs"
BATCH = 8
RELEASED_DECAY = 0.5
LOCATIONS = 78
"""Channels of one fingertip."""
KERNEL_TAPS = 77
"""Steps at which the released code cuts the response kernel off."""
LAGS = np.arange(KERNEL_TAPS)
KERNEL = LAGS / 10 * np.exp(1 - LAGS / 10)
"""The response kernel with tau_sr 10."""


def released_gradients(outputs: int) -> np.ndarray:
    """Return what an error of one spike gives to each output step, lambda 1: the error over ``outputs``, correlated
    with the response kernel, summed over a batch."""
    error = np.full(outputs, 1 / outputs)
    return BATCH * np.convolve(error, KERNEL[::-1])[-outputs:]


def released_gradient_of_scaled_error(outputs: int) -> float:
    """Return the same for lambda 0.5, where the error is multiplied by 1,000 and meets no kernel."""
    return BATCH * outputs * (1000 / outputs) ** 2


@pytest.mark.parametrize(
    ("config", "outputs"),
    [("objects", 250 + 78), ("containers", 325 + 78), ("slip", 150 + 78)],
)
def test_published_weight_decay_of_the_hybrid_is_that_of_the_released_loss(
    config: str, outputs: int
) -> None:
    whole = read_config(CONFIGS / f"{config}-hybrid-published.yaml")
    half = read_config(CONFIGS / f"{config}-hybrid-half-published.yaml")
    of_time = released_gradients(outputs)[0]
    of_scaled_error = released_gradient_of_scaled_error(outputs)
    assert whole["weight_decay"] == pytest.approx(RELEASED_DECAY / of_time, rel=1e-3)
    assert half["weight_decay"] == pytest.approx(RELEASED_DECAY / of_scaled_error, rel=1e-3)


def test_two_fingertips_have_the_weight_decays_of_the_docs() -> None:
    # The figures of docs/research/results.md; two fingertips have 325 steps and 156 locations.
    gradients = released_gradients(325 + 156)
    assert gradients[:325] == pytest.approx(0.45, abs=0.001)
    assert 0.5 / gradients[0] == pytest.approx(1.11, abs=0.005)
    assert 0.5 / released_gradient_of_scaled_error(481) == pytest.approx(3.0e-5, rel=0.01)


@pytest.mark.parametrize(("config", "steps"), [("tactile-snn", 250)])
def test_published_weight_decay_of_the_time_branch(config: str, steps: int) -> None:
    decay = read_config(CONFIGS / f"{config}-published.yaml")["weight_decay"]
    assert decay == pytest.approx(RELEASED_DECAY / released_gradients(steps)[0], rel=1e-3)


def test_published_weight_decay_of_the_location_branch() -> None:
    decay = read_config(CONFIGS / "location-tactile-snn-published.yaml")["weight_decay"]
    mean_gradient = released_gradients(LOCATIONS).mean()
    assert decay == pytest.approx(RELEASED_DECAY / mean_gradient, rel=2e-3)


@pytest.mark.parametrize(
    ("config", "outputs"),
    [
        ("location-tactile-snn", 78),
        ("tactile-snn", 250),
        ("objects-hybrid", 328),
        ("objects-hybrid-half", 328),
        ("containers-hybrid", 403),
        ("containers-hybrid-half", 403),
        ("slip-hybrid", 228),
        ("slip-hybrid-half", 228),
    ],
)
def test_published_targets_are_counts_that_the_outputs_can_reach(config: str, outputs: int) -> None:
    values = read_config(CONFIGS / f"{config}-published.yaml")
    assert values["target_wrong"] < values["target_right"] <= outputs
