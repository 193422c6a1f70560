"""The files of a folder or zip archive: their names and sizes, and their bytes on request, never unpacked to disk."""

import stat
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path, PurePosixPath

from hw_model.io.files import parsing, read_bytes
from hw_model.io.zip_directory import BoundedZip
from hw_model.values import Frozen
from locsnn_compile.errors import InputError, check_most

#: The folder of ``.startend`` files next to that of recordings, as VT_SNN has it.
TIMES = "traj_start_ends"
#: Largest number of recordings, bytes of one of them unpacked, and of all of them.
MAX_MEMBERS, MAX_MEMBER_BYTES, MAX_TOTAL_BYTES = 100_000, 100_000_000, 1_600_000_000


class Members(Frozen, eq=False):
    """``sizes``: bytes of each file, unpacked, by its name with forward slashes; ``read`` returns the bytes of one."""

    where: str
    sizes: dict[str, int]
    read: Callable[[str], bytes]
    inside: str
    """What errors say before the name of a file."""

    def place(self, name: str) -> str:
        """Return how errors name a file."""
        return f"{self.inside}{PurePosixPath(name).name!r}"

    def check_sizes(self, names: list[str]) -> None:
        """Refuse files that are too many or too large, before any is read."""
        total = sum(self.sizes[name] for name in names)
        check_most(len(names), MAX_MEMBERS, self.where, "it holds too many recordings", fix="Give fewer.")
        check_most(total, MAX_TOTAL_BYTES, self.where, "its recordings are too large together", fix="Give fewer.")
        for name in names:
            size, fix = self.sizes[name], "Give one recording."
            check_most(size, MAX_MEMBER_BYTES, self.place(name), "it is too large", unit="bytes", fix=fix)


@contextmanager
def open_members(path: Path) -> Iterator[Members]:
    """Open an archive, a folder, or a single file of events, which counts as a folder of it and its ``.startend``.

    Raises ``InputError`` for an archive that is damaged, holds a name twice, or holds a link.
    """
    if path.suffix != ".zip" or path.is_dir():
        yield _plain_files(path)
        return
    where, fix = f"archive {path.name!r}", "Fetch the archive again."
    try:
        stream = path.open("rb")
    except OSError as error:
        raise InputError(where, "it cannot be read", measured=error.strerror or "", fix="Check the path.") from None
    with stream:
        with parsing(where, "it is damaged, truncated or not a zip archive", fix=fix):
            archive = BoundedZip(stream, where, fix)

        def read(name: str) -> bytes:
            with parsing(f"{where}, {PurePosixPath(name).name!r}", "it is damaged", fix=fix):
                return archive.content(name)

        entries = [entry for entry in archive.infolist() if not entry.filename.endswith("/")]
        links = [entry.filename for entry in entries if stat.S_ISLNK(entry.external_attr >> 16)]
        if links:
            what = f"{links[0][:80]!r} is a link, and links are not followed"
            raise InputError(where, what, fix="Store the file itself.")
        yield Members(where, {entry.filename: entry.file_size for entry in entries}, read, f"{where}, ")


def _plain_files(path: Path) -> Members:
    """Return the files of a folder, or one file and its ``.startend``, and those of the folder of times next to it."""
    folder = path.absolute() if path.is_dir() else path.absolute().parent
    times = {f"{TIMES}/{file.name}": file for file in sorted((folder.parent / TIMES).glob("*.startend"))}
    if path.is_dir():
        where, inside = f"folder {path.name!r}", f"folder {path.name!r}, "
        files = {file.relative_to(path).as_posix(): file for file in sorted(path.rglob("*")) if file.is_file()}
    else:
        where, inside = f"file {path.name!r}", "file "
        files = {file.name: file for file in (path, path.with_suffix(".startend")) if file.exists()}
    files = times | files
    sizes = {name: file.stat().st_size for name, file in files.items()}
    return Members(where, sizes, lambda name: read_bytes(files[name], f"{inside}{files[name].name!r}"), inside)
