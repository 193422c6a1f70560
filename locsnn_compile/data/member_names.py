"""What the name of a file says of the recording in it: whether it holds one, its part, its label, its class, its turn.

The published EvTouch archives have the members ``Ev-*/train/sample_<i>_label_<k>.npy`` and ``Ev-*/test/...``. A file of
events is a recording whatever its name, a ``.npy`` file if it is called ``sample_<i>.npy`` or
``sample_<i>_label_<k>.npy``.
"""

import re
from collections.abc import Callable, Iterable
from pathlib import Path, PurePosixPath

from locsnn_compile.data.tact import SLIP_CLASSES

PARTS = ("train", "test")
EVENT_SUFFIXES = (".tact", ".bs1", ".bs2", ".bin", ".aedat4")

_ARRAY = re.compile(r"sample_\d{1,9}(?:_label_\d{1,6})?\.npy")
_LABEL = re.compile(r"_label_(\d{1,6})(?=\.|_|$)")
_NUMBERED = re.compile(r"(.+)_\d{1,9}\.tact")
_NUMBER = re.compile(r"\d{1,18}")


def is_recording(name: str) -> bool:
    """Tell whether a file is read as a recording."""
    file = PurePosixPath(name)
    return file.suffix in EVENT_SUFFIXES or _ARRAY.fullmatch(file.name) is not None


def other_arrays(names: Iterable[str]) -> list[str]:
    """Return arrays that are not read as recordings, because of their names; hidden files, as of macOS, are none."""
    files = {name: PurePosixPath(name).name for name in names}
    return [name for name, file in files.items() if file.endswith(".npy") and file[0] != "." and not is_recording(file)]


def recording_files(folder: Path) -> list[Path]:
    """Return the files of a folder that are read as its recordings."""
    return [f for f in folder.rglob("*") if (is_recording(f.name) or f.suffix == ".startend") and f.is_file()]


def label_in_name(name: str) -> int | None:
    """Return k of ``..._label_<k>...`` in a file name, None if there is none."""
    match = _LABEL.search(name)
    return int(match[1]) if match else None


def part_of(name: str) -> str:
    """Return the part that a file lies in: the innermost folder called train or test, in any case; empty for none."""
    folders = [folder.lower() for folder in PurePosixPath(name).parent.parts]
    return next((folder for folder in reversed(folders) if folder in PARTS), "")


def in_turn(name: str) -> tuple[list[int], str]:
    """Return what files are sorted by: the numbers in a file's name, so that 2 comes before 10, then the whole name."""
    return [int(number) for number in _NUMBER.findall(PurePosixPath(name).stem)], name


def classes_of(names: list[str]) -> tuple[tuple[str, ...] | None, Callable[[str], str]]:
    """Return the names of the classes, None without any, and the function that returns the class of a file.

    The folder of a file names its class, or else the file's own name.
    """
    for class_of in (_folder, _name_before_number):
        found = sorted({class_of(name) for name in names}, key=in_turn)
        if len(found) > 1 and "" not in found:
            return SLIP_CLASSES if set(found) == set(SLIP_CLASSES) else tuple(found), class_of
    return None, _folder


def _folder(name: str) -> str:
    """Return the name of the folder that a file lies in; empty if that is a part, or if there is none."""
    folder = PurePosixPath(name).parent.name
    return "" if folder.lower() in PARTS else folder


def _name_before_number(name: str) -> str:
    """Return what precedes the number of a ``.tact`` file, as in ``stable_01.tact``; empty for other names."""
    match = _NUMBERED.fullmatch(PurePosixPath(name).name)
    return match[1] if match else ""
