"""Which recordings settings are compared on, and how ``locsnn-compile`` is told to play the same.

Choices are made on recordings that are not the test part: of an archive or folder that is divided, the train part
unless another is asked for; without events, synthetic touches, for what a model carries may be of its test part.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np

from hw_model.values import Frozen
from locsnn_compile.api import recordings_for
from locsnn_compile.data.read import read_recordings, recording_parts
from locsnn_compile.data.recordings import Recordings
from locsnn_compile.data.write import write_recordings
from locsnn_compile.errors import InputError
from locsnn_compile.network.network import Network

CHOOSING = "train"
"""The part of divided recordings that settings are compared on."""
REPORTING = "test"


class Chosen(Frozen, eq=False):
    """Recordings, ``available`` before they were bounded, and the ``part`` they are of; None where there are none.

    ``file``: what ``--events`` or ``--calibration`` of ``locsnn-compile`` is given for the same ones; None where no
    file holds just these.
    """

    recordings: Recordings
    available: int
    part: str | None
    file: str | None

    def words(self) -> str:
        """Return which recordings these are: ``64 of 576 recordings of Ev-Objects.zip, train part``."""
        many = len(self.recordings)
        of = f" of {self.available}" if many < self.available else ""
        part = "" if self.part is None else f", {self.part} part"
        return f"{many}{of} recording{'s' * (self.available > 1)} of {self.recordings.source}{part}"


def choose_events(network: Network, events: str | None, part: str | None, bound: int | None) -> Chosen:
    """Return the recordings of ``events``, at most ``bound``, evenly spread over them.

    ``part``: ``train`` or ``test`` of a divided archive or folder; None takes train.
    """
    if events is None:
        if part is not None:
            raise InputError(f"--part {part}", "there are no events to take it from", fix="Give them with --events.")
        # None of its own: `locsnn train` lets a model carry recordings of the test part.
        touches = recordings_for(replace(network, recordings=None), None)
        return _bounded(Chosen(touches, len(touches), None, None), bound)
    parts = recording_parts(events)
    if part is None and parts == (REPORTING,):
        what = "it has only a test part, and no setting may be chosen on that"
        fix = "Give other recordings, or say so with --part test."
        raise InputError(f"events {Path(events).name!r}", what, fix=fix)
    taken = part or (CHOOSING if parts else None)
    recordings = read_recordings(events, split=taken, model=network.expected)
    # What is divided means one part as events and another as calibration recordings.
    file = None if parts else events
    return _bounded(Chosen(recordings, len(recordings), taken, file), bound)


def report_events(network: Network, events: str) -> Chosen:
    """Return recordings to report on: all, of what is divided the test part."""
    chosen = choose_events(network, events, REPORTING if recording_parts(events) else None, None)
    # `locsnn-compile` plays the test part of what is divided.
    return replace(chosen, file=events)


def written(chosen: Chosen, path: Path) -> Chosen:
    """Return the same recordings in a file, written where no file holds just these."""
    if chosen.file is not None:
        return chosen
    write_recordings(path, chosen.recordings)
    return replace(chosen, file=str(path))


def _bounded(chosen: Chosen, bound: int | None) -> Chosen:
    if bound is None or bound >= chosen.available:
        return chosen
    rows = np.linspace(0, chosen.available - 1, bound).round().astype(np.int64)
    return replace(chosen, recordings=chosen.recordings.subset(rows), file=None)
