"""Write files of torch, by torch itself or by hand in torch's old format, and read them with the project's reader.

The reader (``locsnn_compile/data/torch_file.py``) needs no torch and runs no code of the file.
"""

import io
import pickle
import struct
from unittest import mock

import numpy as np
import pytest
import torch

from locsnn_compile.data.torch_file import load_plain
from locsnn_compile.errors import InputError


def saved(value, *, archive=True, device="cpu"):
    """Return the bytes that torch saves for a value; ``device`` is what the file names, such as ``cuda:0``.

    The value itself is on the CPU, so that no GPU is needed.
    """
    stream = io.BytesIO()
    with mock.patch("torch.serialization.location_tag", return_value=device):
        torch.save(value, stream, _use_new_zipfile_serialization=archive)
    return stream.getvalue()


def read(data):
    """Return the value of a file by the project's reader."""
    return load_plain(data, "file 'a.pt'", fix="Write it again.")


def refusal(data):
    """Return the message with which the project's reader refuses a file."""
    with pytest.raises(InputError) as error:
        read(data)
    return str(error.value)


PERSISTENT = "persistent"


class Pickler(pickle.Pickler):
    """Writes tuples that begin with :data:`PERSISTENT` as persistent ids, by which torch refers to storages (arrays)."""

    def persistent_id(self, value):
        is_persistent = isinstance(value, tuple) and value[:1] == (PERSISTENT,)
        return value[1:] if is_persistent else None


def old_file(value, storages=None, *, protocol=1001):
    """Return a file of torch's old format.

    It holds five pickles (a magic number, the protocol, the byte order, the value, the keys of the storages), then for
    each storage its length and its numbers. ``storages`` are pairs of (key, array).
    """
    magic_number = 0x1950A86A20F9469CFC6C
    storages = storages or []
    stream = io.BytesIO()
    for header in (magic_number, protocol, {"little_endian": True}):
        pickle.dump(header, stream, protocol=2)
    Pickler(stream, protocol=2).dump(value)
    pickle.dump([key for key, _ in storages], stream, protocol=2)
    for _, numbers in storages:
        stream.write(struct.pack("<q", len(numbers)) + numbers.tobytes())
    return stream.getvalue()


class Rebuilt:
    """An object that is pickled as a call of a function, such as torch's functions that rebuild tensors."""

    def __init__(self, function, *arguments):
        self.call = function, arguments

    def __reduce__(self):
        return self.call


NUMBERS = np.arange(5, dtype=np.float32)
"""The numbers of the storage of :func:`storage_id`."""


def storage_id(part=None):
    """Return the persistent id of a storage with key "7" and five numbers, or of a ``part`` (key, offset, length) of it."""
    return PERSISTENT, "storage", torch.FloatStorage, "7", "cuda:0", len(NUMBERS), part
