"""Untrusted zip archives: how much of memory they may take.

A zip archive ends in a directory, which lists its entries with their sizes. ``zipfile`` builds an
object for each entry that a directory claims, and unpacks as many bytes as the data gives.
"""

import sys
import zipfile
from collections import Counter
from typing import IO

from hw_model.errors import InputError

MAX_DIRECTORY_BYTES = 20_000_000
"""About 200,000 entries."""
_DIRECTORY_BYTES = 5
"""Where the record that ``zipfile._EndRecData`` returns says how many bytes the directory has."""


class BoundedZip(zipfile.ZipFile):
    """An archive to read whose directory was checked.

    Raises what zipfile and :func:`check_directory` do, and ``InputError`` if two files have the
    same name: readers differ in which of them they take.
    """

    def __init__(self, stream: IO[bytes], where: str, fix: str) -> None:
        check_directory(stream)
        super().__init__(stream)
        for name, count in Counter(self.namelist()).items():
            is_folder = name.endswith("/")
            if count > 1 and not is_folder:
                raise InputError(where, f"it contains {name[:80]!r} twice", fix=fix)

    @property
    def unpacked_bytes(self) -> int:
        """What all entries claim to hold."""
        return sum(entry.file_size for entry in self.infolist())

    def content(self, name: str, most: int = sys.maxsize) -> bytes:
        """Return the first ``most`` bytes of an entry, and unpack no more than it claims to hold.

        ``ZipFile.read()`` would unpack 2 GiB for an entry that claims one byte. Raises what zipfile
        raises, and ``ValueError`` for compression methods that it cannot stop at a size.
        """
        entry = self.getinfo(name)
        if entry.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
            raise ValueError(f"packed by method {entry.compress_type}")
        with self.open(entry) as packed:
            return packed.read(min(entry.file_size, most))


def check_directory(stream: IO[bytes]) -> None:
    """Raise ``ValueError`` for a directory above :data:`MAX_DIRECTORY_BYTES`.

    What is no archive passes: ``ZipFile`` refuses it. Newer versions of zipfile raise
    ``BadZipFile`` where the directory would begin outside the file.
    """
    # zipfile's own search for the end of the archive: ours might find another one than it reads.
    end = zipfile._EndRecData(stream)  # type: ignore[attr-defined]
    stream.seek(0)
    if end is not None and end[_DIRECTORY_BYTES] > MAX_DIRECTORY_BYTES:
        raise ValueError(f"a directory of {end[_DIRECTORY_BYTES]} bytes")
