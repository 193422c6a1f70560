"""Read untrusted zip archives without letting them use up memory.

A zip archive ends in a directory, which lists its entries with their sizes. Python's ``zipfile`` builds an object for
each entry of the directory, and unpacks however many bytes the data gives, whatever size the directory claims. Here,
the size of the directory is bounded, and so is what an entry unpacks to.
"""

import sys
import zipfile
from collections import Counter
from typing import IO

from hw_model.errors import InputError

MAX_DIRECTORY_BYTES = 20_000_000
"""The largest directory that is read: about 200,000 entries. Chosen by hand."""
_DIRECTORY_BYTES = 5
"""The index of the directory's size in the record that ``zipfile._EndRecData`` returns."""


class BoundedZip(zipfile.ZipFile):
    """An archive to read whose directory is checked when it is opened.

    Raises what zipfile and :func:`check_directory` raise, and ``InputError`` if two files have the same name: programs
    differ in which of the two they read, so an archive could show one file to a checker and another one to us.
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
        """The bytes that all entries together unpack to, as the directory claims."""
        return sum(entry.file_size for entry in self.infolist())

    def content(self, name: str, most: int = sys.maxsize) -> bytes:
        """Return the first ``most`` bytes of an entry, and unpack no more than it claims to hold.

        ``ZipFile.read()`` would unpack 2 GiB for an entry that claims one byte. Raises what zipfile raises, and
        ``ValueError`` for compression methods whose unpacking zipfile cannot stop at a given size.
        """
        entry = self.getinfo(name)
        if entry.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
            raise ValueError(f"packed by method {entry.compress_type}")
        with self.open(entry) as packed:
            return packed.read(min(entry.file_size, most))


def check_directory(stream: IO[bytes]) -> None:
    """Raise ``ValueError`` for a directory of more than :data:`MAX_DIRECTORY_BYTES`.

    A stream that is not an archive passes, since ``ZipFile`` will refuse it. Newer versions of zipfile raise
    ``BadZipFile`` if the directory would begin outside the file.
    """
    # Use zipfile's own search for the end of the archive: a search of our own might find another end than zipfile
    # reads later.
    end = zipfile._EndRecData(stream)  # type: ignore[attr-defined]
    stream.seek(0)
    if end is not None and end[_DIRECTORY_BYTES] > MAX_DIRECTORY_BYTES:
        raise ValueError(f"a directory of {end[_DIRECTORY_BYTES]} bytes")
