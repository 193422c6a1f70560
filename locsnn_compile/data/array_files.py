"""Files of arrays, format by format: from untrusted bytes to arrays by name.

An entry is *ours* if its name is ``spikes`` or in :data:`BESIDE`. Other entries are only read if there is no
``spikes``, because one of them may then be the recordings (:mod:`.arrays` decides that). A name that is almost one of
``BESIDE`` is refused, so that a typing error does not silently drop the labels.
"""

import io
from collections.abc import Collection
from difflib import get_close_matches

import numpy as np

from hw_model.io.files import parsing
from hw_model.io.npy import HEADER_BYTES, NUMBERS, check_header, holds_numbers, load_npy
from hw_model.io.zip_directory import BoundedZip
from hw_model.values import AnyArray
from locsnn_compile.data.event_formats import MAX_PLACE, parse_events
from locsnn_compile.data.event_stream import TIME_UNITS, EventStream, TimeUnit
from locsnn_compile.data.format_rows import ArrayContent, ArrayFile
from locsnn_compile.data.hdf5.events import camera_events
from locsnn_compile.data.hdf5.read import Group, open_hdf5_bytes
from locsnn_compile.data.recordings import MAX_ELEMENTS
from locsnn_compile.data.tensors import Tensor
from locsnn_compile.data.torch_file import load_plain
from locsnn_compile.errors import InputError, counted

#: Entries that belong to the recordings but are not the recordings themselves.
BESIDE = ("labels", "step_seconds", "class_names", "axes", "sensor_size")
_TEXTS = ("class_names", "axes")
"""Entries that hold texts."""
_OWN = ("spikes", *BESIDE)
_ALIKE = 0.82
"""The likeness, of :func:`difflib.get_close_matches`, from which on a name counts as mistyped. It lies
between that of ``lables`` to ``labels``, 0.83, and that of ``taxels``, an honest name, to ``axes``, 0.8.
"""
MOST_MICROSECONDS = 1e16
"""Latest time of a spike: 317 years. It leaves room for times that count from 1970."""


def npy_content(file: ArrayFile) -> ArrayContent:
    """Return the one array of a ``.npy`` file."""
    return ArrayContent({"spikes": load_npy(file.data, file.where)})


def npz_content(file: ArrayFile) -> ArrayContent:
    """Return the arrays of a ``.npz`` file that may be recordings, or belong to them."""
    where = file.where
    fix = "Write it again with numpy.savez."
    with (
        parsing(where, "it is damaged, truncated or not a .npz file", fix=fix),
        BoundedZip(io.BytesIO(file.data), where, fix) as archive,
    ):
        files = archive.namelist()
        unpacked = archive.unpacked_bytes
        # 8 bytes per value are enough for the widest type, and 100 entries for any file of ours.
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
        for member, name in names.items():
            if not _is_read(name, names.values()):
                continue
            place = f"{where}, {member!r}"
            kinds = "US" if name in _TEXTS else NUMBERS
            if name == "labels":
                kinds = NUMBERS + "US"
            # What its header claims is checked before any more of it is unpacked.
            start = archive.content(member, HEADER_BYTES)
            if name in (*_TEXTS, *_OWN, "labels") or holds_numbers(start, place):
                check_header(io.BytesIO(start), place, kinds)
                entries[name] = load_npy(archive.content(member), place, kinds)
        return ArrayContent(entries)


def torch_content(file: ArrayFile) -> ArrayContent:
    """Return the tensors of a torch file that may be recordings, or belong to them."""
    where = file.where
    value = load_plain(file.data, where, fix="Write it again with torch.save.")
    contents = value if isinstance(value, dict) else {"spikes": value}
    if "format" in contents and "weights" in contents:
        fix = "Give it as the model, and recordings as events."
        raise InputError(where, "it is a trained network, not recordings", fix=fix)
    names = list(map(str, contents))
    _check_names(names, where)
    entries: dict[str, AnyArray] = {}
    for name, entry in zip(names, contents.values(), strict=True):
        if entry is None or not _is_read(name, names):
            continue
        if name in BESIDE and isinstance(entry, int | float | list | str):
            entries[name] = _plain_array(entry, where, name)
        elif name in _OWN or isinstance(entry, Tensor):
            entries[name] = _tensor_array(entry, where, name[:40])
    return ArrayContent(entries)


def _tensor_array(entry: object, where: str, name: str) -> AnyArray:
    """Return the values of a tensor; ``InputError`` for anything else, and for a tensor that numpy cannot hold."""
    measured, fix = type(entry).__name__, "Give the recordings as one tensor."
    if isinstance(entry, Tensor):
        if (array := entry.array()) is not None:
            return array
        measured, fix = entry.dtype, "Give uint8."
        if not entry.dense:
            measured, fix = f"{entry.layout} on {entry.device}", "Give a dense tensor."
    raise InputError(where, f"its entry {name!r} is not an array", measured=measured, fix=fix)


def _plain_array(entry: object, where: str, name: str) -> AnyArray:
    """Return a plain number, text or list as an array of texts or of float64, depending on the entry's name."""
    try:
        return np.asarray(entry, dtype=np.str_ if name in _TEXTS else np.float64)
    except (TypeError, ValueError, OverflowError):
        raise InputError(
            where, f"its entry {name!r} holds no numbers", fix="Give plain numbers."
        ) from None


def _check_names(names: Collection[str], where: str) -> None:
    """Refuse a name that is almost one of :data:`BESIDE`, if the file lacks that one; it is probably mistyped.

    Names that are nothing like these are left alone: files may have entries of their own.
    """
    for name in names:
        close = get_close_matches(
            name.lower(), [known for known in BESIDE if known not in names], 1, _ALIKE
        )
        if close and name not in BESIDE:
            fix = f"Did you mean {close[0]!r}? Rename or remove it."
            raise InputError(f"{where}, entry {name!r}", "it has no meaning here", fix=fix)


def _is_read(name: str, names: Collection[str]) -> bool:
    """Return whether an entry is one of ours, or may be the recordings because no entry is called ``spikes``."""
    return name in _OWN or "spikes" not in names


def hdf5_content(file: ArrayFile) -> ArrayContent:
    """Return the arrays at the root of a file by name, and its recordings, if it holds events.

    Events of cameras are one recording: see :mod:`locsnn_compile.data.hdf5.events`. A group
    ``spikes`` has the layout of Heidelberg's data sets (SHD, SSC): ``spikes/times`` and
    ``spikes/units`` hold one row per recording, of seconds (or another time unit) and of channel
    numbers from 0. ``extra/keys`` are the names of the classes. Raises ``InputError`` for other rows.
    """
    where = file.where
    with open_hdf5_bytes(file.data, where) as root:
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
        if "spikes" in values:
            return ArrayContent(entries)
        if "spikes" in root:
            unit = file.time_unit or "s"
            return ArrayContent(entries, _streams(root.group("spikes"), where, unit))
        events = camera_events(root)
    if events is None:
        return ArrayContent(entries)
    return ArrayContent(entries, [parse_events(events, where, file.time_unit)])


def _streams(group: Group, where: str, time_unit: TimeUnit) -> list[EventStream]:
    """Return the recordings in a group of the layout of Heidelberg's data sets, one stream each."""
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
        is_time = (microseconds >= 0) & (microseconds < MOST_MICROSECONDS)
        is_channel = (unit >= 0) & (unit < MAX_PLACE) & (unit == np.floor(unit))
        is_good = is_time & is_channel
        if not is_good.all():
            at = int(np.argmin(is_good))
            what = "it does not hold a time and a channel"
            measured = f"spike {at}: {row[at]} {time_unit}, unit {unit[at]}"
            fix = "Give times and units from 0 up."
            raise InputError(place, what, measured=measured, fix=fix)
        times_us, channel = microseconds.astype(np.int64), unit.astype(np.int64)
        stream = EventStream(
            times_us, channel, y=None, polarity=None, place=place, unit_is_open=True
        )
        streams.append(stream)
    return streams
