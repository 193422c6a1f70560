"""The files of a folder or zip archive, read where they lie: nothing is unpacked to disk, and sizes come first."""

from __future__ import annotations

import stat
import zipfile
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

from hw_model.io.zip_directory import check_directory
from locsnn_compile.data.torch_file import read_bytes
from locsnn_compile.errors import InputError

#: Largest number of recordings, bytes of one of them unpacked, and of all of them.
MAX_MEMBERS, MAX_MEMBER_BYTES, MAX_TOTAL_BYTES = 100_000, 100_000_000, 1_600_000_000


@dataclass(frozen=True, eq=False)
class Members:
    """``sizes`` of the files by name, unpacked and with forward slashes; ``read`` gives the bytes of one."""

    where: str
    sizes: dict[str, int]
    read: Callable[[str], bytes]

    def place(self, name: str) -> str:
        """Return how errors name a file."""
        return f"{self.where}, {PurePosixPath(name).name!r}"

    def check_sizes(self, names: list[str]) -> None:
        """Refuse files that are too many or too large, before any is read."""
        for what, found, limit in (
            ("it holds too many recordings", len(names), MAX_MEMBERS),
            ("its recordings are too large together", sum(self.sizes[name] for name in names), MAX_TOTAL_BYTES),
        ):
            if found > limit:
                raise InputError(self.where, what, measured=f"{found} against {limit}", fix="Give fewer.")
        for name in names:
            if self.sizes[name] > MAX_MEMBER_BYTES:
                raise InputError(
                    self.place(name),
                    "it is too large",
                    measured=f"{self.sizes[name]} bytes against {MAX_MEMBER_BYTES}",
                    fix="Give one recording.",
                )


@contextmanager
def open_members(path: Path) -> Iterator[Members]:
    """Open a folder or an archive; ``InputError`` for one that is damaged, or holds a name twice."""
    if path.is_dir():
        where = f"folder {path.name!r}"
        files = {file.relative_to(path).as_posix(): file for file in sorted(path.rglob("*")) if file.is_file()}
        sizes = {name: file.stat().st_size for name, file in files.items()}
        yield Members(where, sizes, lambda name: read_bytes(files[name], f"{where}, {files[name].name!r}"))
        return
    where = f"archive {path.name!r}"
    fix = "Fetch the archive again."
    try:
        with path.open("rb") as stream:
            check_directory(stream)
        archive = zipfile.ZipFile(path)
    except OSError as error:
        raise InputError(where, "it cannot be read", measured=error.strerror or "", fix="Check the path.") from None
    # zipfile raises more kinds on hostile bytes than it documents.
    except Exception:
        raise InputError(where, "it is damaged, truncated or not a zip archive", fix=fix) from None

    def read(name: str) -> bytes:
        try:
            return archive.read(name)
        except Exception:
            raise InputError(f"{where}, {PurePosixPath(name).name!r}", "it is damaged", fix=fix) from None

    with archive:
        files_inside = [member for member in archive.infolist() if not member.filename.endswith("/")]
        twice = [name for name, count in Counter(member.filename for member in files_inside).items() if count > 1]
        if twice:
            raise InputError(where, f"it holds {twice[0][:80]!r} twice", fix=fix)
        links = [member.filename for member in files_inside if stat.S_ISLNK(member.external_attr >> 16)]
        if links:
            raise InputError(
                where, f"{links[0][:80]!r} is a link, and links are not followed", fix="Store the file itself."
            )
        yield Members(where, {member.filename: member.file_size for member in files_inside}, read)
