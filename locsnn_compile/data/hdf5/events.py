"""Events of cameras in HDF5, in the layouts of DSEC and of Prophesee.

    DSEC         events/t, events/x, events/y and events/p, each (events,), and t_offset, at which t is 0
    Prophesee    CD/events, (events,) of the fields x, y, p and t

Times are microseconds. Sources: the formats' own pages, dsec.ifi.uzh.ch/data-format and
docs.prophesee.ai, HDF5 event files.
"""

import numpy as np

from hw_model.values import AnyArray
from locsnn_compile.data.hdf5.read import Group
from locsnn_compile.errors import InputError, check_same, listed

_COLUMNS = ("t", "x", "y", "p")
_OFFSET = "t_offset"


def camera_events(root: Group) -> AnyArray | None:
    """Return the events of a file, (events,) of fields t, x, y and p; None for files of other layouts.

    Raises ``InputError`` for a group ``events`` of other names, and for columns of different lengths.
    """
    names = root.names()
    if "events" in names and root.is_group("events"):
        return _columns(root)
    if "CD" in names and root.is_group("CD"):
        return root.group("CD", f"{root.where}, 'CD'").records("events", _COLUMNS)
    return None


def _columns(root: Group) -> AnyArray:
    """Return the events of the four datasets of the group ``events``."""
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
        columns["t"] = columns["t"] + root.array(_OFFSET).reshape(-1)[:1]
    fields = [(name, column.dtype) for name, column in columns.items()]
    events = np.empty(len(columns["t"]), fields)
    for name, column in columns.items():
        fix = "Give as many of t, x, y and p."
        check_same(column.shape, events.shape, f"{where}, {name!r}", "its size is another", fix=fix)
        events[name] = column
    return events
