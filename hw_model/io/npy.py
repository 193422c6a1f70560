"""Untrusted ``.npy`` files: what the header claims is checked before the array is made."""

import io
import math
from typing import Any

import numpy as np

from hw_model.errors import InputError
from hw_model.io.files import parsing
from hw_model.values import AnyArray

HEADER_BYTES = 1 << 14
"""More than the longest header that numpy reads, of 10,000 bytes and a few."""
MAX_VALUES = 200_000_000
"""Most values of an array, of 8 bytes each."""


_REWRITE = "Write it again with numpy.save."
NUMBERS = "biuf"


def holds_numbers(data: bytes, where: str) -> bool:
    """Tell whether a ``.npy`` file holds numbers, or rows of fields, by its header."""
    _, _, dtype = _header(io.BytesIO(data), where)
    return dtype.kind in NUMBERS or (dtype.names is not None and not dtype.hasobject)


def _header(stream: io.BytesIO, where: str) -> tuple[tuple[int, ...], bool, np.dtype[Any]]:
    """Return shape, whether columns come first, and dtype; the stream is then at the values."""
    with parsing(where, "it is damaged or not a numpy file", fix=_REWRITE):
        version = np.lib.format.read_magic(stream)
        shape, fortran, dtype = getattr(np.lib.format, "read_array_header_{}_{}".format(*version))(
            stream
        )
        # numpy takes True for a size here, and for none below.
        return tuple(map(int, shape)), fortran, dtype


def load_npy(data: bytes, where: str, kinds: str = NUMBERS) -> AnyArray:
    """Return the array in the bytes of a ``.npy`` file, read-only, without copying or unpickling anything.

    ``kinds``: the kinds of dtype that are accepted, next to structured ones. Raises ``InputError`` for bytes that are
    not such a file, for values of another kind, for a shape that is too large, and for bytes that end too early.
    """
    stream = io.BytesIO(data)
    shape, fortran, dtype = check_header(stream, where, kinds)
    bytes_left = len(data) - stream.tell()
    needed = math.prod(shape) * dtype.itemsize
    if bytes_left < needed:
        raise InputError(
            where, "it is truncated", measured=f"{bytes_left} of {needed} bytes", fix=_REWRITE
        )
    return np.ndarray(shape, dtype, data, stream.tell(), order="F" if fortran else "C")


def check_header(
    stream: io.BytesIO, where: str, kinds: str = NUMBERS
) -> tuple[tuple[int, ...], bool, np.dtype[Any]]:
    """Return shape, whether columns come first, and dtype, if such an array is read; ``InputError`` if not.

    The first :data:`HEADER_BYTES` of a file are enough. The stream is then at the values.
    """
    shape, fortran, dtype = _header(stream, where)
    if dtype.kind not in kinds and (dtype.names is None or dtype.hasobject):
        raise InputError(
            where, "its values are not numbers", measured=f"dtype {dtype}", fix=_REWRITE
        )
    if (
        any(size < 0 for size in shape)
        or math.prod(shape) * max(1, dtype.itemsize // 8) > MAX_VALUES
    ):
        measured = f"{'x'.join(map(str, shape))} against {MAX_VALUES} values"
        raise InputError(
            where, "its declared shape is too large", measured=measured, fix="Give a smaller array."
        )
    return shape, fortran, dtype
