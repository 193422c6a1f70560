"""What recordings hold, in figures: rates, silence, polarity, and which channels are busy or dead."""

from __future__ import annotations

from dataclasses import dataclass
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
class EventStatistics:
    """Figures of a set of recordings; an event is a bin that is 1.

    - ``events``, ``silent_start_steps``, ``silent_end_steps`` a recording; recordings without any event are
      ``empty``, and are left out of the silence
    - ``share``: of bins with an event; ``silent_steps``: share of steps without any
    - ``rate_hz``: events of a channel in a second, None where the width of a bin is not known
    - ``rising``: share of events with polarity 0, None where the channels are no fingertips'
    - ``binned``: what reading left out, None where it took everything as it is
    """

    source: str
    recordings: int
    steps: int
    channels: int
    step_seconds: float | None
    labels: dict[int, int] | None
    all_events: int
    empty: int
    events: Spread
    share: float
    rate_hz: float | None
    silent_start_steps: Spread
    silent_end_steps: Spread
    silent_steps: float
    rising: float | None
    busiest: tuple[Channel, ...]
    dead: tuple[int, ...]
    binned: Binned | None

    def document(self) -> dict[str, Any]:
        """Return the figures as plain values, for JSON."""
        return {
            "schema": "locsnn-events/1",
            "source": self.source,
            "recordings": self.recordings,
            "steps": self.steps,
            "channels": self.channels,
            "step_seconds": self.step_seconds,
            "labels": self.labels and {str(label): count for label, count in self.labels.items()},
            "events": {"all": self.all_events, "per_recording": vars(self.events), "share_of_bins": self.share},
            "rate_hz_per_channel": self.rate_hz,
            "silence": {
                "empty_recordings": self.empty,
                "start_steps": vars(self.silent_start_steps),
                "end_steps": vars(self.silent_end_steps),
                "share_of_steps": self.silent_steps,
            },
            "polarity": None if self.rising is None else {"rising": self.rising, "falling": 1 - self.rising},
            "busiest_channels": [vars(channel) for channel in self.busiest],
            "dead_channels": list(self.dead),
            **({} if self.binned is None else {"binning": self.binned.document()}),
        }


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
    return EventStatistics(
        source=recordings.source,
        recordings=samples,
        steps=steps,
        channels=channels,
        step_seconds=width,
        labels=None if recordings.labels is None else _counts(recordings.labels),
        all_events=total,
        empty=int((by_recording == 0).sum()),
        events=_spread(by_recording),
        share=total / spikes.size,
        rate_hz=None if width is None else total / (samples * channels * steps * width),
        silent_start_steps=_spread(heard.argmax(axis=1)),
        silent_end_steps=_spread(np.flip(heard, axis=1).argmax(axis=1)),
        silent_steps=float(1 - active.mean()),
        rising=float(by_channel[::POLARITIES].sum() / total) if of_sensor and total else None,
        busiest=tuple(
            Channel(channel, channel_place(channel) if of_sensor else "", int(by_channel[channel]))
            for channel in order
            if by_channel[channel]
        ),
        dead=tuple(np.flatnonzero(by_channel == 0).tolist()),
        binned=recordings.binned,
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
