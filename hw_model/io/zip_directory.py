"""Untrusted zip archives.

zipfile builds an object for every entry that a directory claims, and unpacks as much as the data gives.
"""

import os
import struct
import zipfile
from collections import Counter
from typing import IO

from hw_model.errors import InputError

MAX_DIRECTORY_BYTES = 20_000_000
"""About 200,000 entries."""
_END, _END_BYTES, _MAX_COMMENT = b"PK\x05\x06", 22, 0xFFFF
_LOCATOR, _LOCATOR_BYTES = b"PK\x06\x07", 20
_END64, _END64_BYTES = b"PK\x06\x06", 56


class BoundedZip(zipfile.ZipFile):
    """An archive to read whose directory was checked; raises what zipfile and :func:`check_directory` do.

    ``InputError`` if two files have the same name: readers differ in which of them they take.
    """

    def __init__(self, stream: IO[bytes], where: str, fix: str) -> None:
        check_directory(stream)
        super().__init__(stream)
        for name, count in Counter(self.namelist()).items():
            if count > 1 and not name.endswith("/"):
                raise InputError(where, f"it holds {name[:80]!r} twice", fix=fix)

    @property
    def unpacked_bytes(self) -> int:
        """What all entries claim to hold."""
        return sum(entry.file_size for entry in self.infolist())

    def content(self, name: str) -> bytes:
        """Return the bytes of an entry, and unpack no more than it claims.

        ``read()`` would unpack 2 GiB for an entry that claims one byte. Raises what zipfile raises, and ``ValueError``
        for compression methods that it cannot stop.
        """
        entry = self.getinfo(name)
        if entry.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
            raise ValueError(f"packed by method {entry.compress_type}")
        with self.open(entry) as packed:
            return packed.read(entry.file_size)


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
