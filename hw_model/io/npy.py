"""Read untrusted ``.npy`` files: the header's claims are checked before an array is made.

A header of a few bytes can claim an array of terabytes, or values that numpy would unpickle, which runs code.
"""

import io
import math
from typing import Any

import numpy as np

from hw_model.errors import InputError
from hw_model.io.files import parsing
from hw_model.values import AnyArray

HEADER_BYTES = 1 << 14
"""More than the longest header that numpy reads, which is a little over 10,000 bytes."""
MAX_VALUES = 200_000_000
"""The most values of an array, counted as 8 bytes each. Chosen by hand."""


_REWRITE = "Write it again with numpy.save."
NUMBERS = "biuf"
"""The kinds of dtype that are numbers: booleans, signed and unsigned integers, floats."""


def holds_numbers(data: bytes, where: str) -> bool:
    """Return whether a ``.npy`` file holds numbers, or rows of fields (a structured dtype), by its header."""
    _, _, dtype = _header(io.BytesIO(data), where)
    return dtype.kind in NUMBERS or (dtype.names is not None and not dtype.hasobject)


def _header(stream: io.BytesIO, where: str) -> tuple[tuple[int, ...], bool, np.dtype[Any]]:
    """Return the shape, whether the order is Fortran's, and the dtype; the stream is then at the values."""
    with parsing(where, "it is damaged or not a numpy file", fix=_REWRITE):
        major, minor = np.lib.format.read_magic(stream)
        # numpy has a public function per version of the format; an unknown version is an AttributeError.
        read_header = getattr(np.lib.format, f"read_array_header_{major}_{minor}")
        shape, is_fortran, dtype = read_header(stream)
        # A header may give True as a size, which numpy accepts here but not when the array is made.
        return tuple(map(int, shape)), is_fortran, dtype


def load_npy(data: bytes, where: str, kinds: str = NUMBERS) -> AnyArray:
    """Return the array in the bytes of a ``.npy`` file, read-only, without copying or unpickling anything.

    ``kinds``: the kinds of dtype that are accepted, in addition to structured ones. Raises ``InputError`` for bytes
    that are not such a file, for values of another kind, for a shape that is too large, and for bytes that end too
    early.
    """
    stream = io.BytesIO(data)
    shape, is_fortran, dtype = check_header(stream, where, kinds)
    available_bytes = len(data) - stream.tell()
    needed_bytes = math.prod(shape) * dtype.itemsize
    if available_bytes < needed_bytes:
        measured = f"{available_bytes} of {needed_bytes} bytes"
        raise InputError(where, "it is truncated", measured=measured, fix=_REWRITE)
    # A view of `data`: read-only, since bytes are immutable.
    return np.ndarray(shape, dtype, data, stream.tell(), order="F" if is_fortran else "C")


def check_header(
    stream: io.BytesIO, where: str, kinds: str = NUMBERS
) -> tuple[tuple[int, ...], bool, np.dtype[Any]]:
    """Return the shape, whether the order is Fortran's, and the dtype.

    Raises ``InputError`` for an array that :func:`load_npy` would refuse by its header. The stream needs only the first
    :data:`HEADER_BYTES` of a file. Afterwards it is at the values.
    """
    shape, is_fortran, dtype = _header(stream, where)
    # `hasobject`: fields that are Python objects would have to be unpickled.
    if dtype.kind not in kinds and (dtype.names is None or dtype.hasobject):
        raise InputError(
            where, "its values are not numbers", measured=f"dtype {dtype}", fix=_REWRITE
        )
    words_per_value = max(1, dtype.itemsize // 8)
    if any(size < 0 for size in shape) or math.prod(shape) * words_per_value > MAX_VALUES:
        measured = f"{'x'.join(map(str, shape))} against {MAX_VALUES} values"
        raise InputError(
            where, "its declared shape is too large", measured=measured, fix="Give a smaller array."
        )
    return shape, is_fortran, dtype
