"""The arithmetic of a compartment in 32 bits, compiled into each loop that uses it.

The same integers as :mod:`hw_model.arithmetic.fixed_point`, for register values of at most 23 bits and sign. ``keep``
is 4096 less an effective decay, 0..4096.
"""

from __future__ import annotations

import numpy as np

from hw_model.engine.compiled import inlined


@inlined
def rz(x, keep):  # type: ignore[no-untyped-def]
    """Return sign(x) * ((|x| * keep) >> 12) for |x| < 2^24, in 32 bits: with |x| = 4096 a + b no product is wider."""
    magnitude = np.int32(-x if x < 0 else x)
    low = np.int32(np.int32(np.int32(magnitude & np.int32(4095)) * keep) >> np.int32(12))
    left = np.int32(np.int32(np.int32(magnitude >> np.int32(12)) * keep) + low)
    return np.int32(-left if x < 0 else left)


@inlined
def wrap24(x):  # type: ignore[no-untyped-def]
    """Return x wrapped to 23 bits plus sign."""
    return np.int32(np.int32(x << np.int32(8)) >> np.int32(8))
