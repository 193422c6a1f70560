"""The files of a folder or zip archive of recordings: their bytes on request, and what their names say.

Folders and archives look the same to the readers: :class:`Members` lists names and sizes and returns the bytes of one
file, and nothing is unpacked to disk. The name of a file, with its folders, says whether it holds a recording or a set
of many, its part (train or test), its label or class, and its place in the order. The published EvTouch archives have
the members ``Ev-*/train/sample_<i>_label_<k>.npy`` and ``Ev-*/test/...``. A file of events is a recording whatever its
name, a ``.npy`` file if it is called ``sample_<i>.npy`` or ``sample_<i>_label_<k>.npy``.
"""

import re
import stat
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path, PurePosixPath

from hw_model.io.files import parsing, read_bytes
from hw_model.io.zip_directory import BoundedZip
from hw_model.values import Frozen
from locsnn_compile.data.class_names import number_order
from locsnn_compile.data.formats import (
    describing_suffixes,
    event_suffixes,
    set_suffixes,
    times_suffixes,
)
from locsnn_compile.data.tact import SLIP_CLASSES
from locsnn_compile.errors import InputError, check_most, did_you_mean

PARTS = ("train", "test")
#: The folder of files of times next to that of recordings, as VT_SNN has it.
TIMES = "traj_start_ends"
#: Largest number of recordings, bytes of one of them unpacked, and of all of them.
MAX_MEMBERS, MAX_MEMBER_BYTES, MAX_TOTAL_BYTES = 100_000, 100_000_000, 1_600_000_000

_ARRAY = re.compile(r"sample_\d{1,9}(?:_label_\d{1,6})?\.npy")
"""The name of an array of one recording."""
_LABEL = re.compile(r"_label_(\d{1,6})(?=\.|_|$)")
_NUMBERED = re.compile(r"(.+)_\d{1,9}\.tact")
"""The name of a raw recording of NeuTouch that begins with its class, as in ``stable_01.tact``."""
_NUMBER = re.compile(r"\d{1,18}")
_WORD = re.compile(r"[^\W\d_]+")
"""Letters between anything else: ``shd_train2`` has the words shd and train."""


def is_recording(name: str) -> bool:
    """Return whether a file of this name is read as a recording."""
    file = PurePosixPath(name)
    return file.suffix in event_suffixes() or _ARRAY.fullmatch(file.name) is not None


def _is_set(name: str) -> bool:
    """Return whether a file holds a set of many recordings.

    Its ending says so, or for a ``.npy`` a name with a part in it, such as ``train.npy``.
    """
    file = PurePosixPath(name)
    if file.name.startswith(".") or file.name.startswith("__"):
        return False  # Hidden files, such as macOS adds to archives.
    of_part = file.suffix == ".npy" and not file.stem.endswith("_labels") and part_in_name(name)
    return file.suffix in set_suffixes() or bool(of_part)


def recording_files(folder: Path) -> list[Path]:
    """Return the files of a folder that are read as its recordings, and their files of times."""
    files = [file for file in folder.rglob("*") if file.is_file()]
    recordings = [file for file in files if is_recording(file.name)]
    no_tables = [file for file in recordings if file.suffix not in describing_suffixes()]
    # A .csv file is a recording only in a folder without recordings of another kind. Next to these it
    # is a table about them, such as labels.csv.
    if no_tables or any(_is_set(file.name) for file in files):
        recordings = no_tables
    return recordings + [file for file in files if file.suffix in times_suffixes()]


def label_in_name(name: str) -> int | None:
    """Return k of ``..._label_<k>...`` in a file name, None if there is none."""
    match = _LABEL.search(name)
    return int(match[1]) if match else None


def part_of(name: str) -> str:
    """Return the part that a file lies in: the innermost folder called train or test, in any case; empty for none."""
    folders = [folder.lower() for folder in PurePosixPath(name).parent.parts]
    return next((folder for folder in reversed(folders) if folder in PARTS), "")


def part_in_name(name: str) -> str:
    """Return the part that is a word in the name of a file, as in ``shd_train.h5``; empty for none."""
    words = [word.lower() for word in _WORD.findall(PurePosixPath(name).stem)]
    return next((word for word in words if word in PARTS), "")


def part_of_set(name: str) -> str:
    """Return the part that a file of many recordings holds, by its name or its folder; empty for none."""
    return part_in_name(name) or part_of(name)


def in_turn(name: str) -> tuple[list[int], str]:
    """Return the key by which files are sorted: the numbers in a name, so that 2 comes before 10, then the name."""
    return [int(number) for number in _NUMBER.findall(PurePosixPath(name).stem)], name


def classes_of(names: list[str]) -> tuple[tuple[str, ...] | None, Callable[[str], str]]:
    """Return (the names of the classes or None, the function that returns the class of a file by its name).

    The folder of a file names its class, or else the file's own name.
    """
    # The first way that gives every file a class, and more than one class in all.
    for class_of in (_folder, _name_before_number):
        classes = {class_of(name) for name in names}
        if len(classes) > 1 and "" not in classes:
            return _ordered(classes), class_of
    return None, _folder


def _ordered(classes: set[str]) -> tuple[str, ...]:
    """Return the names of classes in their published order, or that of their numbers, or sorted."""
    if classes == set(SLIP_CLASSES):
        return SLIP_CLASSES
    return tuple(number_order(classes) or sorted(classes, key=in_turn))


def _folder(name: str) -> str:
    """Return the name of the folder that a file lies in; empty if that is a part, or if there is none."""
    folder = PurePosixPath(name).parent.name
    return "" if folder.lower() in PARTS else folder


def _name_before_number(name: str) -> str:
    """Return what precedes the number of a ``.tact`` file, as in ``stable_01.tact``; empty for other names."""
    match = _NUMBERED.fullmatch(PurePosixPath(name).name)
    return match[1] if match else ""


class Members(Frozen, eq=False):
    """The files of a folder or archive.

    - ``where``: what errors call the folder or archive; ``inside``: what errors say before the name of a file
    - ``sizes``: the size of each file in bytes, unpacked, by its name with forward slashes
    - ``read``: returns the bytes of the file of a name
    """

    where: str
    sizes: dict[str, int]
    read: Callable[[str], bytes]
    inside: str

    @property
    def recordings(self) -> list[str]:
        """The files that are read as recordings, of all parts; see :func:`recording_files` for tables."""
        names = [name for name in self.sizes if is_recording(name)]
        no_tables = [name for name in names if not name.endswith(describing_suffixes())]
        if no_tables or any(map(_is_set, self.sizes)):
            return no_tables
        return names

    @property
    def sets(self) -> list[str]:
        """The files that hold many recordings, sorted; empty if any file holds a single recording.

        If some of them belong to a part, those without a part are left out.
        """
        if self.recordings:
            return []
        sets = [name for name in self.sizes if _is_set(name)]
        divided = [name for name in sets if part_of_set(name)]
        return sorted(divided or sets, key=in_turn)

    def sets_of_part(self, part: str | None) -> list[str]:
        """Return the files of many recordings of a part, or of all parts if None, sorted."""
        return [name for name in self.sets if part in (None, part_of_set(name))]

    @property
    def parts(self) -> tuple[str, ...]:
        """Which of ``train`` and ``test`` it has; empty if it is not divided."""
        occurring = {*map(part_of, self.recordings), *map(part_of_set, self.sets)}
        return tuple(part for part in PARTS if part in occurring)

    def known_part(self, part: str | None) -> str | None:
        """Return ``part``, or if None the last part that there is (``test`` if both), or None if there are no parts.

        Raises ``InputError`` for a part that there is not.
        """
        parts = self.parts
        if part is None:
            return parts[-1] if parts else None
        if part not in parts:
            has = f"it has {' and '.join(parts)}" if parts else "it is not divided"
            undivided = "Leave the part out, or divide it by --split."
            fix = did_you_mean(part, parts) if parts else undivided
            raise InputError(self.where, f"there is no part {part!r}", measured=has, fix=fix)
        return part

    def of_part(self, part: str | None) -> list[str]:
        """Return the recordings of a part, or of all parts if None, sorted."""
        return sorted(
            (name for name in self.recordings if part in (None, part_of(name))), key=in_turn
        )

    @property
    def other_arrays(self) -> list[str]:
        """The ``.npy`` files, except hidden ones, that are not read as recordings because of their names."""
        files = {name: PurePosixPath(name) for name in self.sizes if not is_recording(name)}
        return [
            name for name, file in files.items() if file.suffix == ".npy" and file.name[0] != "."
        ]

    def place(self, name: str) -> str:
        """Return how errors name a file."""
        return f"{self.inside}{PurePosixPath(name).name!r}"

    def check_total(self, names: list[str]) -> None:
        """Refuse files that are too large together, before any is read."""
        total = sum(self.sizes[name] for name in names)
        what = "its recordings are too large together"
        check_most(total, MAX_TOTAL_BYTES, self.where, what, fix="Give fewer.")

    def check_sizes(self, names: list[str]) -> None:
        """Refuse recordings that are too many or too large, before any is read."""
        check_most(
            len(names), MAX_MEMBERS, self.where, "it holds too many recordings", fix="Give fewer."
        )
        self.check_total(names)
        for name in names:
            size, fix = self.sizes[name], "Give one recording."
            check_most(
                size, MAX_MEMBER_BYTES, self.place(name), "it is too large", unit="bytes", fix=fix
            )


@contextmanager
def open_members(path: Path) -> Iterator[Members]:
    """Yield the files of an archive, of a folder, or of a single file of events together with its file of times.

    Raises ``InputError`` for an archive that is damaged, holds a name twice, or holds a link.
    """
    if path.suffix != ".zip" or path.is_dir():
        yield _plain_files(path)
        return
    where, fix = f"archive {path.name!r}", "Fetch the archive again."
    try:
        stream = path.open("rb")
    except OSError as error:
        raise InputError(
            where, "it cannot be read", measured=error.strerror or "", fix="Check the path."
        ) from None
    with stream:
        with parsing(where, "it is damaged, truncated or not a zip archive", fix=fix):
            archive = BoundedZip(stream, where, fix)

        def read(name: str) -> bytes:
            with parsing(f"{where}, {PurePosixPath(name).name!r}", "it is damaged", fix=fix):
                return archive.content(name)

        entries = [entry for entry in archive.infolist() if not entry.filename.endswith("/")]
        if links := [
            entry.filename for entry in entries if stat.S_ISLNK(entry.external_attr >> 16)
        ]:
            what = f"{links[0][:80]!r} is a link, and links are not followed"
            raise InputError(where, what, fix="Store the file itself.")
        yield Members(
            where, {entry.filename: entry.file_size for entry in entries}, read, f"{where}, "
        )


def _plain_files(path: Path) -> Members:
    """Return the files of a folder, or a single file and its file of times.

    Files of times may also lie in a folder :data:`TIMES` next to the folder of the recordings.
    """
    folder = path.absolute() if path.is_dir() else path.absolute().parent
    near = sorted((folder.parent / TIMES).glob("*"))
    times = {f"{TIMES}/{file.name}": file for file in near if file.suffix in times_suffixes()}
    if path.is_dir():
        where, inside = f"folder {path.name!r}", f"folder {path.name!r}, "
        files = {
            file.relative_to(path).as_posix(): file
            for file in sorted(path.rglob("*"))
            if file.is_file()
        }
    else:
        where, inside = f"file {path.name!r}", "file "
        beside = [path.with_suffix(suffix) for suffix in times_suffixes()]
        files = {file.name: file for file in (path, *beside) if file.exists()}
    files = times | files
    sizes = {name: file.stat().st_size for name, file in files.items()}
    return Members(
        where, sizes, lambda name: read_bytes(files[name], f"{inside}{files[name].name!r}"), inside
    )
