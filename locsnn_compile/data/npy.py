"""Read ``.npy`` bytes with the declared shape and type checked before anything is allocated."""

from __future__ import annotations

import io
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from locsnn_compile.data.axes import check_axes
from locsnn_compile.data.recordings import MAX_ELEMENTS
from locsnn_compile.errors import InputError, check_most


def load_npy(data: bytes, where: str) -> NDArray[Any]:
    """Return the array in the bytes of a ``.npy`` file, of numbers or structured, never unpickling anything.

    Raises ``InputError`` for bytes that are no such file, values that are no numbers, a declared shape that
    is too large, and bytes that end before the array does.
    """
    fix = "Write it again with numpy.save."
    stream = io.BytesIO(data)
    try:
        version = np.lib.format.read_magic(stream)
        read_header = {
            (1, 0): np.lib.format.read_array_header_1_0,
            (2, 0): np.lib.format.read_array_header_2_0,
        }[version]
        shape, _, dtype = read_header(stream)
    # A hostile header meets numpy's parser in many ways; each means the same to the user.
    except Exception:
        raise InputError(where, "it is damaged or not a numpy file", fix=fix) from None
    if dtype.kind not in "biuf" and (dtype.names is None or dtype.hasobject):
        raise InputError(where, "its values are no numbers", measured=f"dtype {dtype}", fix=fix)
    if any(size < 0 for size in shape) or math.prod(shape) * max(1, dtype.itemsize // 8) > MAX_ELEMENTS:
        raise InputError(
            where,
            "its declared shape is too large",
            measured=f"{'x'.join(str(size) for size in shape)} against {MAX_ELEMENTS} values",
            fix="Give fewer recordings.",
        )
    held, needed = len(data) - stream.tell(), math.prod(shape) * dtype.itemsize
    if held < needed:
        raise InputError(where, "it is truncated", measured=f"{held} of {needed} bytes", fix=fix)
    array: NDArray[Any] = np.load(io.BytesIO(data), allow_pickle=False)
    return array


def is_one(shape: tuple[int, ...]) -> bool:
    """Whether an array of this shape is one recording: see :func:`to_step_major`."""
    fingertips = len(shape) == 3 and shape[1] == 2 and shape[0] > 0 and shape[0] % 39 == 0
    return len(shape) == 2 or fingertips


def to_step_major(array: NDArray[Any], where: str, channels: int | None = None) -> NDArray[Any]:
    """Return (samples, steps, channels) of an array in one of the orders that files have.

    (samples, taxels, polarities, steps), (samples, channels, steps), and of one recording (channels, steps)
    and (taxels, polarities, steps). Three axes are one recording where the middle one has the two polarities
    and the first the taxels of whole fingertips (39 each). Channel = polarities * taxel + polarity. Raises
    ``InputError`` for other orders where sizes tell them: see :func:`locsnn_compile.data.axes.check_axes`.
    """
    # A tensor may claim any size over a few stored values; reshaping would make it true.
    check_most(array.size, MAX_ELEMENTS, where, "it is too large", unit="values", fix="Give fewer recordings.")
    check_axes(array, where, channels)
    if is_one(array.shape):
        array = array[np.newaxis]
    if array.ndim == 4:
        samples, taxels, polarities, steps = array.shape
        array = array.reshape(samples, taxels * polarities, steps)
    if array.ndim != 3:
        raise InputError(
            where,
            "its shape is not one of recordings",
            measured=f"{array.ndim} axes against 2 to 4",
            fix="Give (samples, channels, steps) or (samples, taxels, polarities, steps).",
        )
    return array.transpose(0, 2, 1)
