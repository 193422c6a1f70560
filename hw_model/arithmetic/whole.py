"""Integers that come from outside: whole numbers that float64 and int64 both hold, or an error."""

import numpy as np

from hw_model.errors import InputError
from hw_model.values import AnyArray, ArrayLike

LARGEST = 1 << 53
"""Magnitudes up to this are the same number in float64 and in int64."""


def whole_numbers(given: ArrayLike) -> AnyArray:
    """Return numbers as an int64 array of their shape; a fraction, nan or a number too large is an ``InputError``.

    Numpy would cut 0.5 to 0, and take 2^64 - 2 for -2.
    """
    array = np.asarray(given)
    if array.dtype.kind in "biuf":
        fits = (array >= -LARGEST) & (array <= LARGEST)
        bad = array[~(fits & (array == np.round(array)))]
        if not bad.size:
            return array.astype(np.int64)
        what = "a number is not whole, or larger than any register"
        raise InputError(
            "integers of the chip",
            what,
            measured=f"{bad.flat[0]}",
            fix="Round it onto the chip's grid.",
        )
    raise InputError(
        "integers of the chip",
        "they are not numbers",
        measured=str(array.dtype),
        fix="Give integers.",
    )
