"""Checks, before any work, that no output of a command replaces an input or another output.

A command that ran for an hour must not end by overwriting its own model. Every command that writes
calls :func:`check_places` first, with the paths of its options.
"""

import os
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

from hw_model.errors import InputError
from hw_model.io.arguments import check_path
from hw_model.io.files import check_file
from locsnn_compile.data.members import recording_files

Place = tuple[str, Path]
"""An option as messages show it, and the path that it writes: a file, or a folder that is replaced as a whole."""
_Identity = tuple[int, int]
"""The device and the inode of a file: equal for all names and links of one file."""


def check_places(
    reads: Mapping[str, str | Path | None], files: Sequence[Place], entries: Sequence[Place] = ()
) -> None:
    """Refuse outputs that would replace what the command reads, and files that cannot be written.

    - ``reads``: the files and folders to read, by option; a folder stands for the recordings in it
    - ``files``: single files to write
    - ``entries``: what is written into the folder of ``-o``; that the folder can be written is
      checked elsewhere (``check_folder``)

    Two paths are equal if they lead to the same file, through links or under other names.
    """
    inputs = [(option, Path(path)) for option, path in reads.items() if path is not None]
    for option, path in inputs:
        check_path(path, f"{option} {path.name[:60]!r}")
    option_of_file = _option_of_each_file(inputs)
    for option, path in files:
        check_path(path, option)
        if path.is_dir():
            check_file(path, option)  # raises: a folder is not a file
    _check_inputs_stay(inputs, option_of_file, [*files, *entries])
    _check_outputs_differ(files, entries)


def _option_of_each_file(inputs: Sequence[Place]) -> dict[_Identity, str]:
    """Return the option that reads each file that exists."""
    option_of_file: dict[_Identity, str] = {}
    for option, path in inputs:
        for file in _files_read_for(path):
            identity = _identity(file)
            if identity is not None:
                option_of_file[identity] = option
    return option_of_file


def _check_inputs_stay(
    inputs: Sequence[Place], option_of_file: Mapping[_Identity, str], outputs: Sequence[Place]
) -> None:
    """Refuse an output that is a file of an input, or a folder that holds one."""
    for option, path in outputs:
        target = os.path.realpath(path)
        identity = _identity(path)
        reader = None if identity is None else option_of_file.get(identity)
        if reader is None:
            # An output folder is replaced as a whole, with all that lies in it.
            replaced = (name for name, read in inputs if _lies_in(os.path.realpath(read), target))
            reader = next(replaced, None)
        if reader is not None:
            raise InputError(
                option,
                f"it would overwrite {path.name!r}",
                measured=reader,
                fix="Write somewhere else.",
            )


def _check_outputs_differ(files: Sequence[Place], entries: Sequence[Place]) -> None:
    """Refuse a file that is, or lies in, another output, and one that cannot be written."""
    sentence_of_output: dict[str, str] = {}
    for option, path in entries:
        sentence_of_output[os.path.realpath(path)] = f"{option} writes {path.name!r} there"
    for option, path in files:
        target = os.path.realpath(path)
        for output, sentence in sentence_of_output.items():
            if _lies_in(target, output):
                raise InputError(option, sentence, fix="Write somewhere else.")
        check_file(Path(target), option)
        sentence_of_output[target] = f"{option} is written there"


def _files_read_for(path: Path) -> Iterable[Path]:
    """Return the files that are read for a path: the recordings in a folder, or the file itself.

    In some formats its labels, or the times at which the phases of a touch begin (``.startend``),
    lie in a file next to it, which is read with it.
    """
    if path.is_dir():
        return recording_files(path)
    if not path.name:  # such as "/", which has no file next to it
        return ()
    return (path, path.with_name(f"{path.stem}_labels.npy"), path.with_suffix(".startend"))


def _identity(path: Path) -> _Identity | None:
    """Return what identifies a file under any of its names; None if there is no such file."""
    try:
        status = path.stat()
    except OSError:
        return None
    return status.st_dev, status.st_ino


def _lies_in(path: str, folder: str) -> bool:
    """Return whether ``path`` is ``folder`` or lies below it; both are real paths."""
    # With the separator, /data/ab does not lie in /data/a; stripped first, because / ends in one.
    return path == folder or path.startswith(folder.rstrip(os.sep) + os.sep)
