"""Read folders and archives whose files are whole sets of recordings, such as ``train.npz`` and ``test.npz``.

Each part, train or test, may be one file or several, which are then joined.
"""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path, PurePosixPath

import numpy as np

from hw_model.io.npy import load_npy
from hw_model.values import IntArray
from locsnn_compile.data.arrays import read_arrays
from locsnn_compile.data.class_names import with_classes
from locsnn_compile.data.event_stream import Binning
from locsnn_compile.data.joining import on_one_sensor
from locsnn_compile.data.members import Members, open_members
from locsnn_compile.data.recordings import Binned, Recordings, check_size
from locsnn_compile.errors import InputError


def holds_sets(path: Path) -> bool:
    """Return whether a folder or archive holds whole sets, rather than a file for each recording."""
    with open_members(path) as members:
        return bool(members.sets)


def read_sets(
    path: Path, *, split: str | None, binning: Binning, asked_seconds: float | None
) -> Recordings:
    """Return one part of a folder or archive of sets; its files are joined in the order of their names.

    ``split`` is a part; None takes ``test`` of what is divided, and everything of what is not. All recordings get the
    length of the longest; silence follows the others. Raises ``InputError`` for files that cannot be read or differ in
    channels, in the width of bins, or in whether they have labels.
    """
    with open_members(path) as members:
        names = members.sets_of_part(members.known_part(split))
        members.check_total(names)
        parts = [_read(path, members, name, binning, asked_seconds) for name in names]
    file_names = [PurePosixPath(name).name for name in names]
    if len(parts) == 1:
        return replace(parts[0], source=f"{path.name}, {file_names[0]}")
    joined = _joined(parts, file_names, members.where)
    return replace(joined, source=f"{path.name}, {len(parts)} files")


def _read(
    path: Path, members: Members, name: str, binning: Binning, asked_seconds: float | None
) -> Recordings:
    """Return the recordings of a file; labels of a ``.npy`` lie in ``<stem>_labels.npy`` next to it."""
    where = members.place(name)
    file = PurePosixPath(name)
    data = members.read(name)
    recordings = read_arrays(path / name, binning, asked_seconds, where=where, data=data)
    beside = str(file.with_name(f"{file.stem}_labels.npy"))
    if file.suffix == ".npy" and recordings.labels is None and beside in members.sizes:
        labels = load_npy(members.read(beside), members.place(beside))
        recordings = replace(recordings, labels=labels)
    return recordings


def _joined(parts: Sequence[Recordings], names: Sequence[str], where: str) -> Recordings:
    """Return the recordings of several files, one after the other."""
    parts = on_one_sensor(parts)
    first = parts[0]
    for part, name in zip(parts[1:], names[1:], strict=True):
        _check_alike(first, part, (names[0], name), where)
    samples = sum(map(len, parts))
    steps = max(part.spikes.shape[1] for part in parts)
    channels = first.spikes.shape[2]
    check_size(samples, steps, channels, where)
    class_names = _all_class_names(parts)
    if class_names is not None:
        # Files may name different classes, or the same in another order: labels are renumbered.
        parts = [with_classes(part, class_names) for part in parts]
    spikes = np.concatenate([part.with_steps(steps).spikes for part in parts])
    return replace(
        first,
        spikes=spikes,
        labels=_all_labels(parts),
        class_names=class_names,
        binned=_all_binned(parts),
    )


def _check_alike(first: Recordings, part: Recordings, names: tuple[str, str], where: str) -> None:
    """Refuse two files, called ``names``, that differ in channels, in labels or none, or in the width of bins."""
    channels, other_channels = first.spikes.shape[2], part.spikes.shape[2]
    if channels != other_channels:
        what = "its files hold recordings of different sensors"
        measured = f"{other_channels} channels in {names[1]} against {channels} in {names[0]}"
        raise InputError(where, what, measured=measured, fix="Give recordings of one sensor.")
    labelled = [
        name for name, file in zip(names, (first, part), strict=True) if file.labels is not None
    ]
    if len(labelled) == 1:
        bare = names[1] if labelled[0] == names[0] else names[0]
        what = "only some of its files have labels"
        measured = f"{labelled[0]}, not {bare}"
        raise InputError(where, what, measured=measured, fix="Give labels in all or none.")
    if first.step_seconds != part.step_seconds:
        what = "its files have bins of different widths"
        measured = f"{_width(part)} in {names[1]} against {_width(first)} in {names[0]}"
        raise InputError(where, what, measured=measured, fix="Give files of one width.")


def _width(recordings: Recordings) -> str:
    """Return the width of a bin in words."""
    seconds = recordings.step_seconds
    return "unknown" if seconds is None else f"{seconds:g} s"


def _all_labels(parts: Sequence[Recordings]) -> IntArray | None:
    """Return the labels of all files; None if they have none. :func:`_check_alike` has refused a mixture."""
    labels = [part.labels for part in parts if part.labels is not None]
    return np.concatenate(labels) if labels else None


def _all_class_names(parts: Sequence[Recordings]) -> tuple[str, ...] | None:
    """Return the names of all classes in the order in which files name them; None if a file has no names."""
    names: dict[str, None] = {}
    for part in parts:
        if part.class_names is None:
            return None
        names |= dict.fromkeys(part.class_names)
    return tuple(names)


def _all_binned(parts: Sequence[Recordings]) -> Binned | None:
    """Return what binning left out of all files; None if nothing was binned or cut."""
    known = [part.binned for part in parts if part.binned is not None]
    if not known:
        return None
    total = known[0]
    for binned in known[1:]:
        total = replace(
            total,
            events=total.events + binned.events,
            outside=total.outside + binned.outside,
            below=total.below + binned.below,
            elsewhere=total.elsewhere + binned.elsewhere,
        )
    return total
