"""Torch's files for tests: written by torch, or by hand as it once wrote them, and read without torch."""

import io
import pickle
import struct
from unittest import mock

import numpy as np
import pytest
import torch

from locsnn_compile.data.torch_file import load_plain
from locsnn_compile.errors import InputError


def saved(value, *, archive=True, place="cpu"):
    """Return the file of a value as torch writes it, from a GPU where ``place`` says that."""
    stream = io.BytesIO()
    with mock.patch("torch.serialization.location_tag", return_value=place):
        torch.save(value, stream, _use_new_zipfile_serialization=archive)
    return stream.getvalue()


def read(data):
    return load_plain(data, "file 'a.pt'", fix="Write it again.")


def refusal(data):
    with pytest.raises(InputError) as caught:
        read(data)
    return str(caught.value)


PERSISTENT = "persistent"


class Pickler(pickle.Pickler):
    """Writes tuples that begin with :data:`PERSISTENT` as persistent ids, which is how torch names storages."""

    def persistent_id(self, held):
        return held[1:] if isinstance(held, tuple) and held[:1] == (PERSISTENT,) else None


def old_file(value, keys=None, *, protocol=1001):
    """Return a file of the old format, whose storages are given by their persistent ids."""

    stream = io.BytesIO()
    for part in (0x1950A86A20F9469CFC6C, protocol, {"little_endian": True}):
        pickle.dump(part, stream, protocol=2)
    Pickler(stream, protocol=2).dump(value)
    pickle.dump([key for key, _ in keys or []], stream, protocol=2)
    for _, numbers in keys or []:
        stream.write(struct.pack("<q", len(numbers)) + numbers.tobytes())
    return stream.getvalue()


class Rebuilt:
    """Pickles as a call of one of torch's functions."""

    def __init__(self, function, *arguments):
        self.call = function, arguments

    def __reduce__(self):
        return self.call


NUMBERS = np.arange(5, dtype=np.float32)


def whole(*part):
    return PERSISTENT, "storage", torch.FloatStorage, "7", "cuda:0", 5, *(part or (None,))
