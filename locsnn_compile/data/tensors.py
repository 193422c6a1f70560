"""Tensors of torch's files as numpy arrays, and the names that such a file may use.

Files of networks and recordings are read without torch (see :mod:`.torch_file`). The pickle in such a file calls
functions of torch by name, such as ``torch._utils._rebuild_tensor_v2``; :func:`named` maps every name that is allowed
to a harmless stand-in, and refuses all others.

Before an array is made, its tensor is checked to lie within its storage. Of tensors that numpy cannot hold, only dtype
and shape are kept: quantised, sparse, nested and meta tensors, and dtypes such as ``torch.float8_e5m2``.
"""

import math
import re
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

from hw_model.values import AnyArray, Frozen, sealed
from locsnn_compile.data.plain_pickle import RefusedError, filled

MAX_DIMENSIONS = 32
"""Most dimensions of an array in numpy 1; numpy 2 has 64."""
MAX_VALUES = 1 << 59
"""Most values of an array of which every version of numpy makes views."""
FLOATS = ("torch.float16", "torch.bfloat16", "torch.float32", "torch.float64")
_NAMED_AS_IN_NUMPY = (
    "bool uint8 uint16 uint32 uint64 int8 int16 int32 int64 "
    "float16 float32 float64 complex64 complex128"
)
_KINDS = {f"torch.{name}": np.dtype(name) for name in _NAMED_AS_IN_NUMPY.split()}
_KINDS["torch.bfloat16"] = np.dtype("uint16")  # numpy lacks it: it is the upper half of a float32
"""The numpy type of the stored values of a dtype."""
_STORAGES = {
    "Double": "float64",
    "Float": "float32",
    "Half": "float16",
    "BFloat16": "bfloat16",
    "Bool": "bool",
    "Long": "int64",
    "Int": "int32",
    "Short": "int16",
    "Char": "int8",
    "Byte": "uint8",
    "Untyped": "uint8",
    "ComplexDouble": "complex128",
    "ComplexFloat": "complex64",
    "QInt8": "qint8",
    "QInt32": "qint32",
    "QUInt8": "quint8",
    "QUInt4x2": "quint4x2",
    "QUInt2x4": "quint2x4",
}
"""What the class of a storage says of its values: ``torch.FloatStorage`` holds float32. Q is for quantised."""
_STORAGE = re.compile(r"torch\.(?:cuda\.|storage\.)?(\w+)Storage")
_VALUE = re.compile(r"torch\.(Tensor|(q?u?int|b?float|bool|bits|complex|per_)\w*)")
"""Names that are read as plain words: dtypes, and the schemes of quantised tensors (``per_channel_affine``)."""


class Name(Frozen):
    """A dtype, a device or a layout as a value: ``torch.float32``, ``cuda:0``."""

    text: str


def width_of(dtype: str) -> int:
    """Return how many bytes a value of a dtype takes in a storage."""
    if dtype == "torch.qint32":
        return 4
    if dtype in _KINDS:
        return _KINDS[dtype].itemsize
    return 1  # all other quantised ones


@dataclass(eq=False)
class Storage:
    """The bytes that tensors share.

    - ``size``: in bytes; ``count``: of values
    - ``data``: the bytes; None until they are read, which in the old format is after all tensors
    - ``order``: the byte order, as numpy writes it
    """

    size: int
    count: int
    data: bytes | memoryview | None = field(default=None, repr=False)
    order: Literal["<", ">"] = "<"
    _read: dict[object, AnyArray] = field(default_factory=dict, repr=False)
    """What :meth:`values` returned, by its arguments."""

    def values(self, dtype: str, bits: tuple[str, ...]) -> AnyArray:
        """Return all values as one dtype; the result is kept for further calls.

        ``bits`` are torch's lazy flags of a tensor: ``conj`` if its values are to be conjugated, ``neg`` if negated.
        """
        if (dtype, bits) in self._read:
            return self._read[dtype, bits]
        kind = _KINDS[dtype]
        count = self.size // kind.itemsize
        values = np.ndarray((count,), kind.newbyteorder(self.order), self.data)
        values = values.astype(kind, copy=False)
        if dtype == "torch.bfloat16":
            values = (values.astype(np.uint32) << 16).view(np.float32)
        elif dtype == "torch.bool":
            # A byte of a damaged file may be neither 0 nor 1, which a bool of numpy must be.
            values = values.view(np.uint8) != 0
        if "conj" in bits:
            values = np.conjugate(values)
        if "neg" in bits:
            values = np.negative(values)
        self._read[dtype, bits] = sealed(values)
        return self._read[dtype, bits]


class Tensor(Frozen, eq=False):
    """A tensor as the file describes it; a tensor that was saved from a GPU is on the CPU here.

    ``start`` is its first byte in the storage; ``strides`` count values; for ``bits`` see :meth:`Storage.values`.
    """

    dtype: str
    shape: tuple[int, ...]
    layout: str = "torch.strided"
    device: str = "cpu"
    storage: Storage | None = None
    start: int = 0
    strides: tuple[int, ...] = ()
    bits: tuple[str, ...] = ()

    @property
    def dense(self) -> bool:
        """Whether every value is stored in a place of its own, in memory of the CPU."""
        return self.layout == "torch.strided" and self.device == "cpu"

    def array(self) -> AnyArray | None:
        """Return the values as a read-only view of the storage; None if numpy cannot hold them.

        bfloat16 is widened to float32, which is exact.
        """
        if self.storage is None or self.dtype not in _KINDS:
            return None
        values = self.storage.values(self.dtype, self.bits)
        if 0 in self.shape:
            return values[:0].reshape(self.shape)
        # As read, values may be wider than as stored: bfloat16 is. So bytes are counted anew.
        first_value = self.start // width_of(self.dtype)
        width = values.itemsize
        return np.ndarray(
            self.shape,
            values.dtype,
            buffer=values,
            offset=first_value * width,
            strides=[step * width for step in self.strides],
        )


def rebuilt(whole: Tensor, offset: int, size: Any, strides: Any, *dtype_and_flags: Any) -> Tensor:
    """Return a tensor of a shape and strides inside a storage; stands for torch's ``_rebuild_tensor`` functions.

    ``whole`` is the storage as a tensor, and ``offset`` the number of values before the first one. ``dtype_and_flags``
    may hold a dtype, if it is not that of the storage, and a dict of flags (see ``bits``). Raises ``ValueError`` if the
    tensor does not lie within the storage.
    """
    if whole.storage is None or type(offset) is not int or offset < 0 or len(size) != len(strides):
        raise ValueError("no part of a storage")
    (dtype,) = [part.text for part in dtype_and_flags if isinstance(part, Name)] or [whole.dtype]
    shape = _sizes(size)
    strides = _sizes(strides)
    if dtype not in _KINDS:
        return Tensor(dtype, shape)
    # The stride of an axis with one entry is never taken, and may be anything in a file.
    steps = tuple(step if n > 1 else 0 for n, step in zip(shape, strides, strict=True))
    width = width_of(dtype)
    start = whole.start + offset * width
    last_value = sum((n - 1) * step for n, step in zip(shape, steps, strict=True))
    is_empty = 0 in shape
    if is_empty:
        # An empty slice may begin anywhere, even behind the end.
        start = 0
        last_value = -1
    is_beyond = start + (last_value + 1) * width > whole.storage.size
    if is_beyond or start % width or math.prod(shape) > MAX_VALUES:
        raise ValueError("a tensor that is not within its storage")
    flags = dtype_and_flags[-1] if dtype_and_flags and isinstance(dtype_and_flags[-1], dict) else {}
    bits = tuple(bit for bit in ("conj", "neg") if flags.get(bit))
    return Tensor(dtype, shape, storage=whole.storage, start=start, strides=steps, bits=bits)


def _sizes(numbers: Any) -> tuple[int, ...]:
    """Return the entries of a shape or of strides as a tuple; ``ValueError`` for any that no array can have."""
    if len(numbers) > MAX_DIMENSIONS or not all(_is_size(n) for n in numbers):
        raise ValueError("no sizes")
    return tuple(numbers)


def _is_size(n: object) -> bool:
    return type(n) is int and 0 <= n < MAX_VALUES


def named(name: str) -> object:
    """Return what a name in a file stands for: a value, or a function that makes one from plain values.

    Raises ``RefusedError`` for all other names.
    """
    storage = _STORAGE.fullmatch(name)
    if storage and storage[1] in _STORAGES:
        return Name(f"torch.{_STORAGES[storage[1]]}")
    if name in _FUNCTIONS:
        return _FUNCTIONS[name]
    if _VALUE.fullmatch(name):
        return Name(name)
    raise RefusedError(name)


def _sparse(layout: Name, parts: Any) -> Tensor:
    """Return a sparse tensor by its values and size, which come after one list of indices, or after two."""
    values, size = parts[1:3] if layout.text == "torch.sparse_coo" else parts[2:4]
    return Tensor(values.dtype, _sizes(size), layout.text)


def _word(text: str, *index: int) -> Name:
    """Return a device or layout by its name; a device may have an index, as in ``cuda:0``."""
    return Name(":".join((text, *map("{:d}".format, index))))


def _dict(entries: Any = ()) -> dict[Any, Any]:
    """Return a dict of another dict's entries, or of pairs."""
    return filled(entries.items() if isinstance(entries, dict) else entries, {})


# Each function raises an exception for arguments of other kinds, which readers report as damage.
_FUNCTIONS: dict[str, Callable[..., object]] = {
    "collections.OrderedDict": _dict,
    "collections.Counter": _dict,
    "builtins.set": lambda items: set(filled(((item, None) for item in items), {})),
    "builtins.complex": lambda real, imaginary: complex(float(real), float(imaginary)),
    "builtins.bytearray": lambda held=b"": bytearray(memoryview(held)),
    "_codecs.encode": lambda text, coding: text.encode({"latin1": "latin-1"}[coding]),
    "torch.Size": tuple,
    "torch.device": _word,
    "torch.serialization._get_layout": _word,
    "torch.nn.parameter.Parameter": lambda data, *_: data,
    # Torch wraps a tensor with attributes in this call: (the function that makes it, its class, the
    # arguments, the attributes). The attributes are ignored. The dict refuses, by a KeyError, every
    # function but the one for tensors.
    "torch._tensor._rebuild_from_type_v2": lambda made, _, arguments, __: {rebuilt: rebuilt}[made](
        *arguments
    ),
    **{
        f"torch._utils._rebuild_parameter{end}": lambda data, *_: data
        for end in ("", "_with_state")
    },
    **{f"torch._utils._rebuild_tensor{end}": rebuilt for end in ("", "_v2", "_v3")},
    "torch._utils._rebuild_qtensor": lambda whole, offset, size, *_: Tensor(
        whole.dtype, _sizes(size)
    ),
    "torch._utils._rebuild_sparse_tensor": _sparse,
    "torch._utils._rebuild_meta_tensor_no_storage": lambda kind, *of: Tensor(
        kind.text, _sizes(of[0]), device="meta"
    ),
    "torch._utils._rebuild_nested_tensor": lambda values, *_: Tensor(
        values.dtype, (), "torch.nested"
    ),
}
