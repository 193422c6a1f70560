"""One recording a file, in a zip archive or a folder: ``.npy``, ``.bs1``, ``.bs2`` or ``.tact``.

The published EvTouch archives have the members ``Ev-*/train/sample_<i>_label_<k>.npy`` and ``Ev-*/test/...``; each is
one recording, (taxels, polarities, steps). They are read straight from the archive and sorted by their sample number.
``.npy`` files are recordings where they are named ``sample_<i>.npy`` or ``sample_<i>_label_<k>.npy``, files of events
whatever they are called.
"""

import re
from collections.abc import Callable
from pathlib import Path, PurePosixPath

import numpy as np

from hw_model.values import ByteArray
from locsnn_compile.data.aedat4 import parse_aedat4
from locsnn_compile.data.arrays import label_in_name
from locsnn_compile.data.axes import to_step_major
from locsnn_compile.data.event_formats import EVENT_BYTES, parse_slayer_events, parse_structured
from locsnn_compile.data.event_stream import MAX_EVENTS, Binning, EventStream, bin_streams
from locsnn_compile.data.members import TIMES, Members, open_members
from locsnn_compile.data.npy import load_npy
from locsnn_compile.data.recordings import MAX_ELEMENTS, Binned, Recordings, clean_spikes
from locsnn_compile.data.tact import SLIP_CLASSES, parse_tact
from locsnn_compile.errors import InputError, check_most, did_you_mean

PARTS = ("train", "test")
EVENT_SUFFIXES = (".tact", ".bs1", ".bs2", ".bin", ".aedat4")
#: Largest text of one recording: about 600,000 events.
MAX_TEXT_BYTES = 10_000_000

_ARRAY = re.compile(r"sample_\d{1,9}(?:_label_\d{1,6})?\.npy")
_NUMBERED = re.compile(r"(.+)_\d{1,9}\.tact")
_NUMBER = re.compile(r"\d{1,18}")


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
    known = np.array([label for label in labels if label is not None], dtype=np.int64)
    held = known if len(known) == len(names) else None
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
        raise InputError(
            members.where, f"there is no part {split!r}", measured=has, fix=did_you_mean(split, parts or PARTS)
        )
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
                raise InputError(
                    place, "it is not one recording", measured=f"{len(array)} inside", fix="Give one a file."
                )
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
