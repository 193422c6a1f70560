"""Raw recordings of the tactile sensor NeuTouch: text files ``.tact``, and ``.startend`` files of times next to them.

A ``.tact`` file has one event per line, ``polarity cell_index timestamp_seconds``. In the published files (VT_SNN's),
the line has whole seconds and then nanoseconds. The 80 cells are numbered from 1, but 17 and 49 do not exist; the other
78 are the taxels of two fingertips, 39 each. The files do not say more, so we assume that cells 1..40 are the first
fingertip and 41..80 the second, with taxels in the order of their cells, and that polarity 1 is rising pressure
(polarity 0 of a taxel), and 0 or -1 falling pressure (polarity 1).

In the recordings, a robot grasps, lifts and holds an object (6.5 s), or an object slips in its grasp (0.15 s). A
``.startend`` file gives the times of these phases of the movement.
"""

import math
from decimal import Decimal

import numpy as np

from hw_model.values import ByteArray, IntArray
from locsnn_compile.data.event_stream import EventStream
from locsnn_compile.data.format_rows import EventsToWrite
from locsnn_compile.errors import InputError, counted

CELLS = 80
MISSING_CELLS = (17, 49)
#: The phases of the movement whose times a ``.startend`` file gives, in this order; for a slip, the first four.
PHASES = ("start", "reaching", "reached", "grasping", "lifting", "holding")
SLIP_PHASES = 4
"""How many times there are in the ``.startend`` file of a slip."""
#: Classes of slip in their published order.
SLIP_CLASSES = ("stable", "rotate")
#: How long grasp, lift and hold last together, starting at ``grasping``, and how long a slip lasts, from ``reaching``.
GRASP_SECONDS, SLIP_SECONDS = 6.5, 0.15
SLIP_STEP_SECONDS = 0.001
"""Width of a bin for slips, unless another is stated: a slip then has 150 steps."""

_CELL_OF_TAXEL = [cell for cell in range(1, CELLS + 1) if cell not in MISSING_CELLS]
_TAXEL_OF_CELL = {cell: taxel for taxel, cell in enumerate(_CELL_OF_TAXEL)}
_CELLS = f"1 to {CELLS} without {MISSING_CELLS[0]} and {MISSING_CELLS[1]}"
"""The numbers of cells, in errors."""
_PLANES = {1: 0, 0: 1, -1: 1}
"""Polarity in a file -> that of a taxel."""
#: Channels of a file: two fingertips with two polarities.
CHANNELS = 2 * len(_TAXEL_OF_CELL)


def parse_tact(data: bytes, where: str, startend: bytes | None, startend_where: str) -> EventStream:
    """Return the events in the bytes of a ``.tact`` file, times in microseconds from the beginning; x counts taxels.

    With the bytes of a ``.startend`` file, the recording is the 6.5 s that start at "grasping". If that file has the
    four times of a slip, it is the 0.15 s that start at "reaching", by default in bins of 1 ms. Without such a file, it
    runs from the first event to the last. Raises ``InputError`` with the number of a line that is not an event.
    """
    channels, seconds = _parse(data, where)
    start = min(seconds)
    span_seconds = None
    if startend is not None:
        start, span_seconds = _stretch(startend, startend_where)
    # Subtracted as decimals, because as a float a time on the edge of a bin may lie just before it.
    times = np.array([float((second - start).scaleb(6)) for second in seconds])
    width = SLIP_STEP_SECONDS if span_seconds == SLIP_SECONDS else None
    return EventStream(
        times,
        x=channels // 2,
        y=None,
        polarity=channels % 2,
        start=0.0,
        span_seconds=span_seconds,
        channels=CHANNELS,
        polarities=2,
        step_seconds=width,
        place=where,
        if_too_long="Give a .startend file next to it, or wider bins.",
        start_is_fixed=True,
    )


def tact_text(spikes: ByteArray, step_seconds: float, polarities: int = 2) -> bytes:
    """Return the ``.tact`` lines of one recording, (steps, channels): one event for each bin that is 1, from 0 s on.

    There are at most 78 taxels. If each has one polarity, all of its events are rising.
    """
    steps, channels = np.nonzero(spikes)
    lines: list[str] = []
    for step, channel in zip(steps.tolist(), channels.tolist(), strict=True):
        # In the middle of the bin, so that rounding moves no event into another bin. The first event of a recording is
        # the exception: it may be the only sign of when the recording begins.
        seconds = (step + (0.5 if lines or step else 0.0)) * step_seconds
        lines.append(
            f"{1 - channel % polarities} {_CELL_OF_TAXEL[channel // polarities]} {seconds:.9f}\n"
        )
    return "".join(lines).encode()


def tact_files(events: EventsToWrite) -> dict[str, bytes]:
    """Return the ``.tact`` file of one recording, and the ``.startend`` file that says when it begins.

    Raises ``InputError`` for other than one or two fingertips, and for silence.
    """
    fingertip = len(_TAXEL_OF_CELL) // 2
    taxels = events.spikes.shape[1] // events.polarities
    if taxels not in (fingertip, 2 * fingertip):
        what = "raw text holds one or two fingertips"
        measured = f"{counted(taxels, 'taxel')} against {fingertip} or {2 * fingertip}"
        raise InputError(events.where, what, measured=measured, fix="Write .npz.")
    if not events.spikes.any():
        what = f"recording {events.number} is silent, which raw text cannot express"
        raise InputError(events.where, what, fix="Write .npz.")
    return {
        f"{events.stem}.tact": tact_text(events.spikes, events.step_seconds, events.polarities),
        f"{events.stem}.startend": b"grasping 0\n",
    }


def _exact(text: str) -> Decimal:
    """Return a number exactly as it is written; NaN if a float cannot hold it, ``ValueError`` if it is not a number."""
    return Decimal(text) if math.isfinite(float(text)) else Decimal("nan")


def _parse(data: bytes, where: str) -> tuple[IntArray, list[Decimal]]:
    """Return (channel, seconds) of every event."""
    channels: list[int] = []
    seconds: list[Decimal] = []
    for number, line in enumerate(data.split(b"\n"), start=1):
        fields = line.split()
        if not fields:
            continue
        try:
            polarity, cell, time, *more = (field.decode("ascii") for field in fields)
            # At most one more field: unpacking raises ValueError for others.
            (nanoseconds,) = more or ("0",)
            channel = 2 * _TAXEL_OF_CELL[int(cell)] + _PLANES[int(polarity)]
            seconds.append(_exact(time) + _exact(nanoseconds).scaleb(-9))
            if not seconds[-1].is_finite():
                raise ValueError
        except (ValueError, KeyError, ArithmeticError):
            place = f"{where}, line {number}"
            measured = f"got {line.decode('ascii', 'replace').strip()[:40]!r}"
            fix = f"Write 'polarity cell_index timestamp_seconds' on it: a polarity of 1, 0 or -1, a cell of {_CELLS}."
            raise InputError(place, "it is not an event", measured=measured, fix=fix) from None
        channels.append(channel)
    if not seconds:
        raise InputError(where, "no events inside", fix="Give a recording with events.")
    return np.array(channels, dtype=np.int64), seconds


def _stretch(data: bytes, where: str) -> tuple[Decimal, float]:
    """Return (start, length) of a recording in seconds, from the text of a ``.startend`` file.

    The text has the names of phases, each followed by its time, or just the numbers: six for a grasp,
    four for a slip. Raises ``InputError`` if it does not say when the recording starts.
    """
    words = data.decode("ascii", "replace").replace(",", " ").replace(":", " ").split()
    times: list[Decimal] = []
    named: dict[str, Decimal] = {}
    for index, word in enumerate(words):
        try:
            times.append(_exact(word))
        except (ValueError, ArithmeticError):
            continue
        if index and words[index - 1].lower() in PHASES:
            named[words[index - 1].lower()] = times[-1]
    if len(times) == SLIP_PHASES and not named and times[1].is_finite():
        return times[1], SLIP_SECONDS
    if len(times) == len(PHASES) and not named:
        grasping = times[PHASES.index("grasping")]
    else:
        grasping = named.get("grasping", Decimal("nan"))
    if not grasping.is_finite():
        what = "it does not give the time of 'grasping'"
        measured = counted(len(times), "number")
        raise InputError(
            where, what, measured=measured, fix=f"Give the times of {', '.join(PHASES)}."
        )
    return grasping, GRASP_SECONDS
