"""Torch's files of tensors and plain values: read without torch and without running anything, written with torch.

There are two formats. Since torch 1.6, a file is a zip archive with a pickle and one entry of bytes per storage. Before
that, it was five pickles (a magic number, a version, a description of the machine, the value, the keys of the
storages), followed by the storages, each preceded by its number of values. Torch is installed only for training:
compiling needs it for nothing here.
"""

import io
import struct
import sys
from collections.abc import Callable
from typing import Any, Literal

import numpy as np

from hw_model.io.extras import needed
from hw_model.io.files import parsing
from hw_model.io.zip_directory import BoundedZip
from locsnn_compile.data.plain_pickle import Budget, RefusedError, read_pickle
from locsnn_compile.data.tensors import Storage, Tensor, named, rebuilt, width_of
from locsnn_compile.errors import InputError

_ARCHIVE = b"PK\x03\x04"
"""The first bytes of a zip archive."""
_PICKLE = b"\x80"
"""The first byte of a pickle of protocol 2 or later."""
_PROTOCOL = 1001
"""The version of the old format, its second pickle."""
_MAGIC = b"\x8a\nl\xfc\x9cF\xf9 j\xa8P\x19."
"""The magic number of the old format as it is pickled, behind the two bytes of the pickle's protocol."""


def load_plain(data: bytes, where: str, *, fix: str) -> object:
    """Return what the bytes of a torch file hold; ``InputError`` if they hold code or are damaged.

    Tensors become :class:`~locsnn_compile.data.tensors.Tensor`. Dtypes, devices and layouts become
    :class:`~locsnn_compile.data.tensors.Name`. An OrderedDict or Counter becomes a dict, a Size a tuple, a Parameter
    its tensor. A pickle that would call a function is refused. ``fix`` is the way out for a damaged file.
    """
    budget = Budget(where)
    with parsing(where, "it is damaged, truncated or not a torch file", fix=fix):
        try:
            if data.startswith(_ARCHIVE):
                return _from_archive(data, where, fix, budget)
            # A tar archive has its mark at byte 257.
            if data[257:262] == b"ustar":
                what = "it is a tar archive, as torch wrote them before 0.1.10"
                raise InputError(where, what, fix="Load it with an old torch, and save it again.")
            return _from_stream(data, budget)
        except RefusedError as error:
            what = "it contains objects that would run code when read, so it was not read"
            raise InputError(
                where, what, measured=str(error), fix="Save tensors and plain values only."
            ) from None


def _storage(
    persistent_id: Any,
    storages: dict[str, Storage],
    read_storage: Callable[[str, int, int], Storage],
) -> Tensor:
    """Return a storage, which the pickle names by a persistent id, as a flat tensor of all of its values.

    ``storages`` keeps the storages read so far by their keys. ``read_storage`` returns one, given its key, its number
    of values, and the bytes of each value.
    """
    if type(persistent_id) is not tuple or persistent_id[0] != "storage":
        raise RefusedError("a module")
    # ("storage", type, key, device, number of values, and in old files a view)
    _, dtype, key, _, count, *views = persistent_id[:6]
    if type(key) is not str or type(count) is not int:
        raise ValueError("no storage")
    if key not in storages:
        storages[key] = read_storage(key, count, width_of(dtype.text))
    all_values = Tensor(dtype.text, (), storage=storages[key])
    # Before torch 1.0, a storage could be a part of another.
    _, offset, size = views[0] if views and views[0] is not None else (key, 0, count)
    return rebuilt(all_values, offset, (size,), (1,))


def _from_archive(data: bytes, where: str, fix: str, budget: Budget) -> object:
    """Return the value of a file of the format since torch 1.6."""
    archive = BoundedZip(io.BytesIO(data), where, fix)
    names = archive.namelist()
    # Torch stores its entries without compression, so its files unpack to about their own size. More
    # is a zip bomb.
    if archive.unpacked_bytes > 2 * len(data):
        measured = f"{archive.unpacked_bytes} bytes from {len(data)}"
        raise InputError(where, "it unpacks to far more than its size", measured=measured, fix=fix)
    inside = names[0].split("/")[0]  # all entries lie in one folder
    if f"{inside}/constants.pkl" in names:
        raise InputError(
            where, "it is a TorchScript archive", fix="Save the state_dict() with torch.save."
        )

    def read(name: str) -> bytes:
        return archive.content(f"{inside}/{name}")

    order: Literal["<", ">"] = (
        ">" if f"{inside}/byteorder" in names and read("byteorder") == b"big" else "<"
    )

    def read_storage(key: str, count: int, width: int) -> Storage:
        content = read(f"data/{key}")
        return Storage(len(content), count, content, order)

    storages: dict[str, Storage] = {}

    def stored(persistent_id: object) -> Tensor:
        return _storage(persistent_id, storages, read_storage)

    return read_pickle(io.BytesIO(read("data.pkl")), named, stored, budget)


def _from_stream(data: bytes, budget: Budget) -> object:
    """Return the value of a file of the old format."""
    if data[2 : 2 + len(_MAGIC)] != _MAGIC:
        if data.startswith(_PICKLE):
            what = "it is a pickle that torch.save did not write, and nothing in it was run"
            raise InputError(budget.where, what, fix="Save tensors with torch.save.")
        raise ValueError("another magic number")
    stream = io.BytesIO(data)
    stream.seek(2 + len(_MAGIC))
    storages: dict[str, Storage] = {}

    def stored(persistent_id: object) -> Tensor:
        return _storage(
            persistent_id, storages, lambda key, count, width: Storage(count * width, count)
        )

    version, _, value, keys = (read_pickle(stream, named, stored, budget) for _ in range(4))
    if version != _PROTOCOL or not isinstance(keys, list) or set(keys) != set(storages):
        raise ValueError("another version, or storages that are missing")
    # Behind the pickles, the storages follow in the order of their keys: the number of values in 8
    # bytes, then the values. A memoryview, so that slices do not copy.
    remaining = memoryview(data)[stream.tell() :]
    for key in keys:
        storage = storages[key]
        storage.data = remaining[8 : 8 + storage.size]
        if (
            struct.unpack_from("<q", remaining) != (storage.count,)
            or len(storage.data) < storage.size
        ):
            raise ValueError("a storage that is cut short")
        remaining = remaining[8 + storage.size :]
    return value


def torch_bytes(values: dict[str, Any], where: str) -> bytes:
    """Return the bytes of a torch file of a dict of plain values, dicts and arrays.

    Arrays of text become lists, others tensors. Raises ``InputError`` if torch is missing.
    """
    torch = needed(package="torch", extra="train", where=where)
    content = io.BytesIO()
    torch.save(_with_tensors(values), content)
    return content.getvalue()


def _with_tensors(value: Any) -> Any:
    """Return a value with tensors in place of arrays, at any depth."""
    import torch

    if isinstance(value, dict):
        return {_with_tensors(key): _with_tensors(entry) for key, entry in value.items()}
    if isinstance(value, str):
        return sys.intern(value)  # equal texts are written once: equal values give equal bytes
    if isinstance(value, np.ndarray):
        return value.tolist() if value.dtype.kind == "U" else torch.tensor(value)
    return value
