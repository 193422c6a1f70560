"""What a row of :mod:`locsnn_compile.data.formats` holds, and what readers and writers are given.

Plain dataclasses that import nothing heavy, because help shows the table.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from hw_model.values import AnyArray, ByteArray
    from locsnn_compile.data.event_stream import EventStream, TimeUnit


@dataclass(frozen=True)
class EventFile:
    """The bytes of a file of single events, and what errors call it.

    ``times`` are the bytes of the file of times next to it, None if there is none. ``time_unit`` is
    that of formats without a unit of their own, None for the usual one.
    """

    data: bytes
    where: str
    times: bytes | None = None
    times_where: str = ""
    time_unit: "TimeUnit | None" = None


@dataclass(frozen=True, eq=False)
class EventsToWrite:
    """One recording to write as single events.

    ``spikes`` are (steps, channels) of 0 and 1, in bins of ``step_seconds``. Its cells have so many
    ``polarities`` and are numbered row by row in ``columns``. Its file is called ``stem``, and
    ``where`` and ``number`` say which recording of which file errors are about.
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
        """Return the events; ``InputError`` for bytes that are none."""


class EventWriter(Protocol):
    """Makes the bytes of a recording."""

    def __call__(self, events: EventsToWrite, /) -> dict[str, bytes]:
        """Return its files by name; ``InputError`` for what the format cannot hold."""


@dataclass(frozen=True)
class EventFormat:
    """A format of files that hold the single events of one recording.

    - ``suffix``: the ending of its files
    - ``read``, ``write``: between bytes and events; None if it is not written
    - ``time_unit``: the unit of its times, which users cannot choose; empty if they do
    - ``times_suffix``: the ending of a file next to it that says when its recording begins and
      ends; empty without such files. With them, users cannot choose the start
    - ``most_bytes``: the largest file
    - ``may_describe``: next to recordings of another kind, its files are tables about these, as
      ``labels.csv``, and no recordings
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
    """The bytes of a file of arrays, and what errors call it.

    ``time_unit`` is that of times in it, None for the usual one of its format.
    """

    data: bytes
    where: str
    time_unit: "TimeUnit | None" = None


@dataclass(frozen=True, eq=False)
class ArrayContent:
    """What a file of arrays holds: arrays by name, and recordings if it has them as events."""

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
    - ``is_written``: recordings can be written to it
    - ``holds_sets``: a file holds a set of recordings whatever its name
    """

    suffix: str
    read: ArrayReader
    is_written: bool = False
    holds_sets: bool = True
