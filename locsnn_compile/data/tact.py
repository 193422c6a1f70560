"""Raw NeuTouch text, ``.tact``: one event a line, ``polarity cell_index timestamp_seconds``.

Of the 80 cells, numbered from 1, numbers 17 and 49 do not exist; the other 78 are the taxels of two
fingertips, 39 each. Assumed here, for the files do not say it: cells 1..40 are the first fingertip and 41..80
the second, taxels in the order of their cells; polarity 1 is rising pressure (polarity 0 of a taxel), 0 or -1
falling (polarity 1).
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from locsnn_compile.data.arrays import label_in_name
from locsnn_compile.data.recordings import Recordings
from locsnn_compile.data.torch_file import read_bytes
from locsnn_compile.errors import InputError
from locsnn_compile.models.description import MAX_STEPS

CELLS = 80
MISSING_CELLS = (17, 49)
#: The phases whose times a ``.startend`` file gives, in this order.
PHASES = ("start", "reaching", "reached", "grasping", "lifting", "holding")
#: Length of grasp, lift and hold together, from the time of ``grasping``.
GRASP_SECONDS = 6.5
STEP_SECONDS = 0.02

_TAXEL_OF_CELL = {
    cell: taxel for taxel, cell in enumerate(cell for cell in range(1, CELLS + 1) if cell not in MISSING_CELLS)
}


def read_tact(path: Path, *, step_seconds: float | None = None, threshold: int = 1) -> Recordings:
    """Return the one recording of a ``.tact`` file: (1, steps, 156).

    A bin of ``step_seconds`` (0.02 by default; slip data use 0.001) is 1 where a cell has more than
    ``threshold`` events of a polarity in it. With a ``.startend`` file beside it the recording is the 6.5 s
    from "grasping"; without one it runs from the first event to the last. ``_label_<k>`` in the name gives
    the label. Raises ``InputError`` with the line number of a line that is no event.
    """
    width = STEP_SECONDS if step_seconds is None else step_seconds
    where = f"file {path.name!r}"
    channels, seconds = _parse(read_bytes(path, where), where)
    beside = path.with_suffix(".startend")
    start = float(seconds.min())
    span_seconds = float(seconds.max()) - start
    if beside.exists():
        start, span_seconds = _grasping_seconds(beside), GRASP_SECONDS - width / 2
    if not span_seconds / width < MAX_STEPS:
        raise InputError(
            where,
            "it lasts too long for its bins",
            measured=f"{span_seconds:g} s in bins of {width:g} s against {MAX_STEPS} bins",
            fix="Give a .startend file beside it, or wider bins.",
        )
    steps = math.floor(span_seconds / width) + 1
    # Absurd times overflow to infinity, which lies outside like any other time that is too late.
    with np.errstate(over="ignore"):
        bins = np.floor((seconds - start) / width)
    inside = (bins >= 0) & (bins < steps)
    counts = np.zeros((steps, 2 * len(_TAXEL_OF_CELL)), dtype=np.int64)
    np.add.at(counts, (bins[inside].astype(np.int64), channels[inside]), 1)
    label = label_in_name(path.name)
    labels = None if label is None else np.array([label], dtype=np.int64)
    return Recordings((counts > threshold).astype(np.uint8)[np.newaxis], labels, width, path.name)


def read_tact_folder(path: Path, *, step_seconds: float | None = None, threshold: int = 1) -> Recordings:
    """Return the recordings of all ``.tact`` files of a folder, by name, with labels where every name has one.

    Raises ``InputError`` for an unusable file and for recordings of different length: ``.startend`` files beside
    them give all the same.
    """
    files = sorted(path.glob("*.tact"))
    found = [read_tact(file, step_seconds=step_seconds, threshold=threshold) for file in files]
    for file, one in zip(files, found, strict=True):
        if one.spikes.shape != found[0].spikes.shape:
            raise InputError(
                f"folder {path.name!r}, {file.name!r}",
                "it is not as long as the other recordings",
                measured=f"{one.spikes.shape[1]} against {found[0].spikes.shape[1]} steps",
                fix="Give .startend files beside them.",
            )
    labels = [one.labels for one in found if one.labels is not None]
    return Recordings(
        np.concatenate([one.spikes for one in found]),
        np.concatenate(labels) if len(labels) == len(found) else None,
        found[0].step_seconds,
        path.name,
    )


def _parse(data: bytes, where: str) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Return (channel, seconds) of every event."""
    channels: list[int] = []
    seconds: list[float] = []
    fix = "Write 'polarity cell_index timestamp_seconds' on it."
    for number, line in enumerate(data.split(b"\n"), start=1):
        fields = line.split()
        if not fields:
            continue
        place = f"{where}, line {number}"
        try:
            polarity, cell, time = (field.decode("ascii") for field in fields)
            event = (int(polarity), int(cell), float(time))
        except ValueError:
            shown = line.decode("ascii", "replace").strip()[:40]
            raise InputError(place, "it is no event", measured=f"got {shown!r}", fix=fix) from None
        if event[0] not in (-1, 0, 1):
            raise InputError(place, "its polarity is not 1, 0 or -1", measured=f"got {event[0]}", fix=fix)
        if event[1] not in _TAXEL_OF_CELL:
            raise InputError(
                place,
                "there is no such cell",
                measured=f"got {event[1]} against 1..{CELLS} without {MISSING_CELLS[0]} and {MISSING_CELLS[1]}",
                fix=fix,
            )
        if not math.isfinite(event[2]):
            raise InputError(place, "its time is not finite", measured=f"got {event[2]}", fix=fix)
        channels.append(2 * _TAXEL_OF_CELL[event[1]] + (0 if event[0] == 1 else 1))
        seconds.append(event[2])
    if not seconds:
        raise InputError(where, "no events inside", fix="Give a recording with events.")
    return np.array(channels, dtype=np.int64), np.array(seconds, dtype=np.float64)


def _grasping_seconds(path: Path) -> float:
    """Return the time of "grasping": of a line ``grasping <seconds>``, or the fourth of six plain numbers."""
    where = f"file {path.name!r}"
    words = read_bytes(path, where).decode("ascii", "replace").replace(",", " ").replace(":", " ").split()
    times: list[float] = []
    named: dict[str, float] = {}
    for index, word in enumerate(words):
        try:
            times.append(float(word))
        except ValueError:
            continue
        if index and words[index - 1].lower() in PHASES:
            named[words[index - 1].lower()] = times[-1]
    grasping = named.get("grasping", times[3] if len(times) == len(PHASES) and not named else math.nan)
    if not math.isfinite(grasping):
        raise InputError(
            where,
            "it does not give the time of 'grasping'",
            measured=f"{len(times)} numbers",
            fix=f"Give the times of {', '.join(PHASES)}.",
        )
    return grasping
