"""The recordings of an exploration: those on which settings are compared, and those on which the front is reported.

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
"""The part of divided recordings on which settings are compared."""
REPORTING = "test"
"""The part on which the front is reported."""


class Chosen(Frozen, eq=False):
    """Recordings that were chosen from a source that has ``available`` recordings.

    ``part`` is ``train`` or ``test``, None if the source is not divided. ``file`` gives the same recordings as
    ``--events`` or ``--calibration`` of ``locsnn-compile``; None if no file holds exactly these.
    """

    recordings: Recordings
    available: int
    part: str | None
    file: str | None

    def shared(self, other: "Chosen") -> int:
        """Return how many of these recordings are also among the ``other`` ones.

        Recordings without events are not counted: they are equal without being the same.
        """
        other_contents = {spikes.tobytes() for spikes in other.recordings.spikes}
        return sum(
            bool(spikes.any()) and spikes.tobytes() in other_contents
            for spikes in self.recordings.spikes
        )

    def words(self) -> str:
        """Return a description such as ``64 of 576 recordings of Ev-Objects.zip, train part``."""
        count = len(self.recordings)
        of_available = f" of {self.available}" if count < self.available else ""
        noun = "recordings" if self.available > 1 else "recording"
        part = "" if self.part is None else f", {self.part} part"
        return f"{count}{of_available} {noun} of {self.recordings.source}{part}"


def choose_events(
    network: Network,
    events: str | None,
    part: str | None,
    bound: int | None,
    reading: Mapping[str, Any] | None = None,
) -> Chosen:
    """Return at most ``bound`` of the recordings of ``events``, evenly spread.

    ``events`` is a file or folder; None stands for synthetic recordings. ``part`` is ``train`` or ``test`` of a divided
    archive or folder; None takes train. ``reading``: further arguments of ``read_recordings``, such as the sensor.
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
    if part is None and parts:
        part = CHOOSING
    recordings = read_recordings(events, split=part, model=network.expected, **reading or {})
    # For a divided file, locsnn-compile plays one part as events and calibrates on another, so that
    # naming the file does not reproduce what is measured here, where both are the same recordings.
    file = None if parts else events
    return _bounded(Chosen(recordings, len(recordings), part, file), bound)


def report_events(
    network: Network, events: str, reading: Mapping[str, Any] | None = None
) -> Chosen:
    """Return the recordings to report on: all, or the test part if they are divided."""
    part = REPORTING if recording_parts(events) else None
    chosen = choose_events(network, events, part, bound=None, reading=reading)
    recordings = chosen.recordings
    # Refuse what does not fit before all the work. One recording shows it: all have the same shape.
    network.fit(recordings.spikes[:1], recordings.source)
    check_labels(network, recordings.labels, len(recordings), recordings.source)
    # `locsnn-compile` plays the test part of divided recordings.
    return replace(chosen, file=events)


def _made_up(network: Network) -> Recordings:
    """Return made-up recordings: those that the network carries if they are made up, else synthetic touches.

    Real recordings that a network carries are not used: ``locsnn train`` takes them from the test part.
    """
    carried = network.recordings
    if carried is not None and carried.origin == "made up":
        return carried
    return recordings_for(replace(network, recordings=None), events=None)


def as_read(recordings: Recordings) -> Chosen:
    """Return all of some recordings, for which there is no file: options changed them on reading."""
    return Chosen(recordings, available=len(recordings), part=None, file=None)


def written(chosen: Chosen, path: Path) -> Chosen:
    """Return the same recordings with a file; write one if no file holds exactly these."""
    if chosen.file is not None:
        return chosen
    write_recordings(path, chosen.recordings)
    return replace(chosen, file=str(path))


def _bounded(chosen: Chosen, bound: int | None) -> Chosen:
    """Return at most ``bound`` recordings: the first, the last and others at equal distances.

    Files often hold the recordings of one class after those of another, so the first ones would miss
    classes.
    """
    if bound is None or bound >= chosen.available:
        return chosen
    numbers = np.linspace(0, chosen.available - 1, bound).round().astype(np.int64)
    return replace(chosen, recordings=chosen.recordings.subset(numbers), file=None)
