"""HDF5 files of recordings: arrays by name, or spike times as Heidelberg's data sets (SHD, SSC) have them."""

from pathlib import Path

import numpy as np

from hw_model.values import AnyArray
from locsnn_compile.data.event_stream import MICROSECONDS, EventStream
from locsnn_compile.data.hdf5.read import Group, open_hdf5
from locsnn_compile.data.structured import MAX_PLACE
from locsnn_compile.errors import InputError

HDF5_SUFFIXES = (".h5", ".hdf5")
_TEXTS = ("class_names", "axes")


def read_hdf5(path: Path, where: str) -> tuple[dict[str, AnyArray], list[EventStream]]:
    """Return the arrays at the root of a file by name, and the recordings of its group ``spikes``, if it has one.

    ``spikes/times`` and ``spikes/units`` hold a row a recording: seconds, and numbers of channels from 0;
    ``extra/keys`` are the names of the classes. Raises ``InputError`` for rows that are none of these.
    """
    with open_hdf5(path, where) as (root, _):
        values = [name for name in root.names() if not root.is_group(name)]
        entries = {name: np.array(root.texts(name)) if name in _TEXTS else root.array(name) for name in values}
        if "extra" in root and root.is_group("extra") and "keys" in (extra := root.group("extra")):
            entries.setdefault("class_names", np.array(extra.texts("keys")))
        streams = _streams(root.group("spikes"), where) if "spikes" in root and "spikes" not in values else []
    return entries, streams


def _streams(group: Group, where: str) -> list[EventStream]:
    times, units = group.rows("times"), group.rows("units")
    if [len(row) for row in times] != [len(row) for row in units]:
        raise InputError(where, "its times and units differ in number", fix="Give a time and a unit for each spike.")
    streams = []
    for index, (row, unit) in enumerate(zip(times, units, strict=True)):
        # Written so that NaN is refused too.
        good = (row >= 0) & (row < 1e9) & (unit >= 0) & (unit < MAX_PLACE) & (unit == np.floor(unit))
        if not good.all():
            at = int(np.argmin(good))
            measured, fix = f"spike {at}: {row[at]} s, unit {unit[at]}", "Give seconds from 0 on, and whole numbers."
            raise InputError(f"{where}, recording {index}", "it holds no time and channel", measured=measured, fix=fix)
        none = np.zeros(len(row), dtype=np.int64)
        streams.append(EventStream(np.rint(row * MICROSECONDS).astype(np.int64), unit.astype(np.int64), none, none))
    return streams
