"""Recordings in one ``.npy``, ``.npz``, ``.pt`` or HDF5 file: arrays of 0 and 1, or events, with labels or without."""

import io
from collections.abc import Collection, Mapping
from dataclasses import replace
from difflib import get_close_matches
from pathlib import Path

import numpy as np

from hw_model.io.files import parsing, read_bytes
from hw_model.io.npy import HEADER_BYTES, NUMBERS, check_header, holds_numbers, load_npy
from hw_model.io.zip_directory import BoundedZip
from hw_model.values import AnyArray
from locsnn_compile.data.axes import Order, parse_axes, pixels_of, to_step_major
from locsnn_compile.data.channels import Channels
from locsnn_compile.data.class_names import labels_of_names
from locsnn_compile.data.event_formats import MAX_PLACE, holds_events, parse_events
from locsnn_compile.data.event_stream import (
    TIME_UNITS,
    Binning,
    EventStream,
    TimeUnit,
    bin_streams,
)
from locsnn_compile.data.hdf5.events import camera_events
from locsnn_compile.data.hdf5.read import Group, open_hdf5_bytes
from locsnn_compile.data.members import label_in_name
from locsnn_compile.data.recordings import MAX_ELEMENTS, Binned, Recordings, same
from locsnn_compile.data.tensors import Tensor
from locsnn_compile.data.torch_file import load_plain
from locsnn_compile.errors import InputError, check_same, counted

#: Entries of ``.npz`` and ``.pt`` files that are not the recordings.
_BESIDE = ("labels", "step_seconds", "class_names", "axes", "sensor_size")
_TEXTS = ("class_names", "axes")
_OWN = ("spikes", *_BESIDE)
_ALIKE = 0.82
"""From which likeness on a name is one of these with an error in it: 0.83 for ``lables``, 0.8 for ``taxels``."""
HDF5_SUFFIXES = (".h5", ".hdf5")
MOST_MICROSECONDS = 1e16
"""Latest time of a spike, some centuries after 1970."""


def read_arrays(
    path: Path,
    binning: Binning,
    asked_seconds: float | None,
    *,
    where: str | None = None,
    data: bytes | None = None,
) -> Recordings:
    """Return the recordings of a ``.npy``, ``.npz``, ``.pt`` or HDF5 file; a structured array holds events.

    - Recordings: the entry ``spikes``, or the only entry other than ``labels``, ``step_seconds``, ``class_names`` and
      ``axes``. A ``.pt`` file may hold the bare array, and in HDF5 a group ``spikes`` holds events: see
      :func:`read_hdf5`.
    - Axes: those of :func:`locsnn_compile.data.axes.to_step_major`, or of the entry ``axes``, or of ``binning``.
    - Labels of a ``.npy``: in ``<stem>_labels.npy`` next to it; for a single recording also ``_label_<k>`` in its name.
    - Pixels: those of the axes, or of the entry ``sensor_size`` (columns, rows, polarities).
    - Width of a bin: the file's. If it gives none, or holds events, that of ``binning``.

    ``data`` are the bytes of the file if it was read already, and ``where`` names it in errors.

    Raises ``InputError`` for anything else, for an entry whose name is almost one of these, for bins that are not
    ``asked_seconds`` wide, and for a file whose order of axes is not that of ``binning``.
    """
    where = where or f"file {path.name!r}"
    content = read_bytes(path, where) if data is None else data
    entries, streams = _entries(path.suffix, content, where, binning.unit)
    own: float | None = (
        _number(entries["step_seconds"], where) if "step_seconds" in entries else None
    )
    binned: Binned | None = None
    assumed: tuple[str, ...] = ()
    channels: Channels | None
    if streams:
        wanted = binning.step_seconds
        binning = replace(binning, step_seconds=own if wanted is None else wanted)
        bins = bin_streams(streams, where, binning)
        spikes, channels = bins.spikes, bins.channels
        own, binned, assumed = bins.step_seconds, bins.binned, bins.assumed
    else:
        if own is not None and asked_seconds is not None and not same(own, asked_seconds):
            what, measured = (
                f"{where} holds bins of another width",
                f"got {asked_seconds:g} against {own:g}",
            )
            raise InputError("step_seconds", what, measured=measured, fix="Leave it out.")
        order = _order(entries, binning.axes, where)
        expected = binning.channels or binning.model_channels
        array = _find_spikes(entries, where)
        channels = pixels_of(array, where, expected, order)
        spikes = to_step_major(array, where, expected, order)
        channels = _sensor_of(entries, channels, spikes.shape[2], where)
    labels = entries["labels"] if "labels" in entries else labels_beside(path, len(spikes))
    seconds = binning.step_seconds if own is None else own
    names = _texts(entries, "class_names", where)
    if labels is not None and labels.dtype.kind in "US":
        labels, names = labels_of_names(_texts(entries, "labels", where) or (), names, where)
    return Recordings(
        spikes,
        labels,
        seconds,
        path.name,
        binned=binned,
        class_names=names,
        channels=channels,
        assumed=assumed,
    )


def _entries(
    suffix: str, data: bytes, where: str, time_unit: TimeUnit | None
) -> tuple[Mapping[str, AnyArray], list[EventStream]]:
    """Return the arrays of a file by name, and its recordings if it holds events."""
    entries: Mapping[str, AnyArray]
    if suffix in HDF5_SUFFIXES:
        entries, streams = read_hdf5(data, where, time_unit)
        if streams:
            return entries, streams
    elif suffix == ".npy":
        entries = {"spikes": load_npy(data, where)}
    elif suffix == ".npz":
        entries = _npz_entries(data, where)
    else:
        entries = _torch_entries(data, where)
    if "spikes" not in entries and {"t", "x", "p"} <= {*entries}:
        return entries, [parse_events(_fields(entries, where), where, time_unit)]
    found = _find_spikes(entries, where)
    return entries, [parse_events(found, where, time_unit)] if holds_events(found) else []


def _fields(entries: Mapping[str, AnyArray], where: str) -> AnyArray:
    """Return arrays called t, x, y (optional) and p as the fields of one; ``InputError`` if they are not columns."""
    columns = {name: entries[name] for name in ("t", "x", "y", "p") if name in entries}
    events = len(columns["t"]) if columns["t"].ndim else 0
    for name, column in columns.items():
        fix = "Give as many of t, x, y and p."
        check_same(column.shape, (events,), f"{where}, {name!r}", "its size is another", fix=fix)
    array = np.empty(events, dtype=[(name, column.dtype) for name, column in columns.items()])
    for name, column in columns.items():
        array[name] = column
    return array


def _check_names(names: Collection[str], where: str) -> None:
    """Refuse a name that differs by a few letters from one that a file lacks; other names may be anybody's."""
    for name in names:
        close = get_close_matches(
            name.lower(), [known for known in _BESIDE if known not in names], 1, _ALIKE
        )
        if close and name not in _BESIDE:
            fix = f"Did you mean {close[0]!r}? Rename or remove it."
            raise InputError(f"{where}, entry {name!r}", "it has no meaning here", fix=fix)


def _is_read(name: str, names: Collection[str]) -> bool:
    """Tell whether an entry is one of ours, or may be the recordings because no entry is called ``spikes``."""
    return name in _OWN or "spikes" not in names


def _order(entries: Mapping[str, AnyArray], asked: Order | None, where: str) -> Order | None:
    """Return the order of axes that is asked for, or that the file gives; ``InputError`` if they differ."""
    said = _texts(entries, "axes", where)
    own = None if said is None else parse_axes(" ".join(said), f"{where}, 'axes'")
    if own is not None and asked not in (None, own):
        raise InputError(
            "axes", f"{where} gives another order", measured=",".join(own), fix="Leave it out."
        )
    return asked or own


def _texts(entries: Mapping[str, AnyArray], name: str, where: str) -> tuple[str, ...] | None:
    """Return the texts of an entry; None if there is no such entry."""
    if name not in entries:
        return None
    held = entries[name].reshape(-1).tolist()
    if entries[name].dtype.kind not in "US":
        raise InputError(where, f"its entry {name!r} does not hold strings", fix="Store strings.")
    return tuple(
        text.decode("utf-8", "replace") if isinstance(text, bytes) else text for text in held
    )


def _number(stored: AnyArray, where: str) -> float:
    if stored.size != 1 or stored.dtype.kind not in "iuf":
        raise InputError(
            where, "its entry 'step_seconds' is not one number", fix="Give the width of a bin."
        )
    return float(stored.reshape(()))


def _sensor_of(
    entries: Mapping[str, AnyArray], of_axes: Channels | None, count: int, where: str
) -> Channels | None:
    """Return the pixels that the entry ``sensor_size`` states, or else those of the axes; refuse other sizes."""
    if "sensor_size" not in entries:
        return of_axes
    sizes = entries["sensor_size"].reshape(-1)
    whole = sizes.dtype.kind in "iu" and len(sizes) == 3 and bool((sizes > 0).all())
    stated = Channels(*sizes.tolist()) if whole else None
    if stated is None or stated.count != count or (of_axes and of_axes != stated):
        what = "its entry 'sensor_size' is not that of its channels"
        measured = f"{sizes.tolist()[:4]} for {counted(count, 'channel')}"[:80]
        raise InputError(where, what, measured=measured, fix="Give columns, rows, polarities.")
    return stated


def _npz_entries(data: bytes, where: str) -> dict[str, AnyArray]:
    fix = "Write it again with numpy.savez."
    with (
        parsing(where, "it is damaged, truncated or not a .npz file", fix=fix),
        BoundedZip(io.BytesIO(data), where, fix) as archive,
    ):
        files, unpacked = archive.namelist(), archive.unpacked_bytes
        if unpacked > 8 * MAX_ELEMENTS or len(files) > 100:
            measured = f"{unpacked} bytes in {counted(len(files), 'entry', 'entries')}"
            raise InputError(
                where, "it is too large", measured=measured, fix="Give fewer recordings."
            )
        names = {file: file.removesuffix(".npy") for file in files}
        if len(set(names.values())) < len(names):
            raise InputError(where, "it contains an entry twice, with and without '.npy'", fix=fix)
        _check_names(names.values(), where)
        entries: dict[str, AnyArray] = {}
        for file, name in names.items():
            if not _is_read(name, names.values()):
                continue
            place = f"{where}, {file!r}"
            kinds = "US" if name in _TEXTS else NUMBERS
            if name == "labels":
                kinds = NUMBERS + "US"
            # What its header claims is checked before any more of it is unpacked.
            start = archive.content(file, HEADER_BYTES)
            if name in (*_TEXTS, *_OWN, "labels") or holds_numbers(start, place):
                check_header(io.BytesIO(start), place, kinds)
                entries[name] = load_npy(archive.content(file), place, kinds)
        return entries


def _torch_entries(data: bytes, where: str) -> dict[str, AnyArray]:
    value = load_plain(data, where, fix="Write it again with torch.save.")
    found = value if isinstance(value, dict) else {"spikes": value}
    if "format" in found and "weights" in found:
        fix = "Give it as the model, and recordings as events."
        raise InputError(where, "it is a trained network, not recordings", fix=fix)
    names = list(map(str, found))
    _check_names(names, where)
    entries: dict[str, AnyArray] = {}
    for name, entry in zip(names, found.values(), strict=True):
        if entry is None or not _is_read(name, names):
            continue
        if name in _BESIDE and isinstance(entry, int | float | list | str):
            entries[name] = _plain_array(entry, where, name)
        elif name in _OWN or isinstance(entry, Tensor):
            entries[name] = _tensor_array(entry, where, name[:40])
    return entries


def _tensor_array(entry: object, where: str, name: str) -> AnyArray:
    measured, fix = type(entry).__name__, "Give the recordings as one tensor."
    if isinstance(entry, Tensor):
        if (array := entry.array()) is not None:
            return array
        measured, fix = entry.dtype, "Give uint8."
        if not entry.dense:
            measured, fix = f"{entry.layout} on {entry.device}", "Give a dense tensor."
    raise InputError(where, f"its entry {name!r} is not an array", measured=measured, fix=fix)


def _plain_array(entry: object, where: str, name: str) -> AnyArray:
    try:
        return np.asarray(entry, dtype=np.str_ if name in _TEXTS else np.float64)
    except (TypeError, ValueError, OverflowError):
        raise InputError(
            where, f"its entry {name!r} holds no numbers", fix="Give plain numbers."
        ) from None


def _find_spikes(entries: Mapping[str, AnyArray], where: str) -> AnyArray:
    if "spikes" in entries:
        return entries["spikes"]
    others = [name for name in entries if name not in _BESIDE]
    if len(others) != 1:
        what = (
            "it is not clear which entry holds the recordings" if others else "no recordings inside"
        )
        fix = "Name the entry 'spikes'."
        raise InputError(
            where, what, measured=f"entries: {', '.join(sorted(entries)) or 'none'}"[:200], fix=fix
        )
    return entries[others[0]]


def labels_beside(path: Path, samples: int) -> AnyArray | None:
    """Return the labels of a ``.npy`` file from a file next to it or from its own name; None if neither has them."""
    beside = path.with_name(f"{path.stem}_labels.npy")
    if path.suffix == ".npy" and beside.exists():
        where = f"file {beside.name!r}"
        return load_npy(read_bytes(beside, where), where)
    label = label_in_name(path.name)
    return np.full(1, label, dtype=np.int64) if label is not None and samples == 1 else None


def read_hdf5(
    data: bytes, where: str, time_unit: TimeUnit | None = None
) -> tuple[dict[str, AnyArray], list[EventStream]]:
    """Return the arrays at the root of a file by name, and its recordings, if it holds events.

    Events of cameras are one recording: see :mod:`locsnn_compile.data.hdf5.events`. A group
    ``spikes`` has the layout of Heidelberg's data sets (SHD, SSC): ``spikes/times`` and
    ``spikes/units`` hold one row per recording, of seconds (or another ``time_unit``) and of channel
    numbers from 0. ``extra/keys`` are the names of the classes. Raises ``InputError`` for other rows.
    """
    with open_hdf5_bytes(data, where) as root:
        values = [name for name in root.names() if not root.is_group(name)]
        _check_names(values, where)
        entries: dict[str, AnyArray] = {}
        for name in values:
            if not _is_read(name, root.names()):
                continue
            if name in _TEXTS:
                entries[name] = np.array(root.texts(name))
            elif name in _OWN or root.holds_numbers(name):
                entries[name] = root.array(name)
        if "extra" in root and root.is_group("extra") and "keys" in (extra := root.group("extra")):
            entries.setdefault("class_names", np.array(extra.texts("keys")))
        if "spikes" in root:
            has_rows = "spikes" not in values
            streams = _streams(root.group("spikes"), where, time_unit or "s") if has_rows else []
            return entries, streams
        events = camera_events(root)
    return entries, [] if events is None else [parse_events(events, where, time_unit)]


def _streams(group: Group, where: str, time_unit: TimeUnit) -> list[EventStream]:
    times, units = group.rows("times"), group.rows("units")
    if [len(row) for row in times] != [len(row) for row in units]:
        raise InputError(
            where,
            "its times and units differ in number",
            fix="Give a time and a unit for each spike.",
        )
    streams = []
    for index, (row, unit) in enumerate(zip(times, units, strict=True)):
        place = f"{where}, recording {index}"
        microseconds = np.rint(row * TIME_UNITS[time_unit])
        # Written so that NaN is refused as well.
        timed = (microseconds >= 0) & (microseconds < MOST_MICROSECONDS)
        good = timed & (unit >= 0) & (unit < MAX_PLACE) & (unit == np.floor(unit))
        if not good.all():
            at = int(np.argmin(good))
            what = "it does not hold a time and a channel"
            measured = f"spike {at}: {row[at]} {time_unit}, unit {unit[at]}"
            fix = "Give times and units from 0 up."
            raise InputError(place, what, measured=measured, fix=fix)
        times_us, channel = microseconds.astype(np.int64), unit.astype(np.int64)
        stream = EventStream(times_us, channel, None, None, place=place, unit_is_open=True)
        streams.append(stream)
    return streams
