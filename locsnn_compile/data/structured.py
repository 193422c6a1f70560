"""Structured arrays of events, as Tonic has them: fields ``t`` in microseconds, ``x``, ``y`` if there is one, ``p``."""

import numpy as np
from numpy.typing import NDArray

from hw_model.values import AnyArray, IntArray
from locsnn_compile.data.event_stream import EventStream
from locsnn_compile.errors import InputError

_FIX = "Give the fields t (microseconds), x, y where there is one, and p (0 or 1)."
#: Largest x and y.
MAX_PLACE = 1 << 20
#: The fields that are written; readers take them in any order and of any size.
DTYPE = np.dtype([("t", "<i8"), ("x", "<i8"), ("p", "<i8")])


def parse_structured(array: AnyArray, where: str) -> EventStream:
    """Return the events of a structured array, (events,); polarity -1 counts as 0.

    Raises ``InputError`` for other fields, and for numbers that are no times, places or polarities.
    """
    names = array.dtype.names or ()
    if array.ndim != 1 or not {"t", "x", "p"} <= set(names) <= {"t", "x", "y", "p"}:
        shown = f"fields {', '.join(names)}"[:80] if array.ndim == 1 else f"{array.ndim} axes"
        raise InputError(where, "its values are no events", measured=shown, fix=_FIX)
    times = _whole(array, "t", 0, 2**53, where)
    x = _whole(array, "x", 0, MAX_PLACE, where)
    y = _whole(array, "y", 0, MAX_PLACE, where) if "y" in names else np.zeros_like(x)
    return EventStream(times, x, y, (_whole(array, "p", -1, 1, where) > 0).astype(np.int64))


def _whole(array: AnyArray, name: str, low: int, high: int, where: str) -> IntArray:
    values = array[name]
    if values.ndim != 1 or values.dtype.kind not in "biuf":
        raise InputError(where, f"its field {name!r} is not one number", measured=f"{values.dtype}", fix=_FIX)
    # Written so that NaN is refused too.
    bad = ~((values >= low) & (values <= high) & (values == np.floor(values)))
    if bad.any():
        at = int(bad.argmax())
        measured = f"{values[at]} of event {at} against whole numbers {low}..{high}"
        raise InputError(where, f"its field {name!r} is out of range", measured=measured, fix=_FIX)
    return values.astype(np.int64)


def structured_events(times: IntArray, x: IntArray, polarity: IntArray) -> NDArray[np.void]:
    """Return the structured array of events."""
    events = np.empty(len(times), dtype=DTYPE)
    events["t"], events["x"], events["p"] = times, x, polarity
    return events
