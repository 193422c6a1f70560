"""What a command reads and writes: no output may replace an input or another output."""

import os
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

from hw_model.errors import InputError
from hw_model.io.files import check_file
from hw_model.io.given import check_path
from locsnn_compile.data.members import recording_files

Place = tuple[str, Path]
"""An option as messages show it, and the path that it writes: a file, or a folder that is replaced as a whole."""


def check_places(
    reads: Mapping[str, str | Path | None], files: Sequence[Place], entries: Sequence[Place] = ()
) -> None:
    """Refuse outputs that would replace what the command reads, and files that cannot be written.

    ``reads``: the files and folders to read, by option; a folder stands for the recordings in it. ``entries``: what is
    written into the folder of ``-o``, which has a check of its own. Two paths are equal if they lead to the same file,
    through links or under other names.
    """
    inputs = [
        (option, Path(path_given)) for option, path_given in reads.items() if path_given is not None
    ]
    for option, path in inputs:
        check_path(path, f"{option} {path.name[:60]!r}")
    known = {_identity(file): option for option, path in inputs for file in _read_of(path)}
    known.pop(None, None)
    taken: dict[str, str] = {}
    for option, path in entries:
        taken[os.path.realpath(path)] = f"{option} writes {path.name!r} there"
    for option, path in files:
        check_path(path, option)
        if path.is_dir():
            check_file(path, option)
    for option, path in (*files, *entries):
        target = os.path.realpath(path)
        inside = [reader for reader, read in inputs if _lies_in(os.path.realpath(read), target)]
        reader = known.get(_identity(path)) or next(iter(inside), None)
        if reader is not None:
            raise InputError(
                option,
                f"it would overwrite {path.name!r}",
                measured=reader,
                fix="Write somewhere else.",
            )
    for option, path in files:
        target = os.path.realpath(path)
        other = next(
            (sentence for place, sentence in taken.items() if _lies_in(target, place)), None
        )
        if other is not None:
            raise InputError(option, other, fix="Write somewhere else.")
        check_file(Path(target), option)
        taken[target] = f"{option} is written there"


def _read_of(path: Path) -> Iterable[Path]:
    """Return the files that are read for a path: the file itself, or the recordings in a folder."""
    if path.is_dir():
        return recording_files(path)
    return (
        (path, path.with_name(f"{path.stem}_labels.npy"), path.with_suffix(".startend"))
        if path.name
        else ()
    )


def _identity(path: Path) -> tuple[int, int] | None:
    """Return what identifies a file under any of its names; None if there is no such file."""
    try:
        status = path.stat()
    except OSError:
        return None
    return status.st_dev, status.st_ino


def _lies_in(path: str, folder: str) -> bool:
    return path == folder or path.startswith(folder.rstrip(os.sep) + os.sep)
