"""The types of the table of formats in :mod:`locsnn_compile.data.formats`.

A row of the table is an :class:`EventFormat` or an :class:`ArrayFormat`. The other types are what a
row's reader and writer take and return. All are plain dataclasses in a module that imports nothing
heavy, because the command line shows the table in its help.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from hw_model.values import AnyArray, ByteArray
    from locsnn_compile.data.event_stream import EventStream, TimeUnit


@dataclass(frozen=True)
class EventFile:
    """The bytes of a file of single events, as its reader gets them.

    - ``data``: the bytes; ``where``: the name of the file in errors
    - ``times``: the bytes of the file next to it that says when the recording begins and ends (see
      ``EventFormat.times_suffix``), None if there is none; ``times_where``: its name in errors
    - ``time_unit``: the unit of times for formats without a unit of their own, None for the usual one
    """

    data: bytes
    where: str
    times: bytes | None = None
    times_where: str = ""
    time_unit: "TimeUnit | None" = None


@dataclass(frozen=True, eq=False)
class EventsToWrite:
    """One recording to write as single events.

    - ``spikes``: (steps, channels) of 0 and 1, in bins of ``step_seconds``
    - ``polarities``: polarities of each cell (pixel or taxel); channel = polarities * cell + polarity
    - ``columns``: width of the grid in which cells are numbered row by row
    - ``stem``: the name of its file without the ending
    - ``where``, ``number``: the file and the number of the recording, for errors
    """

    spikes: "ByteArray"
    step_seconds: float
    polarities: int
    columns: int
    stem: str
    where: str
    number: int


class EventReader(Protocol):
    """Reads the bytes of a file of events."""

    def __call__(self, file: EventFile, /) -> "EventStream":
        """Return the events; ``InputError`` for bytes that are not events of this format."""


class EventWriter(Protocol):
    """Turns a recording into the bytes of its files."""

    def __call__(self, events: EventsToWrite, /) -> dict[str, bytes]:
        """Return name -> bytes of each file; ``InputError`` for what the format cannot hold."""


@dataclass(frozen=True)
class EventFormat:
    """A format of files that hold the single events of one recording.

    - ``suffix``: the ending of its files
    - ``read``: turns bytes into events; ``write``: turns a recording into bytes, None if this format
      is not written
    - ``time_unit``: the unit of its times; empty if the format leaves it open, so that users may choose
    - ``times_suffix``: the ending of a file next to it that says when its recording begins and
      ends; empty without such files. With them, users cannot choose the start
    - ``most_bytes``: the largest file that is read
    - ``may_describe``: whether its files may be tables about recordings of another kind next to them,
      such as ``labels.csv``, rather than recordings
    """

    suffix: str
    read: EventReader
    write: EventWriter | None = None
    time_unit: str = "microseconds"
    times_suffix: str = ""
    most_bytes: int = 100_000_000
    may_describe: bool = False


@dataclass(frozen=True)
class ArrayFile:
    """The bytes of a file of arrays, and its name in errors.

    ``time_unit`` is the unit of times in it, if it holds events; None for the usual one of its format.
    """

    data: bytes
    where: str
    time_unit: "TimeUnit | None" = None


@dataclass(frozen=True, eq=False)
class ArrayContent:
    """The content of a file of arrays.

    - ``entries``: its arrays by name
    - ``streams``: its recordings, one stream each, if it holds events; empty if it holds bins
    """

    entries: "Mapping[str, AnyArray]"
    streams: "list[EventStream]" = field(default_factory=list)


class ArrayReader(Protocol):
    """Reads the bytes of a file of arrays."""

    def __call__(self, file: ArrayFile, /) -> ArrayContent:
        """Return its content; ``InputError`` for bytes that are damaged or of another kind."""


@dataclass(frozen=True)
class ArrayFormat:
    """A format of files that hold arrays.

    - ``suffix``: the ending of its files
    - ``read``: from bytes to arrays
    - ``is_written``: whether recordings can be written to it
    - ``holds_sets``: whether its files in a folder are whole sets of recordings, whatever their names
    """

    suffix: str
    read: ArrayReader
    is_written: bool = False
    holds_sets: bool = True
