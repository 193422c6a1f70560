"""Kernels that end after so many steps, by the sum that they are."""

import numpy as np
import pytest

from locsnn_compile.reference.float_neurons import KernelCut

STEPS = 40
DECAY = 0.8
"""A kernel is k a^(k-1) at lag k, with this a."""


def response(x: np.ndarray, taps: int = STEPS) -> np.ndarray:
    """What ``x`` (steps,) gives through a kernel that ends after so many values; without ``taps``, through all of it."""
    lag = np.arange(STEPS)
    kernel = np.where(lag < taps, lag * DECAY ** (lag - 1.0), 0)
    return np.convolve(x, kernel)[:STEPS]


@pytest.mark.parametrize("taps", [1, 2, 7, STEPS - 1, STEPS, STEPS + 1])
@pytest.mark.parametrize("first", [1.0, 0.0], ids=["from the first step on", "later"])
def test_a_kernel_is_the_full_one_up_to_its_end(taps, first):
    x = np.random.default_rng(taps).integers(0, 2, STEPS).astype(float)
    x[0] = first
    cut = KernelCut(taps, DECAY)
    given = np.array([cut.step(np.array([[value]]))[0, 0] for value in x])
    assert np.allclose(response(given), response(x, taps), rtol=0, atol=1e-12)
    if taps < STEPS - 1:
        assert not np.allclose(response(x), response(x, taps))
