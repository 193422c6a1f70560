"""Kernels that end after so many steps, by the sum that they are."""

import numpy as np
import pytest

from locsnn_compile.reference.float_neurons import _Cut

STEPS = 40
DECAY = 0.8


def filtered(x: np.ndarray) -> np.ndarray:
    """The response of the full kernel k a^(k-1), by its sum."""
    lag = np.arange(len(x))
    kernel = lag * DECAY ** (lag - 1.0)
    return np.convolve(x, kernel)[: len(x)]


@pytest.mark.parametrize("taps", [1, 2, 7, STEPS - 1, STEPS, STEPS + 1])
@pytest.mark.parametrize("first", [1.0, 0.0], ids=["from the first step on", "later"])
def test_a_kernel_is_the_full_one_up_to_its_end(taps, first):
    x = np.random.default_rng(taps).integers(0, 2, STEPS).astype(float)
    x[0] = first
    cut = _Cut(taps, DECAY)
    given = np.array([cut.step(np.array([[value]]))[0, 0] for value in x])
    lag = np.arange(STEPS)
    kernel = np.where(lag < taps, lag * DECAY ** (lag - 1.0), 0)
    wanted = np.convolve(x, kernel)[:STEPS]
    assert np.allclose(filtered(given), wanted, rtol=0, atol=1e-12)
    if taps < STEPS - 1:
        assert not np.allclose(filtered(x), wanted)
