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
_AT_FDCWD, _RENAME_EXCHANGE = -100, 2


def replace_entries(folder: Path, files: Mapping[str, bytes], ours: str = ".*") -> None:
    """Write files into a folder, all or none; everything else in it stays. After an ``OSError`` it is as it was.

    A name may lie in a folder, as in ``vectors/manifest.yaml``. Such a folder replaces the previous one as a whole, if
    all names in that match the pattern ``ours``. Files only replace files, and folders only replace folders.
    """
    folder = Path(os.path.realpath(folder))
    folder.parent.mkdir(parents=True, exist_ok=True)
    recover_folder(folder)
    check_entries(folder, {name.split("/")[0] + "/" * ("/" in name) for name in files}, ours)
    for target in (folder, folder / JOURNAL):
        remove_leftovers(target)
    if (folder.exists() and _must_stay(folder)) or not _write_and(folder, files, _put_in_place):
        _write_and(folder / JOURNAL, files, _finish_journal)
    note_written(folder)


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
        for file in sorted(entry.rglob("*")) if name.endswith("/") and entry.is_dir() else ():
            inside = file.relative_to(folder).as_posix()
            if not (re.fullmatch(ours, inside) or (file.is_dir() and not file.is_symlink())):
                raise OSError(
                    errno.EEXIST,
                    f"it holds {inside!r}, which was not written here and would be removed",
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


def _write_and(
    target: Path, files: Mapping[str, bytes], place: Callable[[Path, Path, set[str]], bool]
) -> bool:
    """Write the files into a stage next to ``target``, and place it there; tell whether that could be done."""
    stage = partial_path(target)
    stage.mkdir()
    try:
        with locked(stage):
            for name, content in files.items():
                (stage / name).parent.mkdir(parents=True, exist_ok=True)
                (stage / name).write_bytes(content)
            for path in (*files, *{os.path.dirname(name) for name in files}):
                sync(stage / path)
            placed = place(stage, target, {name.split("/")[0] for name in files})
        sync(target.parent)
        return placed
    finally:
        remove(stage)


def _finish_journal(stage: Path, journal: Path, entries: set[str]) -> bool:
    os.rename(stage, journal)
    _move_entries(journal)
    return True


def _move_entries(journal: Path) -> None:
    """Move the entries of a journal to where they belong; this can be interrupted and repeated."""
    for entry in sorted(os.listdir(journal)):
        target = journal.parent / entry
        if target.is_dir() or (journal / entry).is_dir():
            remove(target)
        os.replace(journal / entry, target)
    journal.rmdir()


def _put_in_place(stage: Path, folder: Path, entries: set[str]) -> bool:
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
    """Link everything in ``source`` except ``entries`` into ``target``."""
    with os.scandir(source) as found:
        for entry in found:
            other = target / entry.name
            if entry.is_dir(follow_symlinks=False):
                if entry.name not in entries:
                    other.mkdir(exist_ok=True)
                    _link_others(Path(entry.path), other, set())
                    shutil.copystat(entry.path, other)
            elif entry.name not in entries and not os.path.lexists(other):
                _link(entry.path, other)


def _link(path: str, other: Path) -> None:
    try:
        os.link(path, other, follow_symlinks=False)
    except OSError:
        # The file system has no hard links.
        shutil.copy2(path, other, follow_symlinks=False)


def _must_stay(folder: Path) -> bool:
    """Tell whether no other folder can take its place: it is a mount point, its parent is closed, or we are in it."""
    try:
        here = Path.cwd()
    except FileNotFoundError:
        here = Path("/")
    return (
        here.is_relative_to(folder)
        or os.path.ismount(folder)
        or not os.access(folder.parent, os.W_OK | os.X_OK)
    )


def _exchange(one: Path, other: Path) -> bool:
    """Let two folders change places in one system call; False if the system does not have it."""
    renameat2 = _renameat2()
    if renameat2 is None:
        return False
    paths = (os.fsencode(one), os.fsencode(other))
    if renameat2(_AT_FDCWD, paths[0], _AT_FDCWD, paths[1], _RENAME_EXCHANGE) == 0:
        return True
    code = ctypes.get_errno()
    if code in (errno.ENOSYS, errno.EINVAL, errno.EOPNOTSUPP):
        return False
    raise OSError(code, os.strerror(code))


@functools.cache
def _renameat2() -> Callable[..., int] | None:
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
