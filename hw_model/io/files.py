"""Write files whole or not at all, read files with readable errors, and pack arrays into reproducible archives.

In each function, ``where`` names the file in errors.
"""

import io
import os
import zipfile
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from difflib import get_close_matches
from pathlib import Path

import numpy as np

from hw_model.errors import InputError, LocsnnError, check_most
from hw_model.io.arguments import check_path, is_plain
from hw_model.io.memory import lacks_memory, near_limit
from hw_model.io.partial import locked, note_written, partial_path, remove, remove_leftovers, sync
from hw_model.values import AnyArray

MAX_FILE_BYTES = 1_000_000_000
"""The size of the largest file that is read, unless a caller sets another. Chosen by hand."""
_LEAST_LIKENESS = 0.8
"""The least similarity (difflib's ratio; 1 is equal) of an existing name that is suggested for a missing one. Chosen by
hand."""


def replace_file(path: Path, content: bytes, where: str) -> None:
    """Write a file under a temporary name next to it, then rename it, so that readers see the old file or the new one.

    If ``path`` is a link, the link stays and its target is replaced. Raises ``InputError`` if ``path`` is anything but
    a plain file (see :func:`check_file`), and if the file cannot be written.
    """
    path = Path(os.path.realpath(path))
    check_file(path, where)
    remove_leftovers(path)
    partial = partial_path(path)
    try:
        # Created empty first, since only an existing file can be locked. The lock tells other processes that the file
        # is in use, not a leftover that they may remove.
        partial.touch(exist_ok=False)
        with locked(partial):
            partial.write_bytes(content)
            # On the disk before the rename: otherwise a power failure could leave an empty file in the old one's place.
            sync(partial)
            os.replace(partial, path)
        note_written(path)
    except OSError as error:
        fix = "Give a file in a folder that exists and can be written."
        raise InputError(
            where, "it cannot be written", measured=error.strerror or "", fix=fix
        ) from None
    finally:
        remove(partial)


def read_bytes(
    path: Path,
    where: str,
    most: int = MAX_FILE_BYTES,
    fix: str = "Give a smaller file.",
    missing: str = "Check the path.",
) -> bytes:
    """Return the bytes of a file.

    Raises ``InputError`` if it is missing, unreadable or a folder, or has more than ``most`` bytes. The error's way out
    is ``fix`` for a file that is too large, and ``missing`` for one that cannot be read.
    """
    try:
        status = path.stat()
        # A pipe or a device may never end. (A folder passes, and read_bytes raises OSError for it.)
        if not is_plain(status):
            raise InputError(where, "it is not a plain file", fix="Write it to a file first.")
        check_most(status.st_size, most, where, "it is too large", unit="bytes", fix=fix)
        return path.read_bytes()
    except OSError as error:
        is_missing = isinstance(error, FileNotFoundError)
        fix = near(path, missing) if is_missing else missing
        raise InputError(
            where, "it cannot be read", measured=error.strerror or "", fix=fix
        ) from None


def near(path: Path, otherwise: str) -> str:
    """Return a "Did you mean" with an existing path for one that does not exist, or else the text ``otherwise``.

    The suggestion replaces the first part of the path that does not exist by the most similar name in its folder.
    """
    misspelt = _first_missing(path)
    # The last part may exist all the same, as a broken link: then no name is misspelt.
    if os.path.lexists(misspelt):
        return otherwise
    # Unlike iterdir(), glob() raises no error for a folder that may not be read.
    neighbours = [*misspelt.parent.glob("*")]
    if misspelt != path:
        # The path goes on below the misspelt name, so only a folder can be meant.
        neighbours = [neighbour for neighbour in neighbours if neighbour.is_dir()]
    names = [neighbour.name for neighbour in neighbours]
    similar_names = get_close_matches(misspelt.name, names, n=1, cutoff=_LEAST_LIKENESS)
    if not similar_names:
        return otherwise
    suggestion = misspelt.with_name(similar_names[0]) / path.relative_to(misspelt)
    return f"Did you mean {str(suggestion)!r}?"


def _first_missing(path: Path) -> Path:
    """Return the longest leading part of a path that lies in an existing folder.

    If a name in the path does not exist, the first such name is the last one of this part.
    """
    part = path
    while not part.parent.is_dir() and part != part.parent:
        part = part.parent
    return part


@contextmanager
def parsing(where: str, what: str, *, fix: str) -> Iterator[None]:
    """Turn any exception of a parser into one ``InputError``.

    On damaged bytes, parsers raise many more kinds of exception than they document, and all mean the same to the user.
    Our own errors pass unchanged, and so does a lack of memory, which is not the file's fault.
    """
    try:
        yield
    except LocsnnError:
        raise
    except Exception as error:
        # If there is memory left, the parser lacked it only because damaged bytes claim a huge size: that is damage.
        if lacks_memory(error) and near_limit():
            raise MemoryError(str(error)) from error
        raise InputError(where, what, fix=fix) from error


def check_file(path: Path, where: str) -> None:
    """Raise InputError if the path is a folder, a device or the like, or lies in a folder that does not exist."""
    check_path(path, where)
    if os.path.lexists(path) and not path.is_file():
        kind = "a folder" if path.is_dir() else "not a plain file"
        raise InputError(where, f"it is {kind}", fix="Give the name of a file.")
    if not path.parent.is_dir():
        raise InputError(where, "its folder does not exist", fix="Make the folder first.")


def pack_arrays(arrays: Mapping[str, AnyArray], *, compressed: bool) -> bytes:
    """Return an ``.npz`` file whose bytes depend on the arrays alone and, if compressed, on the version of zlib."""
    # A generator, so that only one array's bytes are in memory at a time.
    files = ((f"{name}.npy", npy_bytes(array)) for name, array in arrays.items())
    return pack_files(files, compressed=compressed)


def npy_bytes(array: AnyArray) -> bytes:
    """Return the bytes of a ``.npy`` file."""
    content = io.BytesIO()
    # Always C order and version 1.0 of the format, so that equal arrays give equal bytes.
    in_c_order = np.asarray(array, order="C")
    np.lib.format.write_array(content, in_c_order, version=(1, 0), allow_pickle=False)
    return content.getvalue()


def pack_files(files: Iterable[tuple[str, bytes]], *, compressed: bool) -> bytes:
    """Return a zip archive of files, given by name and content, without time stamps.

    ``files`` may be a generator: its contents are packed one at a time.
    """
    method = zipfile.ZIP_DEFLATED if compressed else zipfile.ZIP_STORED
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w") as archive:
        for name, content in files:
            # Every entry has a date. The earliest one that a zip archive can hold stands for none.
            entry = zipfile.ZipInfo(name, date_time=(1980, 1, 1, 0, 0, 0))
            entry.compress_type = method
            archive.writestr(entry, content)
    return packed.getvalue()
