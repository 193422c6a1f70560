"""The recordings of an exploration: those that settings are compared on, and those that the front is reported on.

Choices are not made on test recordings: by default on the train part of a divided archive or folder and, without
events, on synthetic touches, because the recordings in a model may belong to its test part.
"""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from hw_model.values import Frozen
from locsnn_compile.data.read import read_recordings, recording_parts
from locsnn_compile.data.recordings import Recordings
from locsnn_compile.data.write import write_recordings
from locsnn_compile.errors import InputError
from locsnn_compile.network.network import Network
from locsnn_compile.request.recordings import recordings_for
from locsnn_compile.verification.observation import check_labels

CHOOSING = "train"
"""The part of divided recordings that settings are compared on."""
REPORTING = "test"


class Chosen(Frozen, eq=False):
    """Recordings, how many were ``available``, and their ``part``, None if they are not divided.

    ``file`` gives the same recordings as ``--events`` or ``--calibration`` of ``locsnn-compile``; None if no file holds
    exactly these.
    """

    recordings: Recordings
    available: int
    part: str | None
    file: str | None

    def shared(self, other: "Chosen") -> int:
        """Return how many of these recordings, of those with events, are also among others."""
        theirs = {one.tobytes() for one in other.recordings.spikes}
        return sum(bool(one.any()) and one.tobytes() in theirs for one in self.recordings.spikes)

    def words(self) -> str:
        """Return a description such as ``64 of 576 recordings of Ev-Objects.zip, train part``."""
        many = len(self.recordings)
        of = f" of {self.available}" if many < self.available else ""
        part = "" if self.part is None else f", {self.part} part"
        return f"{many}{of} recording{'s' * (self.available > 1)} of {self.recordings.source}{part}"


def choose_events(
    network: Network,
    events: str | None,
    part: str | None,
    bound: int | None,
    reading: Mapping[str, Any] | None = None,
) -> Chosen:
    """Return at most ``bound`` of the recordings of ``events``, evenly spread.

    ``part`` is ``train`` or ``test`` of a divided archive or folder; None takes train. ``reading``: what
    ``read_recordings`` has to know of the sensor.
    """
    if events is None:
        if part is not None:
            raise InputError(
                f"--part {part}",
                "there are no events to take it from",
                fix="Give them with --events.",
            )
        return _bounded(as_read(_made_up(network)), bound)
    parts = recording_parts(events)
    if part is None and parts == (REPORTING,):
        what = "it has only a test part, and no setting may be chosen on that"
        fix = "Give other recordings, or say so with --part test."
        raise InputError(f"events {Path(events).name!r}", what, fix=fix)
    taken = part or (CHOOSING if parts else None)
    recordings = read_recordings(events, split=taken, model=network.expected, **reading or {})
    # For a divided file, locsnn-compile plays one part as events and calibrates on another.
    file = None if parts else events
    return _bounded(Chosen(recordings, len(recordings), taken, file), bound)


def report_events(
    network: Network, events: str, reading: Mapping[str, Any] | None = None
) -> Chosen:
    """Return the recordings to report on: all, or the test part if they are divided."""
    part = REPORTING if recording_parts(events) else None
    chosen = choose_events(network, events, part, None, reading)
    recordings = chosen.recordings
    # What does not fit is refused before all the work.
    network.fit(recordings.spikes[:1], recordings.source)
    check_labels(network, recordings.labels, len(recordings), recordings.source)
    # `locsnn-compile` plays the test part of divided recordings.
    return replace(chosen, file=events)


def _made_up(network: Network) -> Recordings:
    """Return made-up recordings: those of the network's file if it has such, else synthetic touches.

    Others that the network carries are not taken: ``locsnn train`` takes them from the test part.
    """
    carried = network.recordings
    if carried is not None and carried.origin == "made up":
        return carried
    return recordings_for(replace(network, recordings=None), None)


def as_read(recordings: Recordings) -> Chosen:
    """Return all of some recordings, of which no file holds what they became on reading."""
    return Chosen(recordings, len(recordings), None, None)


def written(chosen: Chosen, path: Path) -> Chosen:
    """Return the same recordings with a file; write one if no file holds exactly these."""
    if chosen.file is not None:
        return chosen
    write_recordings(path, chosen.recordings)
    return replace(chosen, file=str(path))


def _bounded(chosen: Chosen, bound: int | None) -> Chosen:
    if bound is None or bound >= chosen.available:
        return chosen
    rows = np.linspace(0, chosen.available - 1, bound).round().astype(np.int64)
    return replace(chosen, recordings=chosen.recordings.subset(rows), file=None)
