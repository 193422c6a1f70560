"""Find the events of an event camera in an HDF5 file, in the layouts of DSEC and of Prophesee.

    DSEC         events/t, events/x, events/y and events/p, each (events,), and t_offset at the root
    Prophesee    CD/events, (events,) of the fields x, y, p and t (CD stands for contrast detection)

Times are microseconds; those of DSEC count from t_offset. Column x, row y, polarity p (1 is brighter).
Only the place and the lengths of the columns are checked here; the reader of files of arrays passes
the result on to ``parse_events``, which checks the values. Sources: the formats' own pages,
dsec.ifi.uzh.ch/data-format and docs.prophesee.ai, HDF5 event files.
"""

import numpy as np

from hw_model.values import AnyArray
from locsnn_compile.data.hdf5.read import Group
from locsnn_compile.errors import InputError, check_same, listed

_COLUMNS = ("t", "x", "y", "p")
_OFFSET = "t_offset"
"""The dataset of the time at which ``events/t`` is 0; files without it count from 0."""


def camera_events(root: Group) -> AnyArray | None:
    """Return the events of a file, (events,) of fields t, x, y and p; None for files of other layouts.

    Raises ``InputError`` for a group ``events`` without one of these names, for columns of different
    lengths, and for a group ``CD`` without records of these fields.
    """
    names = root.names()
    if "events" in names and root.is_group("events"):
        return _columns(root)
    if "CD" in names and root.is_group("CD"):
        return root.group("CD", f"{root.where}, 'CD'").records("events", _COLUMNS)
    return None


def _columns(root: Group) -> AnyArray:
    """Return the four datasets of DSEC's group ``events`` as one array with four fields."""
    where = f"{root.where}, 'events'"
    group = root.group("events", where)
    missing = [name for name in _COLUMNS if name not in group]
    if missing:
        measured = f"it has {listed([*map(repr, group.names())]) or 'nothing'}"[:120]
        what = f"it lacks {listed([*map(repr, missing)])}"
        fix = "Call times, columns, rows and polarities t, x, y and p, as DSEC does."
        raise InputError(where, what, measured=measured, fix=fix)
    columns = {name: group.array(name) for name in _COLUMNS}
    if _OFFSET in root:
        # A scalar or an array of one entry, depending on the tool that wrote the file.
        offset_us = root.array(_OFFSET).reshape(-1)[:1]
        columns["t"] = columns["t"] + offset_us
    fields = [(name, column.dtype) for name, column in columns.items()]
    events = np.empty(len(columns["t"]), fields)
    for name, column in columns.items():
        # Before the assignment, which would repeat a column of one entry for all events.
        fix = "Give as many of t, x, y and p."
        check_same(column.shape, events.shape, f"{where}, {name!r}", "its size is another", fix=fix)
        events[name] = column
    return events
