"""Untrusted zip archives.

zipfile builds an object for every entry that a directory claims, and unpacks as much as the data gives.
"""

import sys
import zipfile
from collections import Counter
from typing import IO

from hw_model.errors import InputError

MAX_DIRECTORY_BYTES = 20_000_000
"""About 200,000 entries."""
_SIZE = 5
"""The entry of the end of an archive that says how large its directory is."""


class BoundedZip(zipfile.ZipFile):
    """An archive to read whose directory was checked; raises what zipfile and :func:`check_directory` do.

    ``InputError`` if two files have the same name: readers differ in which of them they take.
    """

    def __init__(self, stream: IO[bytes], where: str, fix: str) -> None:
        check_directory(stream)
        super().__init__(stream)
        for name, count in Counter(self.namelist()).items():
            if count > 1 and not name.endswith("/"):
                raise InputError(where, f"it contains {name[:80]!r} twice", fix=fix)

    @property
    def unpacked_bytes(self) -> int:
        """What all entries claim to hold."""
        return sum(entry.file_size for entry in self.infolist())

    def content(self, name: str, most: int = sys.maxsize) -> bytes:
        """Return the bytes of an entry, at most so many of the first, and unpack no more than it claims.

        ``read()`` would unpack 2 GiB for an entry that claims one byte. Raises what zipfile raises, and ``ValueError``
        for compression methods that it cannot stop.
        """
        entry = self.getinfo(name)
        if entry.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
            raise ValueError(f"packed by method {entry.compress_type}")
        with self.open(entry) as packed:
            return packed.read(min(entry.file_size, most))


def check_directory(stream: IO[bytes]) -> None:
    """Raise ``ValueError`` for a directory above :data:`MAX_DIRECTORY_BYTES`; what is no archive passes.

    Newer versions of zipfile raise ``BadZipFile`` where the directory would begin outside the file.
    """
    # That of zipfile itself: another search might find another end than the one that is read.
    end = zipfile._EndRecData(stream)  # type: ignore[attr-defined]
    stream.seek(0)
    if end is not None and end[_SIZE] > MAX_DIRECTORY_BYTES:
        raise ValueError(f"a directory of {end[_SIZE]} bytes")
