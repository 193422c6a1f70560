"""Check integers that users or files provide before they become int64: every one must be a whole number."""

import numpy as np

from hw_model.errors import InputError
from hw_model.values import AnyArray, ArrayLike

LARGEST = 1 << 53
"""2^53: integers up to this magnitude are exact in float64 as well."""
REAL_KINDS = "biuf"
"""numpy's codes for real numbers: bool, int, unsigned and float."""


def whole_numbers(numbers: ArrayLike) -> AnyArray:
    """Return numbers as an int64 array of the same shape.

    Raises ``InputError`` for a fraction, nan, or a magnitude above 2^53. numpy alone would turn 0.5
    into 0, and 2^64 - 2 into -2.
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
    is_whole = array == np.round(array)  # false for nan
    refused = array[~(is_in_range & is_whole)]
    if refused.size:
        raise InputError(
            "integers of the chip",
            "a number is not whole, or larger than any register",
            measured=f"{refused.flat[0]}",
            fix="Round it onto the chip's grid.",
        )
    return array.astype(np.int64)
