"""Folders replaced as a whole: a process that is killed at any moment leaves either the old output or the new.

The new folder is written next to the old one, with the old one's other entries linked into it. Then both change places
in one system call (``renameat2``). If the system does not have it, or the folder must stay where it is, because it is a
mount point or somebody's working directory, it gets its entries one by one from a journal inside it, which
:func:`recover_folder` completes.
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
"""Folder of entries that belong into the folder around it: once it has this name, they are the output."""

# Constants of Linux: paths are relative to the working directory; both paths must exist and change places.
_AT_FDCWD = -100
_RENAME_EXCHANGE = 2


def replace_entries(folder: Path, files: Mapping[str, bytes], ours: str = ".*") -> None:
    """Write files into a folder, all or none; everything else in it stays. After an ``OSError`` it is as it was.

    A name may lie in a folder, as in ``vectors/manifest.yaml``. Such a folder replaces the previous one as a whole, if
    all names in that match the pattern ``ours``. Files only replace files, and folders only replace folders.
    """
    folder = Path(os.path.realpath(folder))
    folder.parent.mkdir(parents=True, exist_ok=True)
    recover_folder(folder)
    check_entries(folder, {_entry_of(name) for name in files}, ours)
    for target in (folder, folder / JOURNAL):
        remove_leftovers(target)
    may_change_places = not (folder.exists() and _must_stay(folder))
    if not (may_change_places and _write_and_place(folder, files, _put_in_place)):
        _write_and_place(folder / JOURNAL, files, _finish_journal)
    note_written(folder)


def _entry_of(name: str) -> str:
    """Return the entry of a folder in which a file lies; a folder in it ends in /."""
    entry, slash, _ = name.partition("/")
    return entry + slash


def check_entries(folder: Path, names: Iterable[str], ours: str = ".*") -> None:
    """Raise ``OSError`` if writing entries would remove foreign files; entries that end in / are folders."""
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
    """Raise ``OSError`` for a file below an entry whose name in the folder does not match ``ours``."""
    for path in sorted(entry.rglob("*")):
        # A folder is judged by what is in it, but a link to one is an entry of its own.
        if path.is_dir() and not path.is_symlink():
            continue
        name = path.relative_to(folder).as_posix()
        if not re.fullmatch(ours, name):
            raise OSError(
                errno.EEXIST,
                f"it holds {name!r}, which was not written here and would be removed",
            )


def recover_folder(folder: Path) -> None:
    """Finish what a killed process began: complete a journal."""
    folder = Path(os.path.realpath(folder))
    if (folder / JOURNAL).is_dir():
        _move_entries(folder / JOURNAL)


def finish_writing(folder: Path) -> None:
    """Recover a folder before it is read; one that may not be written is read as it is."""
    with contextlib.suppress(OSError):
        recover_folder(folder)


def _write_and_place(
    target: Path, files: Mapping[str, bytes], place: Callable[[Path, Path, set[str]], bool]
) -> bool:
    """Write files into a stage, a new folder next to ``target``, and put it there; tell whether that could be done.

    ``place`` takes the stage, the target and the entries of the stage, and puts the first in the place of the second.
    """
    stage = partial_path(target)
    stage.mkdir()
    try:
        with locked(stage):
            for name, content in files.items():
                (stage / name).parent.mkdir(parents=True, exist_ok=True)
                (stage / name).write_bytes(content)
            # Names are put in place only once the contents are on the disk.
            for path in (*files, *{os.path.dirname(name) for name in files}):
                sync(stage / path)
            is_placed = place(stage, target, {name.split("/")[0] for name in files})
        sync(target.parent)
        return is_placed
    finally:
        # What is left of it is unfinished, or the old output that it has changed places with.
        remove(stage)


def _finish_journal(stage: Path, journal: Path, entries: set[str]) -> bool:
    """Make the stage the journal of the folder around it, from which on it is valid, and move its entries there."""
    os.rename(stage, journal)
    _move_entries(journal)
    return True


def _move_entries(journal: Path) -> None:
    """Move the entries of a journal to where they belong; this can be interrupted and repeated."""
    for entry in sorted(os.listdir(journal)):
        target = journal.parent / entry
        # A file replaces a file at once; a folder cannot, unless it is empty.
        if target.is_dir() or (journal / entry).is_dir():
            remove(target)
        os.replace(journal / entry, target)
    journal.rmdir()


def _put_in_place(stage: Path, folder: Path, entries: set[str]) -> bool:
    """Let the stage and the folder change places, with the other entries of the folder in both; False if it cannot."""
    if not folder.exists():
        os.rename(stage, folder)
        return True
    shutil.copymode(folder, stage)
    _link_others(folder, stage, entries)
    if not _exchange(stage, folder):
        return False
    # Keep what came into the old folder meanwhile; if that fails, the new folder is in place all the same.
    with contextlib.suppress(OSError):
        _link_others(stage, folder, entries)
    return True


def _link_others(source: Path, target: Path, entries: set[str]) -> None:
    """Link everything in ``source`` except ``entries`` into ``target``; what is there already stays."""
    with os.scandir(source) as scanned:
        for entry in scanned:
            if entry.name in entries:
                continue
            link = target / entry.name
            if entry.is_dir(follow_symlinks=False):
                # A folder cannot have two names: it is made again, and its files are linked.
                link.mkdir(exist_ok=True)
                _link_others(Path(entry.path), link, set())
                shutil.copystat(entry.path, link)
            elif not os.path.lexists(link):
                _link(entry.path, link)


def _link(path: str, link: Path) -> None:
    try:
        os.link(path, link, follow_symlinks=False)
    except OSError:
        # The file system has no hard links.
        shutil.copy2(path, link, follow_symlinks=False)


def _must_stay(folder: Path) -> bool:
    """Tell whether no other folder can take its place: we are in it, it is a mount point, or its parent is closed."""
    try:
        working_folder = Path.cwd()
    except FileNotFoundError:
        # It was removed, so we are in no folder.
        working_folder = Path("/")
    return (
        working_folder.is_relative_to(folder)
        or os.path.ismount(folder)
        or not os.access(folder.parent, os.W_OK | os.X_OK)
    )


def _exchange(stage: Path, folder: Path) -> bool:
    """Let two folders change places in one system call; False if the system does not have it."""
    renameat2 = _renameat2()
    if renameat2 is None:
        return False
    paths = (_AT_FDCWD, os.fsencode(stage), _AT_FDCWD, os.fsencode(folder))
    if renameat2(*paths, _RENAME_EXCHANGE) == 0:
        return True
    code = ctypes.get_errno()
    # The kernel is too old, or the file system cannot do it.
    if code in (errno.ENOSYS, errno.EINVAL, errno.EOPNOTSUPP):
        return False
    raise OSError(code, os.strerror(code))


@functools.cache
def _renameat2() -> Callable[..., int] | None:
    """Return the system call as a function of the C library; None where there is none."""
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
