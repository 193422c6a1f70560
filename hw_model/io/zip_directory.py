"""Zip archives of strangers: zipfile builds an object for every entry that a directory claims, and unpacks unasked."""

import os
import struct
import zipfile
from typing import IO

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
