"""What recordings hold, in figures: rates, silence, polarity, and which channels are busy or dead."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from locsnn_compile.data.recordings import Binned, Recordings
from locsnn_compile.data.sensor import POLARITIES, TAXELS

#: Busiest channels that are named.
BUSIEST = 5


@dataclass(frozen=True)
class Spread:
    """Mean, least and most over recordings."""

    mean: float
    least: int
    most: int


@dataclass(frozen=True)
class Channel:
    """One channel: its number, its place on the sensor where there is one, and its events in all recordings."""

    channel: int
    place: str
    events: int


@dataclass(frozen=True)
class Events:
    """All events, those of a recording, and the share of bins with one."""

    all: int
    per_recording: Spread
    share_of_bins: float


@dataclass(frozen=True)
class Silence:
    """Recordings without any event; of the others, steps before the first event and after the last one.

    ``share_of_steps``: of all steps, those without an event.
    """

    empty_recordings: int
    start_steps: Spread
    end_steps: Spread
    share_of_steps: float


@dataclass(frozen=True)
class Polarity:
    """Shares of events."""

    rising: float
    falling: float


@dataclass(frozen=True)
class EventStatistics:
    """Figures of a set of recordings; an event is a bin that is 1.

    ``labels``: recordings of each class. ``rate_hz_per_channel`` is None where the width of a bin is not known,
    ``polarity`` where the channels are no fingertips', ``binning``, what reading left out, where it took everything as
    it is.
    """

    source: str
    recordings: int
    steps: int
    channels: int
    step_seconds: float | None
    labels: dict[int, int] | None
    events: Events
    rate_hz_per_channel: float | None
    silence: Silence
    polarity: Polarity | None
    busiest_channels: tuple[Channel, ...]
    dead_channels: tuple[int, ...]
    binning: Binned | None

    def document(self) -> dict[str, Any]:
        """Return the figures as plain values, for JSON."""
        held = {"schema": "locsnn-events/1", **asdict(self)}
        binning = held.pop("binning")
        return held if self.binning is None else held | {"binning": binning | {"dropped": self.binning.dropped}}


def event_statistics(recordings: Recordings) -> EventStatistics:
    """Return the figures of ``recordings``."""
    spikes = recordings.spikes
    samples, steps, channels = spikes.shape
    by_channel = spikes.sum(axis=(0, 1), dtype=np.int64)
    by_recording = spikes.sum(axis=(1, 2), dtype=np.int64)
    active: NDArray[np.bool_] = np.any(spikes, axis=2)
    heard = active[by_recording > 0]
    total, width = int(by_recording.sum()), recordings.step_seconds
    order = np.argsort(-by_channel, kind="stable")[:BUSIEST].tolist()
    of_sensor = channels % (TAXELS * POLARITIES) == 0
    rising = float(by_channel[::POLARITIES].sum() / total) if of_sensor and total else None
    return EventStatistics(
        source=recordings.source,
        recordings=samples,
        steps=steps,
        channels=channels,
        step_seconds=width,
        labels=None if recordings.labels is None else _counts(recordings.labels),
        events=Events(total, _spread(by_recording), total / spikes.size),
        rate_hz_per_channel=None if width is None else total / (samples * channels * steps * width),
        silence=Silence(
            empty_recordings=int((by_recording == 0).sum()),
            start_steps=_spread(heard.argmax(axis=1)),
            end_steps=_spread(np.flip(heard, axis=1).argmax(axis=1)),
            share_of_steps=float(1 - active.mean()),
        ),
        polarity=None if rising is None else Polarity(rising, 1 - rising),
        busiest_channels=tuple(
            Channel(channel, channel_place(channel) if of_sensor else "", int(by_channel[channel]))
            for channel in order
            if by_channel[channel]
        ),
        dead_channels=tuple(np.flatnonzero(by_channel == 0).tolist()),
        binning=recordings.binned,
    )


def channel_place(channel: int) -> str:
    """Return where a channel of the sensor lies: ``taxel 4 falling``, with its fingertip from the second on."""
    cell, polarity = divmod(channel, POLARITIES)
    fingertip, taxel = divmod(cell, TAXELS)
    finger = f"fingertip {fingertip + 1}, " if fingertip else ""
    return f"{finger}taxel {taxel + 1} {'falling' if polarity else 'rising'}"


def _counts(labels: NDArray[np.int64]) -> dict[int, int]:
    found, counts = np.unique(labels, return_counts=True)
    return dict(zip(found.tolist(), counts.tolist(), strict=True))


def _spread(values: NDArray[np.int64]) -> Spread:
    if not len(values):
        return Spread(0.0, 0, 0)
    return Spread(float(values.mean()), int(values.min()), int(values.max()))
