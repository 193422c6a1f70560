"""Files written whole or not at all; archives of ours, whose bytes depend on their arrays alone, and of strangers.

Of strangers' archives, zipfile builds an object for every entry that a directory claims, and unpacks unasked.
"""

import io
import os
import struct
import zipfile
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import IO

import numpy as np

from hw_model.errors import InputError, check_most
from hw_model.io.given import check_path, is_plain
from hw_model.io.partial import locked, partial_path, remove, remove_leftovers, sync
from hw_model.values import AnyArray

MAX_FILE_BYTES = 1_000_000_000
"""Largest file that is read."""


def replace_file(path: Path, content: bytes, where: str) -> None:
    """Write a file under a temporary name next to it, then put it in place; ``where`` names it if that fails.

    A link stays, and what it leads to is written. What is not a plain file is refused by :func:`check_file`.
    """
    path = Path(os.path.realpath(path))
    check_file(path, where)
    remove_leftovers(path)
    partial = partial_path(path)
    try:
        partial.touch(exist_ok=False)
        with locked(partial):
            partial.write_bytes(content)
            sync(partial)
            os.replace(partial, path)
    except OSError as error:
        fix = "Give a file in a folder that exists and can be written."
        raise InputError(where, "it cannot be written", measured=error.strerror or "", fix=fix) from None
    finally:
        remove(partial)


def read_bytes(path: Path, where: str, most: int = MAX_FILE_BYTES, fix: str = "Give a smaller file.") -> bytes:
    """Return the bytes of a file; ``InputError`` where it is missing, unreadable, a folder or too large."""
    try:
        found = path.stat()
        if not is_plain(found):
            raise InputError(where, "it is not a plain file", fix="Write it to a file first.")
        check_most(found.st_size, most, where, "it is too large", unit="bytes", fix=fix)
        return path.read_bytes()
    except OSError as error:
        raise InputError(where, "it cannot be read", measured=error.strerror or "", fix="Check the path.") from None


def check_file(path: Path, where: str) -> None:
    """Refuse a file that could not be written, or would take the place of what is no plain file: a folder, a device."""
    check_path(path, where)
    if os.path.lexists(path) and not path.is_file():
        kind = "a folder" if path.is_dir() else "not a plain file"
        raise InputError(where, f"it is {kind}", fix="Give the name of a file.")
    if not path.parent.is_dir():
        raise InputError(where, "its folder does not exist", fix="Make the folder first.")


def pack_arrays(arrays: Mapping[str, AnyArray], *, compressed: bool) -> bytes:
    """Return an ``.npz`` without time stamps. Compressed bytes also depend on the build of zlib."""
    return pack_files(((f"{name}.npy", npy_bytes(array)) for name, array in arrays.items()), compressed=compressed)


def npy_bytes(array: AnyArray) -> bytes:
    """Return the bytes of a ``.npy`` file."""
    content = io.BytesIO()
    np.lib.format.write_array(content, np.asarray(array, order="C"), version=(1, 0), allow_pickle=False)
    return content.getvalue()


def pack_files(files: Iterable[tuple[str, bytes]], *, compressed: bool) -> bytes:
    """Return a zip archive of names and contents without time stamps; of the contents it holds one at a time."""
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w") as archive:
        for name, content in files:
            entry = zipfile.ZipInfo(name, date_time=(1980, 1, 1, 0, 0, 0))
            entry.compress_type = zipfile.ZIP_DEFLATED if compressed else zipfile.ZIP_STORED
            archive.writestr(entry, content)
    return packed.getvalue()


MAX_DIRECTORY_BYTES = 20_000_000
"""About 200,000 entries."""

_END, _END_BYTES, _MAX_COMMENT = b"PK\x05\x06", 22, 0xFFFF
_LOCATOR, _LOCATOR_BYTES = b"PK\x06\x07", 20
_END64, _END64_BYTES = b"PK\x06\x06", 56


def open_archive(stream: IO[bytes]) -> zipfile.ZipFile:
    """Return an archive to read, its directory checked; raises what zipfile and :func:`check_directory` do."""
    check_directory(stream)
    return zipfile.ZipFile(stream)


def check_directory(stream: IO[bytes]) -> None:
    """Raise ``ValueError`` for a directory above :data:`MAX_DIRECTORY_BYTES`; what is no archive passes."""
    length = stream.seek(0, os.SEEK_END)
    begin = max(0, length - _END_BYTES - _MAX_COMMENT - _LOCATOR_BYTES - _END64_BYTES)
    stream.seek(begin)
    tail = stream.read()
    stream.seek(0)
    at = tail.rfind(_END)
    if at < 0 or len(tail) < at + _END_BYTES:
        return
    (size,) = struct.unpack_from("<L", tail, at + 12)
    before = at - _LOCATOR_BYTES - _END64_BYTES
    if before >= 0 and tail.startswith(_END64, before) and tail.startswith(_LOCATOR, at - _LOCATOR_BYTES):
        (size,) = struct.unpack_from("<Q", tail, before + 40)
    if size > MAX_DIRECTORY_BYTES:
        raise ValueError(f"a directory of {size} bytes")


def read_entry(archive: zipfile.ZipFile, entry: zipfile.ZipInfo) -> bytes:
    """Return the bytes of an entry, and unpack no more than it claims: ``read()`` would take 2 GiB for a claimed byte.

    Raises what zipfile raises, and ``ValueError`` for methods of packing that it cannot stop.
    """
    if entry.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
        raise ValueError(f"packed by method {entry.compress_type}")
    with archive.open(entry) as packed:
        return packed.read(entry.file_size)
