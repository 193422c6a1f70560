"""Read folders and zip archives with one recording per file.

The files are ``.npy`` arrays (taxels, polarities, steps), or files of events of one format. Labels come from their
names, or else from the folders that they lie in.
"""

from pathlib import Path, PurePosixPath

import numpy as np

from hw_model.io.npy import load_npy
from hw_model.values import ByteArray, IntArray
from locsnn_compile.data.axes import pixels_of, to_step_major
from locsnn_compile.data.channels import Channels
from locsnn_compile.data.event_formats import holds_events, parse_events
from locsnn_compile.data.event_stream import Binning, Bins, EventStream, TimeUnit, bin_streams
from locsnn_compile.data.format_rows import EventFile, EventFormat
from locsnn_compile.data.formats import event_format
from locsnn_compile.data.members import (
    TIMES,
    Members,
    classes_of,
    label_in_name,
    open_members,
)
from locsnn_compile.data.recordings import Recordings, check_size, clean_spikes
from locsnn_compile.errors import InputError, check_most, check_same


def archive_parts(path: Path) -> tuple[str, ...]:
    """Return which of ``train`` and ``test`` an archive or folder has; empty if it is not divided, or a single file."""
    if not is_archive(path):
        return ()
    with open_members(path) as members:
        return members.parts


def is_archive(path: Path) -> bool:
    """Return whether a path is an archive or a folder, rather than a single file."""
    return path.is_dir() or path.suffix == ".zip"


def read_archive(path: Path, *, split: str | None, binning: Binning) -> Recordings:
    """Return one part of a ``.zip`` archive or of a folder of recordings, with the labels that their names give.

    A file of events is read like a folder that holds only this file. All recordings get the length of the longest;
    silence follows the others. ``split`` is a part; None takes ``test`` of a divided archive, and everything of one
    that is not divided. If names have no labels, the folders that recordings lie in are their classes, provided there
    are several. Raises ``InputError`` for a damaged archive or member, members of different shapes, labels in some of
    the names only, and nothing to read.
    """
    with open_members(path) as members:
        names = _chosen(members, split)
        members.check_sizes(names)
        bins = _read(members, names, binning)
        # Classes of all parts: one may be missing from this part.
        class_names, class_of = classes_of(members.recordings)
        labels = _labels_in_names(members, names)
    if labels is not None:
        class_names = None
    elif class_names is not None:
        labels = np.array([class_names.index(class_of(name)) for name in names], dtype=np.int64)
    return Recordings(
        bins.spikes,
        labels,
        step_seconds=bins.step_seconds,
        source=path.name,
        binned=bins.binned,
        class_names=class_names,
        channels=bins.channels,
        assumed=bins.assumed,
    )


def _labels_in_names(members: Members, names: list[str]) -> IntArray | None:
    """Return the labels in the names of recordings, (names,); None if no name has one.

    Raises ``InputError`` if only some names have one.
    """
    labels = [label_in_name(PurePosixPath(name).name) for name in names]
    if set(labels) == {None}:
        return None
    if None in labels:
        place = members.place(names[labels.index(None)])
        what = "its name has no label, although others have one"
        raise InputError(place, what, fix="Name it like the others, or move it away.")
    return np.array(labels, dtype=np.int64)


def _chosen(members: Members, split: str | None) -> list[str]:
    """Return the sorted names of the recordings of a part; ``InputError`` for none, and for several kinds."""
    chosen = members.of_part(members.known_part(split))
    kinds = sorted({PurePosixPath(name).suffix for name in chosen})
    misnamed = members.other_arrays
    # A .npy file of another name next to .npy recordings is more likely misnamed than meant to be left
    # out. Next to files of events, it may be anything.
    if misnamed and set(kinds) <= {".npy"}:
        fix = "Rename it to sample_<i>.npy or sample_<i>_label_<k>.npy, or move it away."
        raise InputError(
            members.where, f"{misnamed[0][:80]!r} is not named as recordings are", fix=fix
        )
    if not chosen:
        fix = "Give sample_<i>.npy or sample_<i>_label_<k>.npy files, or one .npz file."
        raise InputError(members.where, "no recordings inside", fix=fix)
    if len(kinds) > 1:
        raise _several(members, ", ".join(kinds))
    return chosen


def _several(members: Members, kinds: str) -> InputError:
    """Return the error for recordings of several kinds."""
    fix = "Give recordings of one kind."
    return InputError(members.where, "its recordings are of several kinds", measured=kinds, fix=fix)


def _read(members: Members, names: list[str], binning: Binning) -> Bins:
    """Return the recordings of these files in bins: all are files of bins, or all are files of events."""
    streams: list[EventStream] = []
    arrays: list[ByteArray] = []
    channels: Channels | None = None
    expected = binning.channels or binning.model_channels
    for name in names:
        place = members.place(name)
        file_format = event_format(PurePosixPath(name).suffix)
        if file_format is not None:
            _check_times(binning, PurePosixPath(name), file_format)
            streams.append(_events(members, name, file_format, binning.unit))
            continue
        array = load_npy(members.read(name), place)
        if holds_events(array):
            streams.append(parse_events(array, place, binning.unit))
        else:
            # The last file decides for all: _check_fits refuses another number of channels.
            channels = pixels_of(array, place, expected, binning.axes)
            array = to_step_major(array, place, expected, binning.axes)
            check_same(len(array), 1, place, "it is not one recording", fix="Give one per file.")
            arrays.append(clean_spikes(place, array)[0])
            _check_fits(arrays, len(names), members.where, place)
    if not arrays:
        spans = [stream.span_seconds for stream in streams]
        if None in spans and set(spans) != {None}:
            place = streams[spans.index(None)].place
            what = "it has no .startend file, although others have one"
            raise InputError(
                place, what, fix=f"Give it in folder {TIMES!r}, or leave the recording out."
            )
        return bin_streams(streams, members.where, binning)
    if streams:
        raise _several(members, "binned arrays and structured ones")
    spikes = np.zeros((len(arrays), max(map(len, arrays)), arrays[0].shape[1]), dtype=np.uint8)
    for row, array in zip(spikes, arrays, strict=True):
        row[: len(array)] = array
    return Bins(spikes, step_seconds=binning.step_seconds, binned=None, channels=channels)


def _check_times(binning: Binning, file: PurePosixPath, row: EventFormat) -> None:
    """Refuse an option for the unit of times, or for their start, if the format of the file fixes it."""
    if binning.time_unit is not None and row.time_unit:
        what = f"times in {file.name!r} are in {row.time_unit}, as its format has them"
        raise InputError("time_unit", what, fix="Leave it out.")
    if binning.start is not None and row.times_suffix:
        what = f"{file.name!r} starts where its {row.times_suffix} file or its first event is"
        raise InputError("start", what, fix="Leave it out.")


def _events(
    members: Members, name: str, row: EventFormat, time_unit: TimeUnit | None
) -> EventStream:
    """Return the events of a file, using its file of times if there is one."""
    file = PurePosixPath(name)
    place = members.place(name)
    times = file
    times_files: list[str] = []
    if row.times_suffix:
        times = file.with_suffix(row.times_suffix)
        beside = [str(times), str(file.parent.parent / TIMES / times.name)]
        times_files = [path for path in beside if path in members.sizes][:1]
    members.check_sizes(times_files)
    data = members.read(name)
    startend = members.read(times_files[0]) if times_files else None
    length = max(len(data), len(startend or b""))
    fix = "Give one recording."
    check_most(length, row.most_bytes, place, "it is too large", unit="bytes", fix=fix)
    return row.read(EventFile(data, place, startend, members.place(times.name), time_unit))


def _check_fits(arrays: list[ByteArray], samples: int, where: str, place: str) -> None:
    """Refuse the last array if its channels differ from the first.

    Also refuse all recordings, before the rest is read, if ``samples`` of the longest so far are too large.
    """
    steps = max(map(len, arrays))
    channels = arrays[0].shape[1]
    what = "its channels are not those of the first recording"
    fix = "Give recordings of one sensor."
    check_same(arrays[-1].shape[1], channels, place, what, fix=fix)
    check_size(samples, steps, channels, where)
