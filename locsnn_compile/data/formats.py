"""Which files of recordings are read and written: a table with one row for each format.

Files of events hold single events of one recording; files of arrays hold recordings in bins (or events
in fields). The rest of the package asks the functions at the end, and never compares endings itself.

To add a format, write its reader in a module of its own and its row here. A row imports its reader
only when a file is read, so that help does not wait for it.
"""

from typing import TYPE_CHECKING

from locsnn_compile.data.format_rows import (
    ArrayContent,
    ArrayFile,
    ArrayFormat,
    EventFile,
    EventFormat,
    EventsToWrite,
)

if TYPE_CHECKING:
    from locsnn_compile.data.event_stream import EventStream


def _read_tact(file: EventFile) -> "EventStream":
    from locsnn_compile.data.tact import parse_tact

    return parse_tact(file.data, file.where, file.times, file.times_where)


def _write_tact(events: EventsToWrite) -> dict[str, bytes]:
    from locsnn_compile.data.tact import tact_files

    return tact_files(events)


def _read_bs1(file: EventFile) -> "EventStream":
    from locsnn_compile.data.event_formats import parse_slayer_events

    return parse_slayer_events(file.data, ".bs1", file.where)


def _write_bs1(events: EventsToWrite) -> dict[str, bytes]:
    from locsnn_compile.data.event_formats import slayer_file

    return slayer_file(events, ".bs1")


def _read_bs2(file: EventFile) -> "EventStream":
    from locsnn_compile.data.event_formats import parse_slayer_events

    return parse_slayer_events(file.data, ".bs2", file.where)


def _write_bs2(events: EventsToWrite) -> dict[str, bytes]:
    from locsnn_compile.data.event_formats import slayer_file

    return slayer_file(events, ".bs2")


def _read_bin(file: EventFile) -> "EventStream":
    from locsnn_compile.data.event_formats import parse_slayer_events

    return parse_slayer_events(file.data, ".bin", file.where)


def _read_aedat4(file: EventFile) -> "EventStream":
    from locsnn_compile.data.event_formats import parse_aedat4

    return parse_aedat4(file.data, file.where)


def _read_raw(file: EventFile) -> "EventStream":
    from locsnn_compile.data.prophesee import parse_raw

    return parse_raw(file.data, file.where)


def _read_dat(file: EventFile) -> "EventStream":
    from locsnn_compile.data.prophesee import parse_dat

    return parse_dat(file.data, file.where)


def _read_aedat(file: EventFile) -> "EventStream":
    from locsnn_compile.data.aedat import parse_aedat

    return parse_aedat(file.data, file.where)


def _read_csv(file: EventFile) -> "EventStream":
    from locsnn_compile.data.event_text import parse_csv

    return parse_csv(file)


def _read_npy(file: ArrayFile) -> ArrayContent:
    from locsnn_compile.data.array_files import npy_content

    return npy_content(file)


def _read_npz(file: ArrayFile) -> ArrayContent:
    from locsnn_compile.data.array_files import npz_content

    return npz_content(file)


def _read_torch(file: ArrayFile) -> ArrayContent:
    from locsnn_compile.data.array_files import torch_content

    return torch_content(file)


def _read_hdf5(file: ArrayFile) -> ArrayContent:
    from locsnn_compile.data.array_files import hdf5_content

    return hdf5_content(file)


MOST_TEXT_BYTES = 10_000_000
"""The largest text of one recording: about 600,000 events, at 16 bytes per line. Chosen by hand."""
EVENT_FORMATS = (
    EventFormat(
        ".tact",
        _read_tact,
        _write_tact,
        time_unit="seconds",
        times_suffix=".startend",
        most_bytes=MOST_TEXT_BYTES,
    ),
    EventFormat(".bs1", _read_bs1, _write_bs1),
    EventFormat(".bs2", _read_bs2, _write_bs2),
    EventFormat(".bin", _read_bin),
    EventFormat(".aedat4", _read_aedat4),
    EventFormat(".aedat", _read_aedat),
    EventFormat(".raw", _read_raw),
    EventFormat(".dat", _read_dat),
    EventFormat(".csv", _read_csv, time_unit="", most_bytes=MOST_TEXT_BYTES, may_describe=True),
)
"""In the order of help and errors."""
ARRAY_FORMATS = (
    ArrayFormat(".npy", _read_npy, is_written=True, holds_sets=False),
    ArrayFormat(".npz", _read_npz, is_written=True),
    ArrayFormat(".pt", _read_torch, is_written=True),
    ArrayFormat(".h5", _read_hdf5),
    ArrayFormat(".hdf5", _read_hdf5),
)
"""In the order of help and errors."""


def event_suffixes() -> tuple[str, ...]:
    """Return the endings of files of events."""
    return tuple(row.suffix for row in EVENT_FORMATS)


def describing_suffixes() -> tuple[str, ...]:
    """Return the endings of files that may be tables about recordings of another kind next to them."""
    return tuple(row.suffix for row in EVENT_FORMATS if row.may_describe)


def times_suffixes() -> tuple[str, ...]:
    """Return the endings of files that say when the recording in a file of events begins and ends."""
    return tuple(row.times_suffix for row in EVENT_FORMATS if row.times_suffix)


def set_suffixes() -> tuple[str, ...]:
    """Return the endings of files that hold several recordings."""
    return tuple(row.suffix for row in ARRAY_FORMATS if row.holds_sets)


def read_suffixes() -> tuple[str, ...]:
    """Return the endings of all files that are read."""
    return (".zip", *(row.suffix for row in ARRAY_FORMATS), *event_suffixes())


def written_suffixes() -> tuple[str, ...]:
    """Return the endings of all files that are written."""
    arrays = (row.suffix for row in ARRAY_FORMATS if row.is_written)
    events = (row.suffix for row in EVENT_FORMATS if row.write)
    return (*arrays, *events, ".zip")


def member_kinds() -> tuple[str, ...]:
    """Return the kinds of files, one per recording, that a folder or archive can be written with.

    ``npy`` are arrays of bins, ``events`` are structured arrays in ``.npy`` files.
    """
    return ("npy", "events", *(row.suffix[1:] for row in EVENT_FORMATS if row.write))


def event_format(suffix: str) -> EventFormat | None:
    """Return the format of files of events with this ending; None if there is none."""
    return next((row for row in EVENT_FORMATS if row.suffix == suffix), None)


def array_format(suffix: str) -> ArrayFormat:
    """Return the format of files of arrays with this ending, which must be in the table."""
    return next(row for row in ARRAY_FORMATS if row.suffix == suffix)
