"""Partial files: output under a temporary name, locks on it, and the removal of what a killed process left behind.

A partial file or folder lies next to its target, named ``.<name>.partial-<token>``, and is locked by the process that
writes it. The system releases the lock when the process ends, even if it is killed. So a partial file that can be
locked is a leftover and may be removed.
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
"""How many bytes of a target's name its partial name takes, since file systems limit names to 255 bytes."""


_written: set[Path] = set()
"""The files and folders that this process has put in place, to be listed if a command is interrupted."""


def note_written(path: Path) -> None:
    """Remember that this process has put a file or folder in place."""
    _written.add(path)


def forget_written() -> None:
    """Forget the files and folders written so far: a command lists its own, not those of earlier commands."""
    _written.clear()


def written() -> list[Path]:
    """Return the files and folders that this process has put in place, and that are still there."""
    return sorted(path for path in _written if path.exists())


def partial_path(target: Path) -> Path:
    """Return a new partial name for a target, next to it."""
    return target.with_name(f"{_prefix(target)}{secrets.token_hex(6)}")


@contextmanager
def claimed(target: Path, where: str) -> Iterator[None]:
    """Make sure that no other process writes the target meanwhile; raise ``InputError`` if one does.

    The claim is a locked file next to the target, which is removed at the end. ``where`` names the target in the error.
    """
    # Locks need fcntl, which Windows does not have.
    if sys.platform == "win32":
        yield
        return
    claim = target.with_name(f"{_prefix(target)}claim")
    try:
        handle = os.open(claim, os.O_RDONLY | os.O_CREAT | os.O_NOFOLLOW, 0o644)
    except OSError:
        # The folder cannot be written. The error about that comes when the target is written.
        yield
        return
    try:
        # Another process may have removed the file at its end, after we opened it: then our lock protects nothing.
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
    """Hold the lock of an existing partial file or folder; the value is whether the lock was free.

    With ``wait``, wait until it is free; the file is created if it is missing.
    """
    # Never follow a link, and never wait for the other end of a pipe. Windows has neither flag.
    flags = os.O_RDONLY | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0)
    if wait:
        flags |= os.O_CREAT
    handle = os.open(path, flags, 0o644)
    try:
        yield _lock(handle, wait)
    finally:
        os.close(handle)


def remove_leftovers(target: Path) -> None:
    """Remove partial files of this target that killed processes left; those of running processes stay."""
    # The names that `partial_path` makes: 6 random bytes are 12 hexadecimal digits.
    partial_name = re.compile(re.escape(_prefix(target)) + "[0-9a-f]{12}")
    try:
        names = [name for name in os.listdir(target.parent) if partial_name.fullmatch(name)]
    except OSError:
        return
    for name in names:
        with suppress(OSError), locked(target.parent / name) as is_free:
            if is_free:
                remove(target.parent / name)


def remove(path: Path) -> None:
    """Remove a file or folder as far as possible, without an error: a leftover must not stop anybody's work."""
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path, ignore_errors=True)
        return
    with suppress(OSError):
        path.unlink(missing_ok=True)


def sync(path: Path) -> None:
    """Make sure that a file's content, or a folder's list of names, is on the disk, if the system can."""
    handle = os.open(path, os.O_RDONLY)
    try:
        # Some file systems cannot sync folders.
        with suppress(OSError):
            os.fsync(handle)
    finally:
        os.close(handle)


def _prefix(target: Path) -> str:
    """Return the beginning of the partial names of a target; the dot at the front hides them from listings."""
    return f".{os.fsdecode(os.fsencode(target.name)[:MAX_NAME_BYTES])}.partial-"


def _lock(handle: int, wait: bool = False) -> bool:
    """Take the lock of an open file and return whether that succeeded; with ``wait``, wait until it is free.

    The lock ends when the file is closed or the process ends.
    """
    # Without locks, nothing counts as free, so that no leftover is removed.
    if sys.platform == "win32":
        return False
    import fcntl

    operation = fcntl.LOCK_EX if wait else fcntl.LOCK_EX | fcntl.LOCK_NB
    try:
        fcntl.flock(handle, operation)
    except OSError:
        return False
    return True
