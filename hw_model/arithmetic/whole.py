"""Integers that come from outside: whole numbers that float64 and int64 both hold, or an error."""

import numpy as np

from hw_model.errors import InputError
from hw_model.values import AnyArray, ArrayLike

LARGEST = 1 << 53
"""Magnitudes up to this are the same number in float64 and in int64."""
REAL_KINDS = "biuf"
"""Kinds of numpy's types that are real numbers: bool, int, unsigned and float."""


def whole_numbers(numbers: ArrayLike) -> AnyArray:
    """Return numbers as an int64 array of their shape; a fraction, nan or a number too large is an ``InputError``.

    Numpy would cut 0.5 to 0, and take 2^64 - 2 for -2.
    """
    array = np.asarray(numbers)
    if array.dtype.kind not in REAL_KINDS:
        raise InputError(
            "integers of the chip",
            "they are not numbers",
            measured=str(array.dtype),
            fix="Give integers.",
        )
    is_in_range = (array >= -LARGEST) & (array <= LARGEST)
    is_whole = array == np.round(array)
    refused = array[~(is_in_range & is_whole)]
    if refused.size:
        raise InputError(
            "integers of the chip",
            "a number is not whole, or larger than any register",
            measured=f"{refused.flat[0]}",
            fix="Round it onto the chip's grid.",
        )
    return array.astype(np.int64)
