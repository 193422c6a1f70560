"""Temporary names under which output is written, and the removal of those that a killed process left behind.

A partial file or folder lies next to its target, as ``.<name>.partial-<token>``, and is locked by the process that
writes it. The lock ends with the process, so a partial file that can be locked belongs to nobody.
"""

import os
import re
import secrets
import shutil
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from hw_model.errors import InputError

MAX_NAME_BYTES = 100
"""Largest number of bytes of a target's name in its partial name, because the length of names is limited."""


_written: set[Path] = set()


def note_written(path: Path) -> None:
    """Remember that this process has put a file or folder in place."""
    _written.add(path)


def forget_written() -> None:
    """Begin anew: a command tells what it has written itself, not one before it in this process."""
    _written.clear()


def written() -> list[Path]:
    """Return the files and folders that this process has put in place, and that are still there."""
    return sorted(path for path in _written if path.exists())


def partial_path(target: Path) -> Path:
    """Return a new partial name for a target, next to it."""
    return target.with_name(f"{_prefix(target)}{secrets.token_hex(6)}")


@contextmanager
def claimed(target: Path, where: str) -> Iterator[None]:
    """Be the only process that writes a target; ``InputError`` where another one does, named by ``where``.

    What says so is a locked file next to the target, which is removed in the end.
    """
    if sys.platform == "win32":
        yield
        return
    claim = target.with_name(f"{_prefix(target)}claim")
    try:
        handle = os.open(claim, os.O_RDONLY | os.O_CREAT | os.O_NOFOLLOW, 0o644)
    except OSError:  # what is wrong with the folder is said when the target is written
        yield
        return
    try:
        # Who ended meanwhile has removed the file that was opened here.
        if (
            not _lock(handle)
            or not claim.exists()
            or not os.path.samestat(os.fstat(handle), claim.stat())
        ):
            fix = "Wait for it, or write somewhere else."
            raise InputError(where, "another process is writing it", fix=fix)
        try:
            yield
        finally:
            remove(claim)
    finally:
        os.close(handle)


@contextmanager
def locked(path: Path, wait: bool = False) -> Iterator[bool]:
    """Hold the lock of an existing partial file or folder, and tell whether it could be taken.

    ``wait`` for that of a file, which is created if missing.
    """
    plain = getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0)
    handle = os.open(path, os.O_RDONLY | plain | (os.O_CREAT if wait else 0), 0o644)
    try:
        yield _lock(handle, wait)
    finally:
        os.close(handle)


def remove_leftovers(target: Path) -> None:
    """Remove what killed processes left of this target; partial files of living processes stay."""
    ours = re.compile(re.escape(_prefix(target)) + "[0-9a-f]{12}")
    try:
        leftovers = [name for name in os.listdir(target.parent) if ours.fullmatch(name)]
    except OSError:
        return
    for name in leftovers:
        with suppress(OSError), locked(target.parent / name) as is_free:
            if is_free:
                remove(target.parent / name)


def remove(path: Path) -> None:
    """Remove a file or folder as far as possible: leftovers must not keep anybody from working."""
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path, ignore_errors=True)
        return
    with suppress(OSError):
        path.unlink(missing_ok=True)


def sync(path: Path) -> None:
    """Write a file or folder through to the disk, if the system can."""
    handle = os.open(path, os.O_RDONLY)
    try:
        # Some file systems cannot sync folders.
        with suppress(OSError):
            os.fsync(handle)
    finally:
        os.close(handle)


def _prefix(target: Path) -> str:
    return f".{os.fsdecode(os.fsencode(target.name)[:MAX_NAME_BYTES])}.partial-"


def _lock(handle: int, wait: bool = False) -> bool:
    """Take a lock that ends with this process; tell whether that succeeded. With ``wait``, wait for it."""
    if sys.platform == "win32":
        return False
    import fcntl

    try:
        fcntl.flock(handle, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB))
    except OSError:
        return False
    return True
