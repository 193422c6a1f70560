"""One recording a file, in a zip archive or a folder: ``.npy``, ``.bs1``, ``.bs2`` or ``.tact``.

The published EvTouch archives have the members ``Ev-*/train/sample_<i>_label_<k>.npy`` and ``Ev-*/test/...``; each is
one recording, (taxels, polarities, steps). They are read where they lie and sorted by their sample number: nothing is
unpacked to disk, and sizes come first.
``.npy`` files are recordings where they are named ``sample_<i>.npy`` or ``sample_<i>_label_<k>.npy``, files of events
whatever they are called.
"""

import re
import stat
import zipfile
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path, PurePosixPath

import numpy as np

from hw_model.io.files import read_bytes
from hw_model.io.zip_directory import check_directory, read_entry
from hw_model.values import ByteArray, Frozen
from locsnn_compile.data.aedat4 import parse_aedat4
from locsnn_compile.data.arrays import label_in_name, load_npy
from locsnn_compile.data.axes import to_step_major
from locsnn_compile.data.event_formats import EVENT_BYTES, parse_slayer_events, parse_structured
from locsnn_compile.data.event_stream import MAX_EVENTS, Binning, EventStream, bin_streams
from locsnn_compile.data.recordings import MAX_ELEMENTS, Binned, Recordings, clean_spikes
from locsnn_compile.data.tact import SLIP_CLASSES, parse_tact
from locsnn_compile.errors import InputError, check_most, did_you_mean

#: The folder of ``.startend`` files next to that of recordings, as VT_SNN has it.
TIMES = "traj_start_ends"
#: Largest number of recordings, bytes of one of them unpacked, and of all of them.
MAX_MEMBERS, MAX_MEMBER_BYTES, MAX_TOTAL_BYTES = 100_000, 100_000_000, 1_600_000_000
PARTS = ("train", "test")
EVENT_SUFFIXES = (".tact", ".bs1", ".bs2", ".bin", ".aedat4")
#: Largest text of one recording: about 600,000 events.
MAX_TEXT_BYTES = 10_000_000

_ARRAY = re.compile(r"sample_\d{1,9}(?:_label_\d{1,6})?\.npy")
_NUMBERED = re.compile(r"(.+)_\d{1,9}\.tact")
_NUMBER = re.compile(r"\d{1,18}")


class Members(Frozen, eq=False):
    """``sizes`` of the files by name, unpacked and with forward slashes; ``read`` gives the bytes of one."""

    where: str
    sizes: dict[str, int]
    read: Callable[[str], bytes]
    inside: str
    """What errors say before the name of a file."""

    def place(self, name: str) -> str:
        """Return how errors name a file."""
        return f"{self.inside}{PurePosixPath(name).name!r}"

    def check_sizes(self, names: list[str]) -> None:
        """Refuse files that are too many or too large, before any is read."""
        total = sum(self.sizes[name] for name in names)
        check_most(len(names), MAX_MEMBERS, self.where, "it holds too many recordings", fix="Give fewer.")
        check_most(total, MAX_TOTAL_BYTES, self.where, "its recordings are too large together", fix="Give fewer.")
        for name in names:
            size, fix = self.sizes[name], "Give one recording."
            check_most(size, MAX_MEMBER_BYTES, self.place(name), "it is too large", unit="bytes", fix=fix)


@contextmanager
def open_members(path: Path) -> Iterator[Members]:
    """Open a folder, an archive or one file of events, as a folder of it and the ``.startend`` file next to it.

    Raises ``InputError`` for an archive that is damaged, or holds a name twice.
    """
    if path.suffix != ".zip" or path.is_dir():
        yield _plain_files(path)
        return
    where = f"archive {path.name!r}"
    fix = "Fetch the archive again."
    try:
        with path.open("rb") as stream:
            check_directory(stream)
        archive = zipfile.ZipFile(path)
    except OSError as error:
        raise InputError(where, "it cannot be read", measured=error.strerror or "", fix="Check the path.") from None
    # zipfile raises more kinds on hostile bytes than it documents.
    except Exception:
        raise InputError(where, "it is damaged, truncated or not a zip archive", fix=fix) from None

    def read(name: str) -> bytes:
        try:
            return read_entry(archive, archive.getinfo(name))
        except Exception:
            raise InputError(f"{where}, {PurePosixPath(name).name!r}", "it is damaged", fix=fix) from None

    with archive:
        files_inside = [member for member in archive.infolist() if not member.filename.endswith("/")]
        twice = [name for name, count in Counter(member.filename for member in files_inside).items() if count > 1]
        if twice:
            raise InputError(where, f"it holds {twice[0][:80]!r} twice", fix=fix)
        links = [member.filename for member in files_inside if stat.S_ISLNK(member.external_attr >> 16)]
        if links:
            what = f"{links[0][:80]!r} is a link, and links are not followed"
            raise InputError(where, what, fix="Store the file itself.")
        yield Members(where, {member.filename: member.file_size for member in files_inside}, read, f"{where}, ")


def _plain_files(path: Path) -> Members:
    """Return the files of a folder, or a file and the one next to it, and those of the folder of times next to it."""
    folder = path.absolute() if path.is_dir() else path.absolute().parent
    times = {f"{TIMES}/{file.name}": file for file in sorted((folder.parent / TIMES).glob("*.startend"))}
    if path.is_dir():
        where, inside = f"folder {path.name!r}", f"folder {path.name!r}, "
        files = {file.relative_to(path).as_posix(): file for file in sorted(path.rglob("*")) if file.is_file()}
    else:
        where, inside = f"file {path.name!r}", "file "
        files = {file.name: file for file in (path, path.with_suffix(".startend")) if file.exists()}
    files = times | files
    sizes = {name: file.stat().st_size for name, file in files.items()}
    return Members(where, sizes, lambda name: read_bytes(files[name], f"{inside}{files[name].name!r}"), inside)


def archive_parts(path: Path) -> tuple[str, ...]:
    """Return which of ``train`` and ``test`` the archive or folder has; empty where it is not divided."""
    with open_members(path) as members:
        found = {_part(name) for name in members.sizes if _is_recording(name)}
    return tuple(part for part in PARTS if part in found)


def recording_files(folder: Path) -> list[Path]:
    """Return the files of a folder that are read as its recordings."""
    return [f for f in folder.rglob("*") if (_is_recording(f.name) or f.suffix == ".startend") and f.is_file()]


def read_archive(path: Path, *, split: str | None, binning: Binning) -> Recordings:
    """Return one part of a ``.zip`` archive or of a folder of recordings, with labels where every name has one.

    A file of events is a folder of one. All are as long as the longest: the others are followed by silence.
    ``split`` is a part; None takes ``test`` of a divided archive and everything of one that is not. Where names have
    no labels, the folders that recordings lie in are their classes, if there are several. Raises ``InputError`` for a
    damaged archive or member, members of different shapes, and nothing to read.
    """
    with open_members(path) as members:
        names = _chosen(members, split)
        members.check_sizes(names)
        spikes, seconds, binned = _read(members, names, binning)
        # Of all parts: a class may be missing from one.
        files = [name for name in members.sizes if _is_recording(name)]
    labels = [label_in_name(PurePosixPath(name).name) for name in names]
    class_names, class_of = _classes(files)
    if class_names is not None and not any(label is not None for label in labels):
        labels = [class_names.index(class_of(name)) for name in names]
    else:
        class_names = None
    held = None if None in labels else np.array(labels, dtype=np.int64)
    return Recordings(spikes, held, seconds, path.name, binned=binned, class_names=class_names)


def _classes(files: list[str]) -> tuple[tuple[str, ...] | None, Callable[[str], str]]:
    """Return the names of classes, None without any, and what tells that of a file: its folder, or its own name."""
    for class_of in (_folder, _name_before_number):
        found = sorted({class_of(name) for name in files}, key=_order)
        if len(found) > 1 and "" not in found:
            return SLIP_CLASSES if set(found) == set(SLIP_CLASSES) else tuple(found), class_of
    return None, _folder


def _chosen(members: Members, split: str | None) -> list[str]:
    """Return the names of the recordings of a part, in order."""
    names = [name for name in members.sizes if _is_recording(name)]
    parts = [part for part in PARTS if any(_part(name) == part for name in names)]
    if split is None and parts:
        split = "test" if "test" in parts else parts[0]
    if split is not None and split not in parts:
        has = f"it has {' and '.join(parts)}" if parts else "it is not divided"
        fix = did_you_mean(split, parts or PARTS)
        raise InputError(members.where, f"there is no part {split!r}", measured=has, fix=fix)
    chosen = [name for name in names if split is None or _part(name) == split]
    kinds = sorted({PurePosixPath(name).suffix for name in chosen})
    if not chosen:
        raise InputError(members.where, "no recordings inside", fix="Give files named sample_<i>_label_<k>.npy.")
    if len(kinds) > 1:
        raise _several(members, ", ".join(kinds))
    return sorted(chosen, key=_order)


def _several(members: Members, kinds: str) -> InputError:
    return InputError(members.where, "its recordings are of several kinds", measured=kinds, fix="Give those of one.")


def _order(name: str) -> tuple[list[int], str]:
    # By the numbers of the file's name: 2 before 10.
    return [int(number) for number in _NUMBER.findall(PurePosixPath(name).stem)], name


def _read(members: Members, names: list[str], binning: Binning) -> tuple[ByteArray, float | None, Binned | None]:
    """Return the spikes, the width of a bin where it is known, and what binning left out."""
    streams: list[EventStream] = []
    arrays: list[ByteArray] = []
    for name in names:
        place, suffix = members.place(name), PurePosixPath(name).suffix
        if suffix in EVENT_SUFFIXES:
            streams.append(_events(members, name, place))
            continue
        array = load_npy(members.read(name), place)
        if array.dtype.names is not None:
            streams.append(parse_structured(array, place))
        else:
            array = to_step_major(array, place, binning.channels, binning.axes)
            if len(array) != 1:
                fix = "Give one a file."
                raise InputError(place, "it is not one recording", measured=f"{len(array)} inside", fix=fix)
            arrays.append(clean_spikes(place, array)[0])
            _check_fits(arrays, len(names), members.where, place)
    if not arrays:
        spans = [one.span_seconds for one in streams]
        if None in spans and set(spans) != {None}:
            place, what = members.place(names[spans.index(None)]), "there is no .startend file of it, but of others"
            raise InputError(place, what, fix=f"Give it in folder {TIMES!r}, or leave the recording out.")
        return bin_streams(streams, [members.place(name) for name in names], members.where, binning)
    if streams:
        raise _several(members, "binned arrays and structured ones")
    spikes = np.zeros((len(arrays), max(map(len, arrays)), arrays[0].shape[1]), dtype=np.uint8)
    for row, one in zip(spikes, arrays, strict=True):
        row[: len(one)] = one
    return spikes, binning.step_seconds, None


def _events(members: Members, name: str, place: str) -> EventStream:
    """Return the events of a file of them; next to a ``.tact`` there may be a file of its start and end."""
    file = PurePosixPath(name)
    times = file.with_suffix(".startend")
    beside = [str(times), str(file.parent.parent / TIMES / times.name)] if file.suffix == ".tact" else []
    held = [one for one in beside if one in members.sizes][:1]
    members.check_sizes(held)
    data, startend = members.read(name), members.read(held[0]) if held else None
    limit = MAX_TEXT_BYTES if file.suffix == ".tact" else MAX_EVENTS * EVENT_BYTES
    length = max(len(data), len(startend or b""))
    check_most(length, limit, place, "it is too large", unit="bytes", fix="Give one recording.")
    if file.suffix == ".tact":
        return parse_tact(data, place, startend, members.place(times.name))
    return parse_aedat4(data, place) if file.suffix == ".aedat4" else parse_slayer_events(data, file.suffix, place)


def _check_fits(arrays: list[ByteArray], samples: int, where: str, place: str) -> None:
    """Refuse the last recording where its channels are others, and ``samples`` of the longest that take too much."""
    steps, channels = max(map(len, arrays)), arrays[0].shape[1]
    last, first = (" x ".join(map(str, one.shape)) for one in (arrays[-1], arrays[0]))
    if arrays[-1].shape[1] != channels:
        measured = f"got {last} against {first} steps x channels"
        fix = "Give recordings of one sensor."
        raise InputError(place, "its shape is not that of the other recordings", measured=measured, fix=fix)
    what, fix = "its recordings are too large together", "Give fewer recordings."
    check_most(samples * steps * channels, MAX_ELEMENTS, where, what, unit="values", fix=fix)


def _is_recording(name: str) -> bool:
    file = PurePosixPath(name)
    return file.suffix in EVENT_SUFFIXES or _ARRAY.fullmatch(file.name) is not None


def _part(name: str) -> str:
    """Return the part that a file lies in: that of the innermost folder called train or test, in any case."""
    folders = [folder.lower() for folder in PurePosixPath(name).parent.parts]
    return next((folder for folder in reversed(folders) if folder in PARTS), "")


def _folder(name: str) -> str:
    """Return the name of the folder that a file lies in, empty where that is a part, or there is none."""
    folder = PurePosixPath(name).parent.name
    return "" if folder.lower() in PARTS else folder


def _name_before_number(name: str) -> str:
    """Return what stands before the number of a ``.tact`` file, as in ``stable_01.tact``; empty for other names."""
    match = _NUMBERED.fullmatch(PurePosixPath(name).name)
    return match[1] if match else ""
