"""``KernelCut`` makes a recursive alpha kernel end after a number of taps, as slayerPytorch's kernels do.

It changes the input so that the response of the whole kernel to it is that of the cut kernel to the original input.
"""

import numpy as np
import pytest

from locsnn_compile.reference.float_neurons import KernelCut

STEPS = 40
DECAY = 0.8
"""The kernel is k a^(k-1) at lag k, with this a."""


def response(x: np.ndarray, taps: int = STEPS) -> np.ndarray:
    """Return the response to ``x`` (steps,) of a kernel that ends after ``taps`` values, by default of the whole kernel."""
    lag = np.arange(STEPS)
    kernel = np.where(lag < taps, lag * DECAY ** (lag - 1.0), 0)
    return np.convolve(x, kernel)[:STEPS]


@pytest.mark.parametrize("taps", [1, 2, 7, STEPS - 1, STEPS, STEPS + 1])
@pytest.mark.parametrize("first", [1.0, 0.0], ids=["from the first step on", "later"])
def test_the_response_is_that_of_the_cut_kernel(taps, first):
    x = np.random.default_rng(taps).integers(0, 2, STEPS).astype(float)
    x[0] = first
    cut = KernelCut(taps, DECAY)
    changed_input = np.array([cut.step(np.array([[value]]))[0, 0] for value in x])
    assert np.allclose(response(changed_input), response(x, taps), rtol=0, atol=1e-12)
    if taps < STEPS - 1:
        # The cut matters.
        assert not np.allclose(response(x), response(x, taps))
