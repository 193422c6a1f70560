"""Folders replaced as a whole: a process that is killed at any moment leaves either the old output or the new.

There are two ways to do this:

- *Exchange*: the new folder is written next to the old one, under a temporary name (the *stage*), and the old folder's
  other entries are linked into it. Then both exchange their names in one system call (``renameat2``).
- *Journal*: the new entries are written into a folder inside the old one. Once it is complete, it is renamed to
  :data:`JOURNAL`, which makes it valid, and its entries are moved out one by one. If the process is killed meanwhile,
  the next one that reads or writes the folder moves the rest (:func:`recover_folder`).

The journal is used if the system has no ``renameat2``, and for a folder that has to stay where it is, because it is a
mount point or somebody's working directory.
"""

import contextlib
import ctypes
import errno
import functools
import os
import re
import shutil
import sys
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path

from hw_model.io.partial import locked, note_written, partial_path, remove, remove_leftovers, sync

JOURNAL = ".locsnn-journal"
"""The name of a complete journal inside the folder that it belongs to."""

# Constants of Linux (fcntl.h, renameat2(2)): paths are relative to the working directory; exchange two existing paths.
_AT_FDCWD = -100
_RENAME_EXCHANGE = 2


def replace_entries(folder: Path, files: Mapping[str, bytes], ours: str = ".*") -> None:
    """Write files into a folder, all or none; everything else in it stays. After an ``OSError`` it is unchanged.

    A file may lie in a subfolder, as in ``vectors/manifest.yaml``. The subfolder then replaces the previous one as a
    whole, provided that all names in the previous one match the pattern ``ours``. Files replace only files, and folders
    replace only folders.
    """
    # A link to the folder stays; its target is replaced.
    folder = Path(os.path.realpath(folder))
    folder.parent.mkdir(parents=True, exist_ok=True)
    # First what a killed process left: a complete journal is output, partial files are not.
    recover_folder(folder)
    check_entries(folder, {_entry_of(name) for name in files}, ours)
    for target in (folder, folder / JOURNAL):
        remove_leftovers(target)
    may_exchange = not folder.exists() or not _must_stay(folder)
    is_exchanged = may_exchange and _write_and_place(folder, files, _put_in_place)
    if not is_exchanged:
        _write_and_place(folder / JOURNAL, files, _finish_journal)
    note_written(folder)


def _entry_of(name: str) -> str:
    """Return the entry of the folder to which a file belongs: the file itself, or its subfolder with a / at the end."""
    entry, slash, _ = name.partition("/")
    return entry + slash


def check_entries(folder: Path, names: Iterable[str], ours: str = ".*") -> None:
    """Raise ``OSError`` if writing entries would remove a user's files; entries that end in / are folders."""
    # The root is its own parent. It can be neither exchanged nor given a new name next to it.
    if os.path.realpath(folder) == os.path.realpath(folder / ".."):
        raise OSError(errno.EBUSY, "it is the root of the file system")
    for name in sorted(names):
        entry = folder / name
        if entry.is_dir() != name.endswith("/") and os.path.lexists(entry):
            kind = "folder" if entry.is_dir() else "file"
            raise OSError(
                errno.EEXIST, f"it holds a {kind} {name.rstrip('/')!r}, which would be removed"
            )
        if name.endswith("/") and entry.is_dir():
            _check_all_ours(folder, entry, ours)


def _check_all_ours(folder: Path, entry: Path, ours: str) -> None:
    """Raise ``OSError`` for a file in the subfolder ``entry`` whose path within ``folder`` does not match ``ours``."""
    for path in sorted(entry.rglob("*")):
        # A folder is judged by the files in it. A link to a folder is judged itself: rglob does not follow it.
        if path.is_dir() and not path.is_symlink():
            continue
        name = path.relative_to(folder).as_posix()
        if not re.fullmatch(ours, name):
            raise OSError(
                errno.EEXIST,
                f"it holds {name!r}, which was not written here and would be removed",
            )


def recover_folder(folder: Path) -> None:
    """Move the entries out of a complete journal, if a killed process left one."""
    folder = Path(os.path.realpath(folder))
    if (folder / JOURNAL).is_dir():
        _move_entries(folder / JOURNAL)


def finish_writing(folder: Path) -> None:
    """Recover a folder before it is read. A folder that this process may not write is read as it is."""
    with contextlib.suppress(OSError):
        recover_folder(folder)


def _write_and_place(
    target: Path, files: Mapping[str, bytes], place: Callable[[Path, Path, set[str]], bool]
) -> bool:
    """Write files into a stage, a new folder next to ``target``, and put it in place; return whether that was possible.

    ``place(stage, target, entries)`` puts the stage in the place of the target; it returns whether the system can.
    """
    stage = partial_path(target)
    stage.mkdir()
    try:
        with locked(stage):
            for name, content in files.items():
                (stage / name).parent.mkdir(parents=True, exist_ok=True)
                (stage / name).write_bytes(content)
            # Contents and subfolders must be on the disk before their names are valid, in case of a power failure.
            for path in (*files, *{os.path.dirname(name) for name in files}):
                sync(stage / path)
            is_placed = place(stage, target, {name.split("/")[0] for name in files})
        sync(target.parent)
        return is_placed
    finally:
        # If something still has this name, it is unfinished output, or the old folder after an exchange.
        remove(stage)


def _finish_journal(stage: Path, journal: Path, entries: set[str]) -> bool:
    """Rename the stage to the journal, which makes it valid, and move its entries into the folder around it."""
    os.rename(stage, journal)
    _move_entries(journal)
    return True


def _move_entries(journal: Path) -> None:
    """Move the entries of a journal into the folder around it. If this is interrupted, it can be repeated."""
    for entry in sorted(os.listdir(journal)):
        target = journal.parent / entry
        # os.replace replaces a file by a file in one step. It cannot replace a folder unless that is empty.
        if target.is_dir() or (journal / entry).is_dir():
            remove(target)
        os.replace(journal / entry, target)
    journal.rmdir()


def _put_in_place(stage: Path, folder: Path, entries: set[str]) -> bool:
    """Exchange the stage and the folder, after linking the folder's other entries into the stage.

    Returns False if the system cannot exchange folders.
    """
    if not folder.exists():
        os.rename(stage, folder)
        return True
    shutil.copymode(folder, stage)
    _link_others(folder, stage, entries)
    if not _exchange(stage, folder):
        return False
    # `stage` now names the old folder. Keep entries that another process put there since they were linked. If that
    # fails, the output is in place all the same.
    with contextlib.suppress(OSError):
        _link_others(stage, folder, entries)
    return True


def _link_others(source: Path, target: Path, entries: set[str]) -> None:
    """Link everything in ``source`` except ``entries`` into ``target``; files that are there already stay."""
    with os.scandir(source) as scanned:
        for entry in scanned:
            if entry.name in entries:
                continue
            link = target / entry.name
            if entry.is_dir(follow_symlinks=False):
                # Folders cannot be hard-linked: make a new one, and link the files.
                link.mkdir(exist_ok=True)
                _link_others(Path(entry.path), link, set())
                shutil.copystat(entry.path, link)
            elif not os.path.lexists(link):
                _link(entry.path, link)


def _link(path: str, link: Path) -> None:
    """Make a hard link to a file or, if the file system has no hard links, a copy."""
    try:
        os.link(path, link, follow_symlinks=False)
    except OSError:
        shutil.copy2(path, link, follow_symlinks=False)


def _must_stay(folder: Path) -> bool:
    """Return whether the folder cannot be exchanged.

    This is so if our working directory is inside it, if it is a mount point, or if its parent is not writable.
    """
    try:
        working_folder = Path.cwd()
    except FileNotFoundError:
        # The working directory was removed, so it is not inside the folder.
        working_folder = Path("/")
    return (
        working_folder.is_relative_to(folder)
        or os.path.ismount(folder)
        or not os.access(folder.parent, os.W_OK | os.X_OK)
    )


def _exchange(stage: Path, folder: Path) -> bool:
    """Exchange the names of two folders in one system call; return False if the system does not have it."""
    renameat2 = _renameat2()
    if renameat2 is None:
        return False
    paths = (_AT_FDCWD, os.fsencode(stage), _AT_FDCWD, os.fsencode(folder))
    if renameat2(*paths, _RENAME_EXCHANGE) == 0:
        return True
    code = ctypes.get_errno()
    # The kernel is too old, or the file system does not support it.
    if code in (errno.ENOSYS, errno.EINVAL, errno.EOPNOTSUPP):
        return False
    raise OSError(code, os.strerror(code))


@functools.cache
def _renameat2() -> Callable[..., int] | None:
    """Return the system call as a function of the C library, or None if the system does not have it."""
    if sys.platform != "linux":
        return None
    try:
        function = ctypes.CDLL(None, use_errno=True).renameat2
    except (OSError, AttributeError):
        return None
    function.argtypes = (
        ctypes.c_int,
        ctypes.c_char_p,
        ctypes.c_int,
        ctypes.c_char_p,
        ctypes.c_uint,
    )
    return function
