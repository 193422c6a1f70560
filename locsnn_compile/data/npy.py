"""Read ``.npy`` bytes with the declared shape and type checked before anything is allocated."""

import io
import math

import numpy as np

from hw_model.values import AnyArray
from locsnn_compile.data.recordings import MAX_ELEMENTS
from locsnn_compile.errors import InputError


def load_npy(data: bytes, where: str, kinds: str = "biuf") -> AnyArray:
    """Return the array in the bytes of a ``.npy`` file, of these kinds or structured, never unpickling anything.

    Raises ``InputError`` for bytes that are no such file, values that are no numbers, a declared shape that
    is too large, and bytes that end before the array does.
    """
    fix = "Write it again with numpy.save."
    stream = io.BytesIO(data)
    try:
        version = np.lib.format.read_magic(stream)
        read_header = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}[
            version
        ]
        shape, _, dtype = read_header(stream)
    # A hostile header meets numpy's parser in many ways; each means the same to the user.
    except Exception:
        raise InputError(where, "it is damaged or not a numpy file", fix=fix) from None
    if dtype.kind not in kinds and (dtype.names is None or dtype.hasobject):
        raise InputError(where, "its values are no numbers", measured=f"dtype {dtype}", fix=fix)
    if any(size < 0 for size in shape) or math.prod(shape) * max(1, dtype.itemsize // 8) > MAX_ELEMENTS:
        measured = f"{'x'.join(str(size) for size in shape)} against {MAX_ELEMENTS} values"
        raise InputError(where, "its declared shape is too large", measured=measured, fix="Give fewer recordings.")
    held, needed = len(data) - stream.tell(), math.prod(shape) * dtype.itemsize
    if held < needed:
        raise InputError(where, "it is truncated", measured=f"{held} of {needed} bytes", fix=fix)
    array: AnyArray = np.load(io.BytesIO(data), allow_pickle=False)
    return array
