"""Write recordings to files, folders and zip archives.

A file is written completely or not at all, and equal recordings give equal bytes. Most formats cannot hold everything
that recordings say (the width of a bin, trailing silence, ...): :func:`write_recordings` returns the options by which
``read_recordings`` gets the same recordings back.
"""

from pathlib import Path

import numpy as np

from hw_model.io.build_folder import check_folder, write_build
from hw_model.io.files import npy_bytes, pack_arrays, pack_files, replace_file
from hw_model.io.partial import claimed
from hw_model.values import AnyArray, BoolArray, ByteArray, Frozen
from locsnn_compile.data.axes import is_clear
from locsnn_compile.data.event_formats import COLUMNS, structured_events, timed_events
from locsnn_compile.data.event_stream import STEP_SECONDS
from locsnn_compile.data.format_rows import EventsToWrite
from locsnn_compile.data.formats import event_format, member_kinds, written_suffixes
from locsnn_compile.data.joining import by_pixel
from locsnn_compile.data.members import label_in_name
from locsnn_compile.data.recordings import Recordings
from locsnn_compile.data.sensor import POLARITIES, TAXELS, SensorLayout
from locsnn_compile.data.tact import CHANNELS, GRASP_SECONDS
from locsnn_compile.data.torch_file import torch_bytes
from locsnn_compile.errors import InputError, check_known


class NotHeld(Frozen):
    """What a format does not hold: the ``options`` of ``read_recordings`` that restore it, by name."""

    options: dict[str, int | float]


Sensor = SensorLayout | None


def write_recordings(
    path: Path | str,
    recordings: Recordings,
    *,
    members: str = "npy",
    structured: bool = False,
    sensor: Sensor = None,
) -> NotHeld:
    """Write ``recordings`` in the format that the ending of ``path`` names; without one, a folder.

    ``.npz`` and ``.pt`` hold everything. ``.npy``, ``.tact``, ``.bs1`` and ``.bs2`` hold one array or recording, and a
    label if it is in the name (``_label_<k>``). A folder or ``.zip`` gets one file per recording, of the kind
    ``members``. ``structured``: ``.npy`` and ``.npz`` files of one recording hold its events, as Tonic's do. Events
    have the cells of the ``sensor``; without one, those of NeuTouch if the channels are whole fingertips, else each
    channel is a cell.

    Returns the options that are needed to read the same recordings again. Raises ``InputError`` for recordings that the
    format cannot hold, and if the file cannot be written.
    """
    path = Path(path)
    recordings = by_pixel(recordings)
    where = f"file {path.name!r}"
    suffix = path.suffix
    check_known(
        where, f"files ending in {suffix!r} are not written", suffix or None, written_suffixes()
    )
    if sensor is not None:
        sensor.check_channels(recordings.spikes.shape[2], f"recordings {recordings.source!r}")
    check_known("members", f"{members!r} is not known", str(members), member_kinds())
    if suffix in ("", ".zip"):
        files = _member_files(recordings, members, where, sensor)
        if suffix == ".zip":
            replace_file(path, pack_files(files.items(), compressed=False), where)
        else:
            check_folder(path)
            path.parent.mkdir(parents=True, exist_ok=True)
            with claimed(path, f"folder {path.name!r}"):
                _check_empty(path)
                write_build(path, files)
        return _not_held(recordings, members, sensor, start=True)
    kind = "events" if structured and suffix in (".npy", ".npz") else suffix[1:]
    replace_file(path, _content(path, recordings, kind, where, sensor), where)
    if kind in ("npz", "pt"):
        return NotHeld({})
    return _not_held(recordings, kind, sensor, timed=suffix == ".npz")


def npz_bytes(recordings: Recordings) -> bytes:
    """Return the content of a ``.npz`` file of recordings, which holds everything."""
    recordings = by_pixel(recordings)
    entries = _entries(recordings, "npz", f"recordings {recordings.source!r}", sensor=None)
    return pack_arrays(entries, compressed=False)


def _check_empty(path: Path) -> None:
    """Refuse a folder that has files already: readers would take them for recordings of this set."""
    if path.is_dir() and any(path.iterdir()):
        what, fix = "it is not empty, and recordings would mix", "Name a new folder, or a .zip."
        raise InputError(f"folder {path.name!r}", what, fix=fix)


def _content(path: Path, recordings: Recordings, kind: str, where: str, sensor: Sensor) -> bytes:
    """Return the bytes of a single file of a ``kind``: a format's ending, or ``events`` for structured arrays."""
    if kind not in ("npz", "pt"):
        _check_label(path, recordings, kind, where)
    if path.suffix in (".npz", ".pt"):
        entries = _entries(recordings, kind, where, sensor)
        return (
            torch_bytes(entries, where) if kind == "pt" else pack_arrays(entries, compressed=False)
        )
    if kind == "npy":
        return npy_bytes(_channel_major(recordings.spikes))
    content = _one_file(recordings, 0, kind, path.stem, where, sensor)[path.name]
    if kind == "tact" and not recordings.spikes[0, 0].any():
        what = "its first steps are silent, and without a .startend file a recording begins with its first event"
        raise InputError(where, what, fix="Write a folder or .zip with members tact.")
    return content


def _check_label(path: Path, recordings: Recordings, kind: str, where: str) -> None:
    """Refuse to write several recordings of events, or labels that the name does not have, into a single file."""
    if len(recordings) > 1 and kind != "npy":
        fix = "Write a folder or .zip, with members."
        raise InputError(
            where,
            "this format holds one recording only",
            measured=f"got {len(recordings)}",
            fix=fix,
        )
    label = label_in_name(path.name) if len(recordings) == 1 else None
    labels_in_name = None if label is None else [label]
    labels = None if recordings.labels is None else recordings.labels.tolist()
    # A name with a label is refused for recordings without labels as well: they would come back with one.
    if labels != labels_in_name:
        what = "this format cannot hold labels, and the file name does not give them"
        if labels is None:
            measured = "none"
        elif len(labels) > 1:
            measured = f"{len(labels)} of them"
        else:
            measured = f"{labels[0]}"
        fix = "Write .npz, .pt, a folder or .zip, or one recording with _label_<k> in its name."
        raise InputError(where, what, measured=measured, fix=fix)


def _entries(recordings: Recordings, kind: str, where: str, sensor: Sensor) -> dict[str, AnyArray]:
    """Return the arrays of a file that holds several, by name."""
    entries: dict[str, AnyArray] = {}
    width = None if recordings.step_seconds is None else float(recordings.step_seconds)
    if kind == "events":
        events = _to_write(recordings, 0, "", where, sensor)
        entries["events"] = structured_events(*timed_events(events))
        width = events.step_seconds
    else:
        entries["spikes"] = _channel_major(recordings.spikes)
    further = {
        "labels": recordings.labels,
        "step_seconds": width,
        "class_names": recordings.class_names,
        "sensor_size": _sensor_size(recordings),
    }
    # Only where readers might take the sizes of the axes for those of another order.
    if kind != "events" and not is_clear(entries["spikes"].shape):
        further["axes"] = ("samples", "channels", "steps")
    return entries | {name: np.array(value) for name, value in further.items() if value is not None}


def _sensor_size(recordings: Recordings) -> tuple[int, int, int] | None:
    """Return (columns, rows, polarities), as Tonic's ``sensor_size``; None unless the grid of the sensor is known."""
    known = recordings.channels
    if known is None or not known.is_grid or known.reached:
        return None
    return known.columns, known.rows, known.polarities


def _channel_major(spikes: ByteArray) -> ByteArray:
    """Return spikes (..., steps, channels) as (..., channels, steps), the order of files."""
    return np.ascontiguousarray(spikes.swapaxes(-1, -2))


def _cells(recordings: Recordings, sensor: Sensor) -> tuple[int, int]:
    """Return the polarities of a cell and the columns of the grid in which cells are numbered, row by row.

    Without a sensor, there are two polarities if the channels are those of whole fingertips.
    """
    if sensor is not None:
        return sensor.polarities, sensor.columns or COLUMNS
    are_fingertips = recordings.spikes.shape[2] % (TAXELS * POLARITIES) == 0
    return (POLARITIES if are_fingertips else 1), COLUMNS


def _width(recordings: Recordings) -> float:
    """Return the width of a bin in seconds; that which readers take by default if it is unknown."""
    return STEP_SECONDS if recordings.step_seconds is None else recordings.step_seconds


def _to_write(
    recordings: Recordings, index: int, stem: str, where: str, sensor: Sensor
) -> EventsToWrite:
    """Return recording ``index`` as the writers of formats of events take it."""
    polarities, columns = _cells(recordings, sensor)
    return EventsToWrite(
        spikes=recordings.spikes[index],
        step_seconds=_width(recordings),
        polarities=polarities,
        columns=columns,
        stem=stem,
        where=where,
        number=index,
    )


def _one_file(
    recordings: Recordings, index: int, kind: str, stem: str, where: str, sensor: Sensor
) -> dict[str, bytes]:
    """Return the files of recording ``index`` by name: for most kinds one, for ``tact`` also its file of times."""
    if kind == "npy":
        return {f"{stem}.npy": npy_bytes(_channel_major(recordings.spikes[index]))}
    events = _to_write(recordings, index, stem, where, sensor)
    row = event_format(f".{kind}")
    if row is None or row.write is None:
        return {f"{stem}.npy": npy_bytes(structured_events(*timed_events(events)))}
    return row.write(events)


def _member_files(
    recordings: Recordings, kind: str, where: str, sensor: Sensor
) -> dict[str, bytes]:
    """Return the files of a folder or archive by name; numbers have leading zeros, so that names sort like them."""
    digits = len(str(len(recordings) - 1))
    files: dict[str, bytes] = {}
    for index in range(len(recordings)):
        label = "" if recordings.labels is None else f"_label_{recordings.labels[index]}"
        files |= _one_file(
            recordings, index, kind, f"sample_{index:0{digits}}{label}", where, sensor
        )
    return files


def _not_held(
    recordings: Recordings, kind: str, sensor: Sensor, timed: bool = False, start: bool = False
) -> NotHeld:
    """Return the options without which a file of this kind would be read differently.

    ``timed``: the file has the width of a bin; ``start``: there is a file for each recording, and for ``.tact`` a
    ``.startend`` file next to it says where it begins.

    Readers of events see only as far as the last step and channel that has an event: ``read_steps`` and
    ``read_channels`` are the sizes that they would find without options.
    """
    samples, steps, channels = recordings.spikes.shape
    shape = (channels, steps) if start else (samples, channels, steps)
    width = _width(recordings)
    polarities, columns = _cells(recordings, sensor)
    active: BoolArray = np.any(recordings.spikes, axis=0)  # (steps, channels), in any recording
    begins_silent = not recordings.spikes[:, 0].any(axis=1).all()
    read_steps = int(np.flatnonzero(active.any(axis=1)).max(initial=-1)) + 1
    used_channels = int(np.flatnonzero(active.any(axis=0)).max(initial=-1)) + 1
    # Divisions round up (-(-a // b)): readers complete the last pixel.
    read_channels = -(-used_channels // polarities) * polarities
    if kind == "tact":
        read_channels = CHANNELS
        if start:
            read_steps = round(GRASP_SECONDS / width)
    channels_of_row = columns * polarities
    # Readers of x and y find the columns if the events reach the last column and fill the grid.
    fills_rows = -(-used_channels // channels_of_row) * channels_of_row == channels
    fills_grid = fills_rows or read_channels == channels
    last_column = active.any(axis=0).reshape(-1, polarities)[columns - 1 :: columns]
    shows_columns = fills_grid and last_column.any()
    # Events of one polarity alone are read as those of a sensor that has no other.
    has_both_polarities = active[:, 0::2].any() and active[:, 1::2].any()
    shows_polarities = has_both_polarities and read_channels == channels
    # (option, its value, whether readers need it)
    rows = (
        (
            "step_seconds",
            recordings.step_seconds,
            not timed and (kind == "npy" or width != STEP_SECONDS),
        ),
        ("channels", channels, not is_clear(shape) if kind == "npy" else read_channels != channels),
        ("start", 0, kind == "events" and begins_silent),
        ("steps", steps, kind != "npy" and read_steps != steps),
        ("polarities", 2, kind not in ("npy", "tact") and polarities == 2 and not shows_polarities),
        ("polarities", 1, kind == "tact" and polarities == 1),
        (
            "columns",
            columns,
            kind == "bs2" and used_channels > channels_of_row and not shows_columns,
        ),
    )
    return NotHeld({name: value for name, value, needed in rows if needed and value is not None})
