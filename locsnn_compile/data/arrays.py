"""Recordings in one ``.npy``, ``.npz``, ``.pt`` or HDF5 file: arrays of 0 and 1, or events, with labels or without.

:mod:`.array_files` turns the bytes of each format into arrays by name; this module decides which of them are the
recordings, their labels, their axes and the width of their bins.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from hw_model.io.files import read_bytes
from hw_model.io.npy import load_npy
from hw_model.values import AnyArray, ByteArray, Frozen
from locsnn_compile.data.array_files import BESIDE
from locsnn_compile.data.axes import Order, parse_axes, pixels_of, to_step_major
from locsnn_compile.data.channels import Channels
from locsnn_compile.data.class_names import labels_of_names
from locsnn_compile.data.event_formats import holds_events, parse_events
from locsnn_compile.data.event_stream import Binning, EventStream, bin_streams
from locsnn_compile.data.format_rows import ArrayContent, ArrayFile
from locsnn_compile.data.formats import array_format
from locsnn_compile.data.members import label_in_name
from locsnn_compile.data.recordings import Binned, Recordings, same_within_rounding
from locsnn_compile.errors import InputError, check_same, counted


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
      :func:`locsnn_compile.data.array_files.hdf5_content`.
    - Axes: those of :func:`locsnn_compile.data.axes.to_step_major`, or of the entry ``axes``, or of ``binning``.
    - Labels of a ``.npy``: in ``<stem>_labels.npy`` next to it; for a single recording also ``_label_<k>`` in its name.
    - Pixels: those of the axes, or of the entry ``sensor_size`` (columns, rows, polarities).
    - Width of a bin: the file's. If it gives none, or holds events, that of ``binning``.

    ``data`` are the bytes of the file if it was read already, and ``where`` names it in errors.

    Raises ``InputError`` for anything else, for an entry whose name is almost one of these, for bins that are not
    ``asked_seconds`` wide, and for a file whose order of axes is not that of ``binning``.
    """
    where = where or f"file {path.name!r}"
    if data is None:
        data = read_bytes(path, where)
    content = _content(ArrayFile(data, where, binning.unit), path.suffix)
    entries = content.entries
    stored_seconds: float | None = None
    if "step_seconds" in entries:
        stored_seconds = _number(entries["step_seconds"], where)
    if content.streams:
        bins = _bins_of_events(content.streams, binning, stored_seconds, where)
    else:
        _check_width(stored_seconds, asked_seconds, where)
        bins = _bins_of_array(entries, binning, stored_seconds, where)
    labels = entries["labels"] if "labels" in entries else labels_beside(path, len(bins.spikes))
    names = _texts(entries, "class_names", where)
    if labels is not None and labels.dtype.kind in "US":
        labels, names = labels_of_names(_texts(entries, "labels", where) or (), names, where)
    return Recordings(
        bins.spikes,
        labels,
        step_seconds=bins.step_seconds,
        source=path.name,
        binned=bins.binned,
        class_names=names,
        channels=bins.channels,
        assumed=bins.assumed,
    )


class _Bins(Frozen, eq=False):
    """Recordings in bins, (samples, steps, channels), and what is known of them.

    The fields mean the same as in :class:`~locsnn_compile.data.event_stream.Bins`, whose spikes are always uint8 0 or
    1; these are not checked yet.
    """

    spikes: ByteArray
    channels: Channels | None
    step_seconds: float | None
    binned: Binned | None = None
    assumed: tuple[str, ...] = ()


def _bins_of_events(
    streams: Sequence[EventStream], binning: Binning, stored_seconds: float | None, where: str
) -> _Bins:
    """Return single events in bins of the width that ``binning`` states, or else of the file's."""
    if binning.step_seconds is None:
        binning = replace(binning, step_seconds=stored_seconds)
    bins = bin_streams(streams, where, binning)
    seconds = binning.step_seconds if bins.step_seconds is None else bins.step_seconds
    return _Bins(bins.spikes, bins.channels, seconds, bins.binned, bins.assumed)


def _bins_of_array(
    entries: Mapping[str, AnyArray], binning: Binning, stored_seconds: float | None, where: str
) -> _Bins:
    """Return the bins of an array whose axes may be in any order."""
    order = _order(entries, binning.axes, where)
    expected = binning.channels or binning.model_channels
    array = _find_spikes(entries, where)
    pixels = pixels_of(array, where, expected, order)
    spikes = to_step_major(array, where, expected, order)
    channels = _sensor_of(entries, pixels, spikes.shape[2], where)
    seconds = binning.step_seconds if stored_seconds is None else stored_seconds
    return _Bins(spikes, channels, seconds)


def _check_width(stored_seconds: float | None, asked_seconds: float | None, where: str) -> None:
    """Refuse an option for the width of bins that contradicts the file."""
    if (
        stored_seconds is None
        or asked_seconds is None
        or same_within_rounding(stored_seconds, asked_seconds)
    ):
        return
    raise InputError(
        "step_seconds",
        f"{where} holds bins of another width",
        measured=f"got {asked_seconds:g} against {stored_seconds:g}",
        fix="Leave it out.",
    )


def _content(file: ArrayFile, suffix: str) -> ArrayContent:
    """Return the arrays of a file by name, and its recordings if it holds events."""
    content = array_format(suffix).read(file)
    entries = content.entries
    if content.streams:
        return content
    if "spikes" not in entries and {"t", "x", "p"} <= {*entries}:
        array = _fields(entries, file.where)
    else:
        array = _find_spikes(entries, file.where)
        if not holds_events(array):
            return content
    return ArrayContent(entries, [parse_events(array, file.where, file.time_unit)])


def _fields(entries: Mapping[str, AnyArray], where: str) -> AnyArray:
    """Return arrays called t, x, y (optional) and p as one structured array; ``InputError`` for unequal sizes."""
    columns = {name: entries[name] for name in ("t", "x", "y", "p") if name in entries}
    events = len(columns["t"]) if columns["t"].ndim else 0
    for name, column in columns.items():
        fix = "Give as many of t, x, y and p."
        check_same(column.shape, (events,), f"{where}, {name!r}", "its size is another", fix=fix)
    array = np.empty(events, dtype=[(name, column.dtype) for name, column in columns.items()])
    for name, column in columns.items():
        array[name] = column
    return array


def _order(entries: Mapping[str, AnyArray], stated: Order | None, where: str) -> Order | None:
    """Return the order of axes that an option or the file states; ``InputError`` if they differ, None if none does."""
    names = _texts(entries, "axes", where)
    if names is None:
        return stated
    stored = parse_axes(" ".join(names), f"{where}, 'axes'")
    if stated not in (None, stored):
        raise InputError(
            "axes", f"{where} gives another order", measured=",".join(stored), fix="Leave it out."
        )
    return stored


def _texts(entries: Mapping[str, AnyArray], name: str, where: str) -> tuple[str, ...] | None:
    """Return the texts of an entry; None if there is no such entry."""
    if name not in entries:
        return None
    texts = entries[name].reshape(-1).tolist()
    if entries[name].dtype.kind not in "US":
        raise InputError(where, f"its entry {name!r} does not hold strings", fix="Store strings.")
    return tuple(
        text.decode("utf-8", "replace") if isinstance(text, bytes) else text for text in texts
    )


def _number(stored: AnyArray, where: str) -> float:
    """Return the entry ``step_seconds``; ``InputError`` if it is not one number."""
    if stored.size != 1 or stored.dtype.kind not in "iuf":
        raise InputError(
            where, "its entry 'step_seconds' is not one number", fix="Give the width of a bin."
        )
    return float(stored.reshape(()))


def _sensor_of(
    entries: Mapping[str, AnyArray], of_axes: Channels | None, count: int, where: str
) -> Channels | None:
    """Return the pixels that the entry ``sensor_size`` states, or else those of the axes, ``of_axes``.

    Raises ``InputError`` if it is not three sizes that multiply to ``count`` channels, or contradicts the axes.
    """
    if "sensor_size" not in entries:
        return of_axes
    sizes = entries["sensor_size"].reshape(-1)
    are_sizes = sizes.dtype.kind in "iu" and len(sizes) == 3 and bool((sizes > 0).all())
    stated = Channels(*sizes.tolist()) if are_sizes else None
    if stated is None or stated.count != count or (of_axes and of_axes != stated):
        what = "its entry 'sensor_size' is not that of its channels"
        measured = f"{sizes.tolist()[:4]} for {counted(count, 'channel')}"[:80]
        raise InputError(where, what, measured=measured, fix="Give columns, rows, polarities.")
    return stated


def _find_spikes(entries: Mapping[str, AnyArray], where: str) -> AnyArray:
    """Return the entry ``spikes``, or the only entry that may be the recordings; ``InputError`` if it is not clear."""
    if "spikes" in entries:
        return entries["spikes"]
    candidates = [name for name in entries if name not in BESIDE]
    if len(candidates) == 1:
        return entries[candidates[0]]
    what = (
        "it is not clear which entry holds the recordings" if candidates else "no recordings inside"
    )
    measured = f"entries: {', '.join(sorted(entries)) or 'none'}"[:200]
    raise InputError(where, what, measured=measured, fix="Name the entry 'spikes'.")


def labels_beside(path: Path, samples: int) -> AnyArray | None:
    """Return the labels of a ``.npy`` file from a file next to it or from its own name; None if neither has them."""
    beside = path.with_name(f"{path.stem}_labels.npy")
    if path.suffix == ".npy" and beside.exists():
        where = f"file {beside.name!r}"
        return load_npy(read_bytes(beside, where), where)
    label = label_in_name(path.name)
    if label is None or samples != 1:
        return None
    return np.full(1, label, dtype=np.int64)
