"""Single events in ``.csv`` files: a line for each, of numbers between commas, semicolons or blanks.

The first line may name the columns. Without names, the column that rises is the time, as in
:mod:`locsnn_compile.data.event_tables`. Lines that begin with ``#`` are comments.
"""

import re

import numpy as np

from locsnn_compile.data.event_formats import parse_events
from locsnn_compile.data.event_stream import EventStream
from locsnn_compile.data.event_tables import is_table
from locsnn_compile.data.format_rows import EventFile
from locsnn_compile.errors import InputError

_FIELDS = {"time": "t", "timestamp": "t", "ts": "t", "polarity": "p", "pol": "p", "on": "p"}
"""Names of columns that tools write, and the fields that they are."""
_COLUMNS = (3, 4)
"""How many columns there are, without y or with it."""
_FIX = "Give lines of t,x,y,p, or of t,x,p."


def parse_csv(file: EventFile) -> EventStream:
    """Return the events of a ``.csv`` file; ``InputError`` for text that is no table of events."""
    try:
        lines = file.data.decode("ascii").splitlines()
    except UnicodeDecodeError as error:
        measured = f"byte {error.start} is {file.data[error.start]}"
        what = "it is not plain text"
        raise InputError(file.where, what, measured=measured, fix=_FIX) from None
    rows = [_separated(line) for line in lines if line.strip() and not line.startswith("#")]
    names = _names(rows[0]) if rows else ()
    numbers = rows[1:] if names else rows
    if not numbers:
        raise InputError(file.where, "it has no events", fix=_FIX)
    width = len(numbers[0].split())
    if width not in _COLUMNS or (names and len(names) != width):
        measured = f"{numbers[0][:40]!r}"
        what = "its lines are not three or four numbers"
        raise InputError(file.where, what, measured=measured, fix=_FIX)
    try:
        table = np.loadtxt(numbers, dtype=np.float64, ndmin=2, comments=None)
    except ValueError:
        what = "its lines are not numbers, as many in each"
        raise InputError(file.where, what, fix=_FIX) from None
    if not names:
        if not is_table(table):
            what = "its columns have no names, and no numbers but 0 and 1"
            raise InputError(file.where, what, fix="Name them t,x,y,p in the first line.")
        return parse_events(table, file.where, file.time_unit)
    fields = np.empty(len(table), dtype=[(name, np.float64) for name in names])
    for name, column in zip(names, table.T, strict=True):
        fields[name] = column
    return parse_events(fields, file.where, file.time_unit)


def _separated(line: str) -> str:
    """Return a line with blanks between its values."""
    return re.sub(r"[,;\t]", " ", line)


def _names(first: str) -> tuple[str, ...]:
    """Return the fields that the first line names; empty if it names none, or one twice.

    A size may follow a name, as in ``x@640``, and a unit, as in ``t[us]``.
    """
    # What precedes an @ or a bracket.
    words = [re.split(r"[@\[(]", word)[0].lower() for word in first.split()]
    if not all(re.fullmatch(r"[a-z_]+", word) for word in words):
        return ()
    names = tuple(_FIELDS.get(word, word) for word in words)
    return names if len(set(names)) == len(names) else ()
