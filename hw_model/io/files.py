"""Files written whole or not at all, and archives of arrays whose bytes depend only on the arrays.

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
from hw_model.io.given import check_path, is_plain
from hw_model.io.memory import lacks_memory, near_limit
from hw_model.io.partial import locked, note_written, partial_path, remove, remove_leftovers, sync
from hw_model.values import AnyArray

MAX_FILE_BYTES = 1_000_000_000
"""Size of the largest file that is read."""
_LEAST_LIKENESS = 0.8
"""Likeness from which a name is offered for one that does not exist; 1 is the same name."""


def replace_file(path: Path, content: bytes, where: str) -> None:
    """Write a file under a temporary name next to it, then put it in place.

    A link stays, and its target is written. Raises ``InputError`` for anything but a plain file
    (see :func:`check_file`), and where the file cannot be written.
    """
    path = Path(os.path.realpath(path))
    check_file(path, where)
    remove_leftovers(path)
    partial = partial_path(path)
    try:
        partial.touch(exist_ok=False)
        # The lock tells other processes that this file is no leftover.
        with locked(partial):
            partial.write_bytes(content)
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

    Raises ``InputError`` where it is missing, unreadable, a folder, or has more than ``most``
    bytes. ``fix`` is the way out for a file that is too large, ``missing`` for one that cannot be
    read.
    """
    try:
        status = path.stat()
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
    """Return the way out for a path that does not exist: one that differs by a few letters.

    Without such a path, return ``otherwise``.
    """
    wrong = _first_missing(path)
    if os.path.lexists(wrong):
        return otherwise
    # Unlike iterdir(), glob() passes over a folder that must not be read.
    neighbours = [*wrong.parent.glob("*")]
    if wrong != path:
        # The path goes on below the wrong name, so only a folder can be meant.
        neighbours = [neighbour for neighbour in neighbours if neighbour.is_dir()]
    names = [neighbour.name for neighbour in neighbours]
    alike = get_close_matches(wrong.name, names, n=1, cutoff=_LEAST_LIKENESS)
    if not alike:
        return otherwise
    meant = wrong.with_name(alike[0]) / path.relative_to(wrong)
    return f"Did you mean {str(meant)!r}?"


def _first_missing(path: Path) -> Path:
    """Return the longest part of a path whose folder exists; if a name is wrong, its last one is."""
    part = path
    while not part.parent.is_dir() and part != part.parent:
        part = part.parent
    return part


@contextmanager
def parsing(where: str, what: str, *, fix: str) -> Iterator[None]:
    """Turn whatever a parser raises on damaged bytes into one ``InputError``.

    Our own errors pass, and so does a lack of memory, which is no damage. Parsers raise many more
    kinds of exception than they document, and each means the same to the user.
    """
    try:
        yield
    except LocsnnError:
        raise
    except Exception as error:
        # Far from the limit, a parser lacks memory because damaged bytes claim a huge size.
        if lacks_memory(error) and near_limit():
            raise MemoryError(str(error)) from error
        raise InputError(where, what, fix=fix) from error


def check_file(path: Path, where: str) -> None:
    """Refuse a file that cannot be written, or that would replace a folder, a device or the like."""
    check_path(path, where)
    if os.path.lexists(path) and not path.is_file():
        kind = "a folder" if path.is_dir() else "not a plain file"
        raise InputError(where, f"it is {kind}", fix="Give the name of a file.")
    if not path.parent.is_dir():
        raise InputError(where, "its folder does not exist", fix="Make the folder first.")


def pack_arrays(arrays: Mapping[str, AnyArray], *, compressed: bool) -> bytes:
    """Return an ``.npz`` without time stamps; compressed bytes also depend on the build of zlib."""
    # A generator, so that only one array's bytes are in memory at a time.
    files = ((f"{name}.npy", npy_bytes(array)) for name, array in arrays.items())
    return pack_files(files, compressed=compressed)


def npy_bytes(array: AnyArray) -> bytes:
    """Return the bytes of a ``.npy`` file."""
    content = io.BytesIO()
    # One order and one version of the format, so that equal arrays give equal bytes.
    in_c_order = np.asarray(array, order="C")
    np.lib.format.write_array(content, in_c_order, version=(1, 0), allow_pickle=False)
    return content.getvalue()


def pack_files(files: Iterable[tuple[str, bytes]], *, compressed: bool) -> bytes:
    """Return a zip archive of names and contents, without time stamps.

    Only one content is in memory at a time.
    """
    method = zipfile.ZIP_DEFLATED if compressed else zipfile.ZIP_STORED
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w") as archive:
        for name, content in files:
            # The earliest date that a zip archive can hold stands for none.
            entry = zipfile.ZipInfo(name, date_time=(1980, 1, 1, 0, 0, 0))
            entry.compress_type = method
            archive.writestr(entry, content)
    return packed.getvalue()
