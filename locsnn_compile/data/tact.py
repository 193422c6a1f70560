"""Raw NeuTouch text, ``.tact``: one event a line, ``polarity cell_index timestamp_seconds``.

VT_SNN's own files have whole seconds, and nanoseconds after them. Of the 80 cells, numbered from 1, numbers 17 and 49
do not exist; the other 78 are the taxels of two fingertips, 39 each. Assumed here, for the files do not say it: cells
1..40 are the first fingertip and 41..80 the second, taxels in the order of their cells; polarity 1 is rising pressure
(polarity 0 of a taxel), 0 or -1 falling (polarity 1).
"""

import math

import numpy as np

from hw_model.values import ByteArray, FloatArray, IntArray
from locsnn_compile.data.event_stream import STEP_SECONDS, EventStream
from locsnn_compile.errors import InputError

CELLS = 80
MISSING_CELLS = (17, 49)
#: The phases whose times a ``.startend`` file gives, in this order; of slip, the first four.
PHASES = ("start", "reaching", "reached", "grasping", "lifting", "holding")
SLIP_PHASES = len(PHASES) - 2
#: Classes of slip in their published order.
SLIP_CLASSES = ("stable", "rotate")
#: How long grasp, lift and hold last together, from ``grasping`` on, and a slip from ``reaching`` on.
GRASP_SECONDS, SLIP_SECONDS = 6.5, 0.15
SLIP_STEP_SECONDS = 0.001

_TAXEL_OF_CELL = {
    cell: taxel for taxel, cell in enumerate(cell for cell in range(1, CELLS + 1) if cell not in MISSING_CELLS)
}
#: Channels of a file: two fingertips of two polarities.
CHANNELS = 2 * len(_TAXEL_OF_CELL)


def parse_tact(data: bytes, where: str, startend: bytes | None, startend_where: str) -> EventStream:
    """Return the events of the bytes of a ``.tact`` file, times in seconds; x counts taxels.

    With the bytes of a ``.startend`` file the recording is the 6.5 s from "grasping", or of the four times of a slip
    the 0.15 s from "reaching", in bins of 1 ms by default; without, it runs from the first event to the last. Raises
    ``InputError`` with the line number of a line that is no event.
    """
    channels, seconds = _parse(data, where)
    start, span_seconds = float(seconds.min()), None
    if startend is not None:
        start, span_seconds = _stretch(startend, startend_where)
    places = channels // 2, np.zeros_like(channels), channels % 2
    width = SLIP_STEP_SECONDS if span_seconds == SLIP_SECONDS else STEP_SECONDS
    return EventStream(seconds, *places, 1, start, span_seconds, CHANNELS, polarities=2, step_seconds=width)


def tact_text(spikes: ByteArray, step_seconds: float) -> bytes:
    """Return the ``.tact`` lines of one recording, (steps, 156): an event a bin, from 0 s on."""
    steps, channels = np.nonzero(spikes)
    cell_of = list(_TAXEL_OF_CELL)
    lines: list[str] = []
    for step, channel in zip(steps.tolist(), channels.tolist(), strict=True):
        # In the middle of the bin, so that rounding moves no event into another one; but where nothing else says when
        # the recording begins, its first event does.
        seconds = (step + (0.5 if lines or step else 0.0)) * step_seconds
        lines.append(f"{1 - channel % 2} {cell_of[channel // 2]} {seconds:.9f}\n")
    return "".join(lines).encode()


def _parse(data: bytes, where: str) -> tuple[IntArray, FloatArray]:
    """Return (channel, seconds) of every event."""
    channels: list[int] = []
    seconds: list[float] = []
    for number, line in enumerate(data.split(b"\n"), start=1):
        fields = line.split()
        if not fields:
            continue
        try:
            polarity, cell, time, *rest = (field.decode("ascii") for field in fields)
            (nanoseconds,) = rest or ("0",)
            event = (int(polarity), int(cell), float(time) + float(nanoseconds) / 1e9)
        except ValueError:
            shown = line.decode("ascii", "replace").strip()[:40]
            raise _fault(where, number, "it is not an event", f"{shown!r}") from None
        if event[0] not in (-1, 0, 1):
            raise _fault(where, number, "its polarity is not 1, 0 or -1", event[0])
        if event[1] not in _TAXEL_OF_CELL:
            cells = f"1..{CELLS} without {MISSING_CELLS[0]} and {MISSING_CELLS[1]}"
            raise _fault(where, number, "there is no such cell", f"{event[1]} against {cells}")
        if not math.isfinite(event[2]):
            raise _fault(where, number, "its time is not finite", event[2])
        channels.append(2 * _TAXEL_OF_CELL[event[1]] + (0 if event[0] == 1 else 1))
        seconds.append(event[2])
    if not seconds:
        raise InputError(where, "no events inside", fix="Give a recording with events.")
    return np.array(channels, dtype=np.int64), np.array(seconds, dtype=np.float64)


def _fault(where: str, line: int, what: str, got: object) -> InputError:
    fix = "Write 'polarity cell_index timestamp_seconds' on it."
    return InputError(f"{where}, line {line}", what, measured=f"got {got}", fix=fix)


def _stretch(data: bytes, where: str) -> tuple[float, float]:
    """Return when a recording begins and how long it is: of lines ``grasping <seconds>``, or of six or four numbers."""
    words = data.decode("ascii", "replace").replace(",", " ").replace(":", " ").split()
    times: list[float] = []
    named: dict[str, float] = {}
    for index, word in enumerate(words):
        try:
            times.append(float(word))
        except ValueError:
            continue
        if index and words[index - 1].lower() in PHASES:
            named[words[index - 1].lower()] = times[-1]
    if len(times) == SLIP_PHASES and not named and math.isfinite(times[1]):
        return times[1], SLIP_SECONDS
    grasping = named.get("grasping", times[3] if len(times) == len(PHASES) and not named else math.nan)
    if not math.isfinite(grasping):
        fix = f"Give the times of {', '.join(PHASES)}."
        raise InputError(where, "it does not give the time of 'grasping'", measured=f"{len(times)} numbers", fix=fix)
    return grasping, GRASP_SECONDS
