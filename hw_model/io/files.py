"""Files written whole or not at all, and archives of arrays whose bytes depend only on the arrays."""

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
_ALIKE = 0.8
"""Likeness of a name from which it is offered for one that does not exist; 1 is the same name."""


def replace_file(path: Path, content: bytes, where: str) -> None:
    """Write a file under a temporary name next to it, then put it in place; ``where`` names it in errors.

    A link stays, and its target is written. Anything but a plain file is refused: see :func:`check_file`.
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
    """Return the bytes of a file; ``InputError`` where it is missing, unreadable, a folder or too large.

    ``fix`` is the way out for a file that is too large, ``missing`` for one that cannot be read.
    """
    try:
        found = path.stat()
        if not is_plain(found):
            raise InputError(where, "it is not a plain file", fix="Write it to a file first.")
        check_most(found.st_size, most, where, "it is too large", unit="bytes", fix=fix)
        return path.read_bytes()
    except OSError as error:
        fix = near(path, missing) if isinstance(error, FileNotFoundError) else missing
        raise InputError(
            where, "it cannot be read", measured=error.strerror or "", fix=fix
        ) from None


def near(path: Path, otherwise: str) -> str:
    """Return the way out for a path that does not exist: one that differs by a few letters, or ``otherwise``."""
    part = path
    while not part.parent.is_dir() and part != part.parent:
        part = part.parent
    others = [] if os.path.lexists(part) else part.parent.glob("*")
    names = [beside.name for beside in others if part == path or beside.is_dir()]
    close = get_close_matches(part.name, names, 1, _ALIKE)
    return (
        f"Did you mean {str(part.with_name(close[0]) / path.relative_to(part))!r}?"
        if close
        else otherwise
    )


@contextmanager
def parsing(where: str, what: str, *, fix: str) -> Iterator[None]:
    """Turn whatever a parser raises on damaged bytes into one ``InputError``; our own errors pass, and so does
    a lack of memory, which is no damage.

    Parsers raise many more kinds of exception than they document, and each means the same to the user.
    """
    try:
        yield
    except LocsnnError:
        raise
    except Exception as error:
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
    return pack_files(
        ((f"{name}.npy", npy_bytes(array)) for name, array in arrays.items()), compressed=compressed
    )


def npy_bytes(array: AnyArray) -> bytes:
    """Return the bytes of a ``.npy`` file."""
    content = io.BytesIO()
    np.lib.format.write_array(
        content, np.asarray(array, order="C"), version=(1, 0), allow_pickle=False
    )
    return content.getvalue()


def pack_files(files: Iterable[tuple[str, bytes]], *, compressed: bool) -> bytes:
    """Return a zip archive of names and contents, without time stamps; only one content is in memory at a time."""
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w") as archive:
        for name, content in files:
            entry = zipfile.ZipInfo(name, date_time=(1980, 1, 1, 0, 0, 0))
            entry.compress_type = zipfile.ZIP_DEFLATED if compressed else zipfile.ZIP_STORED
            archive.writestr(entry, content)
    return packed.getvalue()
