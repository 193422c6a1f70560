"""Tensors of torch's files as numpy arrays, and the names that such a file may use.

Every tensor is looked at before any is made: it must lie within its storage. What numpy cannot hold keeps its name
and shape: quantised, sparse, nested and meta tensors, and dtypes such as ``torch.float8_e5m2``.
"""

import math
import re
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

from hw_model.values import AnyArray, Frozen, sealed
from locsnn_compile.data.plain_pickle import RefusedError, filled

MAX_DIMENSIONS, MAX_VALUES = 32, 1 << 59
"""Dimensions and values of which every version of numpy makes views."""
FLOATS = ("torch.float16", "torch.bfloat16", "torch.float32", "torch.float64")
_HELD = "bool uint8 uint16 uint32 uint64 int8 int16 int32 int64 float16 float32 float64 bfloat16 complex64 complex128"
_KINDS = {
    f"torch.{name}": np.dtype("uint16" if name == "bfloat16" else name) for name in _HELD.split()
}
"""The numpy type of the stored values of a dtype."""
_CLASSES = (
    "Double Float Half BFloat16 Bool Long Int Short Char Byte Untyped ComplexDouble ComplexFloat"
)
_DTYPES = (
    "float64 float32 float16 bfloat16 bool int64 int32 int16 int8 uint8 uint8 complex128 complex64"
)
_QUANTISED = "QInt8 QInt32 QUInt8 QUInt4x2 QUInt2x4"
_STORAGES = dict(
    zip(f"{_CLASSES} {_QUANTISED}".split(), f"{_DTYPES} {_QUANTISED.lower()}".split(), strict=True)
)
"""What the class of a storage says of its values: ``torch.FloatStorage`` holds float32."""
_STORAGE = re.compile(r"torch\.(?:cuda\.|storage\.)?(\w+)Storage")
_VALUE = re.compile(r"torch\.(Tensor|(q?u?int|b?float|bool|bits|complex|per_)\w*)")


class Name(Frozen):
    """A dtype, a device or a layout as a value: ``torch.float32``, ``cuda:0``."""

    text: str


def width_of(dtype: str) -> int:
    """Return the bytes of a value as it is stored."""
    return 4 if dtype == "torch.qint32" else _KINDS[dtype].itemsize if dtype in _KINDS else 1


@dataclass(eq=False)
class Storage:
    """The bytes that tensors share. ``data`` is set once they are found; ``order`` is their byte order, as in numpy."""

    size: int
    count: int
    data: bytes | memoryview | None = field(default=None, repr=False)
    order: Literal["<", ">"] = "<"
    _made: dict[object, AnyArray] = field(default_factory=dict, repr=False)

    def values(self, dtype: str, bits: tuple[str, ...]) -> AnyArray:
        """Return all values as one dtype, read once. ``bits`` has conj if they are conjugated, neg if negated."""
        if (dtype, bits) not in self._made:
            kind = _KINDS[dtype]
            found = np.ndarray(
                (self.size // kind.itemsize,), kind.newbyteorder(self.order), self.data
            )
            found = found.astype(kind, copy=False)
            if dtype == "torch.bfloat16":
                found = (found.astype(np.uint32) << 16).view(np.float32)
            elif dtype == "torch.bool":
                found = found.view(np.uint8) != 0
            found = np.conjugate(found) if "conj" in bits else found
            self._made[dtype, bits] = sealed(np.negative(found) if "neg" in bits else found)
        return self._made[dtype, bits]


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
        """Tell whether every value is stored in its own place."""
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
        width, first = values.itemsize, self.start // width_of(self.dtype)
        return np.ndarray(
            self.shape, values.dtype, values, first * width, [step * width for step in self.strides]
        )


def rebuilt(whole: Tensor, offset: int, size: Any, strides: Any, *more: Any) -> Tensor:
    """Return a tensor inside another's storage, ``offset`` values after its start; ``ValueError`` if it does not fit.

    ``more`` may hold its dtype, if it is not that of the storage, and a dict of its bits.
    """
    if whole.storage is None or type(offset) is not int or offset < 0 or len(size) != len(strides):
        raise ValueError("no part of a storage")
    (dtype,) = [part.text for part in more if isinstance(part, Name)] or [whole.dtype]
    size, strides, width = _sizes(size), _sizes(strides), width_of(dtype)
    if dtype not in _KINDS:
        return Tensor(dtype, size)
    steps = tuple(step if n > 1 else 0 for n, step in zip(size, strides, strict=True))
    # An empty slice may begin anywhere, even behind the end.
    start = whole.start + offset * width if 0 not in size else 0
    last = sum((n - 1) * step for n, step in zip(size, steps, strict=True)) if 0 not in size else -1
    if (
        start + (last + 1) * width > whole.storage.size
        or start % width
        or math.prod(size) > MAX_VALUES
    ):
        raise ValueError("a tensor that is not within its storage")
    bits = more[-1] if more and isinstance(more[-1], dict) else {}
    held = tuple(bit for bit in ("conj", "neg") if bits.get(bit))
    return Tensor(dtype, size, storage=whole.storage, start=start, strides=steps, bits=held)


def _sizes(held: Any) -> tuple[int, ...]:
    if len(held) > MAX_DIMENSIONS or any(
        type(n) is not int or not 0 <= n < MAX_VALUES for n in held
    ):
        raise ValueError("no sizes")
    return tuple(held)


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
    return Name(":".join((text, *map("{:d}".format, index))))


def _dict(held: Any = ()) -> dict[Any, Any]:
    return filled(held.items() if isinstance(held, dict) else held, {})


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
    # Attributes are ignored, and only tensors may have them.
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
