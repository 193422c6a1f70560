"""Raw NeuTouch text, ``.tact``: one event per line, ``polarity cell_index timestamp_seconds``.

In VT_SNN's own files, whole seconds are followed by nanoseconds. The 80 cells are numbered from 1, but 17 and 49 do not
exist; the other 78 are the taxels of two fingertips, 39 each. The files do not say more, so we assume that cells 1..40
are the first fingertip and 41..80 the second, with taxels in the order of their cells, and that polarity 1 is rising
pressure (polarity 0 of a taxel), and 0 or -1 falling pressure (polarity 1).
"""

import math
from dataclasses import replace
from decimal import Decimal

import numpy as np

from hw_model.values import ByteArray, IntArray
from locsnn_compile.data.event_stream import EventStream
from locsnn_compile.data.format_rows import EventsToWrite
from locsnn_compile.errors import InputError, counted

CELLS = 80
MISSING_CELLS = (17, 49)
#: The phases whose times a ``.startend`` file gives, in this order; for a slip, the first four.
PHASES = ("start", "reaching", "reached", "grasping", "lifting", "holding")
SLIP_PHASES = len(PHASES) - 2
#: Classes of slip in their published order.
SLIP_CLASSES = ("stable", "rotate")
#: How long grasp, lift and hold last together, starting at ``grasping``, and how long a slip lasts, from ``reaching``.
GRASP_SECONDS, SLIP_SECONDS = 6.5, 0.15
SLIP_STEP_SECONDS = 0.001

_CELL_OF_TAXEL = [cell for cell in range(1, CELLS + 1) if cell not in MISSING_CELLS]
_TAXEL_OF_CELL = {cell: taxel for taxel, cell in enumerate(_CELL_OF_TAXEL)}
_CELLS = f"1 to {CELLS} without {MISSING_CELLS[0]} and {MISSING_CELLS[1]}"
_PLANES = {1: 0, 0: 1, -1: 1}
"""Polarity in a file -> that of a taxel."""
#: Channels of a file: two fingertips with two polarities.
CHANNELS = 2 * len(_TAXEL_OF_CELL)


def parse_tact(data: bytes, where: str, startend: bytes | None, startend_where: str) -> EventStream:
    """Return the events in the bytes of a ``.tact`` file, times in microseconds from its begin; x counts taxels.

    With the bytes of a ``.startend`` file, the recording is the 6.5 s that start at "grasping". If that file has the
    four times of a slip, it is the 0.15 s that start at "reaching", by default in bins of 1 ms. Without such a file, it
    runs from the first event to the last. Raises ``InputError`` with the number of a line that is not an event.
    """
    channels, seconds = _parse(data, where)
    start, span_seconds = (
        (min(seconds), None) if startend is None else _stretch(startend, startend_where)
    )
    times = np.array([float((one - start).scaleb(6)) for one in seconds])
    places = channels // 2, None, channels % 2
    width = SLIP_STEP_SECONDS if span_seconds == SLIP_SECONDS else None
    stream = EventStream(
        times, *places, 0.0, span_seconds, CHANNELS, 2, step_seconds=width, place=where
    )
    way_out = "Give a .startend file next to it, or wider bins."
    return replace(stream, if_too_long=way_out, start_is_fixed=True)


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
    """Return a number as it is written, NaN if a float cannot hold it.

    As a float, a time on the edge of a bin may lie just before it.
    """
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
            polarity, cell, time, *rest = (field.decode("ascii") for field in fields)
            (nanoseconds,) = rest or ("0",)
            channel = 2 * _TAXEL_OF_CELL[int(cell)] + _PLANES[int(polarity)]
            seconds.append(_exact(time) + _exact(nanoseconds).scaleb(-9))
            if not seconds[-1].is_finite():
                raise ValueError
        except (ValueError, KeyError, ArithmeticError):
            place, measured = (
                f"{where}, line {number}",
                f"got {line.decode('ascii', 'replace').strip()[:40]!r}",
            )
            fix = f"Write 'polarity cell_index timestamp_seconds' on it: a polarity of 1, 0 or -1, a cell of {_CELLS}."
            raise InputError(place, "it is not an event", measured=measured, fix=fix) from None
        channels.append(channel)
    if not seconds:
        raise InputError(where, "no events inside", fix="Give a recording with events.")
    return np.array(channels, dtype=np.int64), seconds


def _stretch(data: bytes, where: str) -> tuple[Decimal, float]:
    """Return the begin and length of a recording, from lines ``grasping <seconds>``, or from six or four numbers."""
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
    grasping = named.get(
        "grasping", times[3] if len(times) == len(PHASES) and not named else Decimal("nan")
    )
    if not grasping.is_finite():
        what, measured = "it does not give the time of 'grasping'", counted(len(times), "number")
        raise InputError(
            where, what, measured=measured, fix=f"Give the times of {', '.join(PHASES)}."
        )
    return grasping, GRASP_SECONDS
