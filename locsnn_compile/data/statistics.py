"""What recordings hold, in figures: rates, silence, polarity, and which channels are busy or dead."""

from typing import Any

import numpy as np

from hw_model.arithmetic.arrays import BoolArray, IntArray
from locsnn_compile.data.recordings import Recordings
from locsnn_compile.data.sensor import POLARITIES, TAXELS

#: Busiest channels that are named.
BUSIEST = 5


def event_statistics(recordings: Recordings) -> dict[str, Any]:
    """Return the figures of recordings.

    They are plain values. An event is a bin that is 1. ``labels``: recordings of each class. ``rate_hz_per_channel`` is
    None where the width of a bin is not known, ``polarity``, the shares of events, where channels are not those of
    fingertips. Of ``silence``: recordings without any event; of the others, steps before the first event and after the
    last one; and the share of all steps without one. ``binning``, what reading left out, and ``class_names`` are there
    where there are any.
    """
    spikes = recordings.spikes
    samples, steps, channels = spikes.shape
    by_channel = spikes.sum(axis=(0, 1), dtype=np.int64)
    by_recording = spikes.sum(axis=(1, 2), dtype=np.int64)
    active: BoolArray = np.any(spikes, axis=2)
    heard = active[by_recording > 0]
    total, width = int(by_recording.sum()), recordings.step_seconds
    of_sensor = channels % (TAXELS * POLARITIES) == 0
    rises = of_sensor and total > 0
    rising = float(by_channel[::POLARITIES].sum() / total) if rises else 0.0
    most = [channel for channel in np.argsort(-by_channel, kind="stable")[:BUSIEST].tolist() if by_channel[channel]]
    places = [channel_place(channel) if of_sensor else "" for channel in most]
    rows = zip(most, places, by_channel[most].tolist(), strict=True)
    busiest = [{"channel": channel, "place": place, "events": count} for channel, place, count in rows]
    labels = None if recordings.labels is None else np.unique(recordings.labels, return_counts=True)
    found: dict[str, Any] = {
        "schema": "locsnn-events/1",
        "source": recordings.source,
        "recordings": samples,
        "steps": steps,
        "channels": channels,
        "step_seconds": width,
        "labels": None if labels is None else dict(zip(labels[0].tolist(), labels[1].tolist(), strict=True)),
        "events": {"all": total, "per_recording": _spread(by_recording), "share_of_bins": total / spikes.size},
        "rate_hz_per_channel": None if width is None else total / (samples * channels * steps * width),
        "silence": {
            "empty_recordings": int((by_recording == 0).sum()),
            "start_steps": _spread(heard.argmax(axis=1)),
            "end_steps": _spread(np.flip(heard, axis=1).argmax(axis=1)),
            "share_of_steps": float(1 - active.mean()),
        },
        "polarity": {"rising": rising, "falling": 1 - rising} if rises else None,
        "busiest_channels": busiest,
        "dead_channels": np.flatnonzero(by_channel == 0).tolist(),
    }
    if recordings.binned is not None:
        found["binning"] = recordings.binned.document()
    if recordings.class_names is not None:
        found["class_names"] = list(recordings.class_names)
    return found


def channel_place(channel: int) -> str:
    """Return where a channel of the sensor lies: ``taxel 4 falling``, with its fingertip from the second on."""
    cell, polarity = divmod(channel, POLARITIES)
    fingertip, taxel = divmod(cell, TAXELS)
    finger = f"fingertip {fingertip + 1}, " if fingertip else ""
    return f"{finger}taxel {taxel + 1} {'falling' if polarity else 'rising'}"


def _spread(values: IntArray) -> dict[str, float]:
    """Return mean, least and most over recordings."""
    if not len(values):
        return {"mean": 0.0, "least": 0, "most": 0}
    return {"mean": float(values.mean()), "least": int(values.min()), "most": int(values.max())}
