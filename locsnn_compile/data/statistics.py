"""Figures about recordings: rates, silence, polarity, and the channels that are busy or dead.

They show whether files were read as intended, before anything is trained or compiled on them.
"""

from typing import Any

import numpy as np

from hw_model.values import BoolArray, IntArray
from locsnn_compile.data.recordings import Recordings
from locsnn_compile.data.sensor import POLARITIES, TAXELS, SensorLayout, neutouch

BUSIEST = 5
"""How many of the busiest channels are listed."""


def event_statistics(recordings: Recordings, sensor: SensorLayout | None = None) -> dict[str, Any]:
    """Return figures about recordings as plain values. An event is a bin that is 1.

    Without a ``sensor``, a number of channels that fits whole NeuTouch fingertips is taken to mean them.

    - ``labels``: number of recordings of each class
    - ``rate_hz_per_channel``: None if the width of a bin is not known
    - ``polarity``: shares of the events; None if taxels have one polarity, or if nothing is known of them
    - ``silence``: number of recordings without events; in the others, the number of steps before the first and after
      the last event; and the share of all steps without an event
    - ``binning`` (what reading left out) and ``class_names``: only if there are any
    """
    spikes = recordings.spikes
    samples, steps, channels = spikes.shape
    by_channel = spikes.sum(axis=(0, 1), dtype=np.int64)
    by_recording = spikes.sum(axis=(1, 2), dtype=np.int64)
    total = int(by_recording.sum())
    if sensor is None and channels % (TAXELS * POLARITIES) == 0:
        sensor = neutouch(channels // (TAXELS * POLARITIES))
    has_polarities = sensor is not None and sensor.polarities == POLARITIES and total > 0
    document: dict[str, Any] = {
        "schema": "locsnn-events/1",
        "source": recordings.source,
        "recordings": samples,
        "steps": steps,
        "channels": channels,
        "step_seconds": recordings.step_seconds,
        "labels": _recordings_of_class(recordings),
        "events": {
            "all": total,
            "per_recording": _mean_and_ends(by_recording),
            "share_of_bins": total / spikes.size,
        },
        "rate_hz_per_channel": _rate_hz(recordings, total),
        "silence": _silence(np.any(spikes, axis=2)),
        "polarity": _polarity_shares(by_channel) if has_polarities else None,
        "busiest_channels": _busiest(by_channel, sensor),
        "dead_channels": np.flatnonzero(by_channel == 0).tolist(),
    }
    if recordings.binned is not None:
        document["binning"] = recordings.binned.document()
    if recordings.class_names is not None:
        document["class_names"] = list(recordings.class_names)
    return document


def _recordings_of_class(recordings: Recordings) -> dict[int, int] | None:
    """Return the number of recordings of each class, by its number; None without labels."""
    if recordings.labels is None:
        return None
    labels, counts = np.unique(recordings.labels, return_counts=True)
    return dict(zip(labels.tolist(), counts.tolist(), strict=True))


def _rate_hz(recordings: Recordings, events: int) -> float | None:
    """Return the mean rate of a channel; None if the width of a bin is not known."""
    if recordings.step_seconds is None:
        return None
    return events / (recordings.spikes.size * recordings.step_seconds)


def _silence(has_event: BoolArray) -> dict[str, Any]:
    """Return figures of steps without events, given which steps have some, (samples, steps)."""
    is_empty = ~has_event.any(axis=1)
    not_empty = has_event[~is_empty]
    # argmax returns the first step with an event; of the reversed steps, the last one from the end.
    return {
        "empty_recordings": int(is_empty.sum()),
        "start_steps": _mean_and_ends(not_empty.argmax(axis=1)),
        "end_steps": _mean_and_ends(np.flip(not_empty, axis=1).argmax(axis=1)),
        "share_of_steps": float(1 - has_event.mean()),
    }


def _polarity_shares(by_channel: IntArray) -> dict[str, float]:
    """Return the shares of events of both polarities; the rising channel of a taxel comes first."""
    rising = float(by_channel[::POLARITIES].sum() / by_channel.sum())
    return {"rising": rising, "falling": 1 - rising}


def _busiest(by_channel: IntArray, sensor: SensorLayout | None) -> list[dict[str, Any]]:
    """Return the channels with most events, the busiest first."""
    rows = []
    for channel in np.argsort(-by_channel, kind="stable")[:BUSIEST].tolist():
        events = int(by_channel[channel])
        if events:
            place = channel_place(channel, sensor) if sensor else ""
            rows.append({"channel": channel, "place": place, "events": events})
    return rows


def channel_place(channel: int, sensor: SensorLayout) -> str:
    """Return where a channel lies, as in ``taxel 4 falling``; a surface other than the first is named.

    A taxel of a grid is called by its row and column, counted from 1, and a taxel with a name by that name.
    """
    cell, polarity = divmod(channel, sensor.polarities)
    surface, taxel = divmod(cell, sensor.taxels)
    place = f"taxel {taxel + 1}"
    if sensor.columns is not None:
        place = f"row {taxel // sensor.columns + 1}, column {taxel % sensor.columns + 1}"
    if sensor.names is not None:
        place = sensor.names[taxel]
    kind = "fingertip" if sensor.is_neutouch else "surface"
    if surface:
        place = f"{kind} {surface + 1}, {place}"
    if sensor.polarities == 1:
        return place
    return f"{place} falling" if polarity else f"{place} rising"


def _mean_and_ends(values: IntArray) -> dict[str, float]:
    """Return mean, minimum and maximum over recordings; 0 each if there are none."""
    if not len(values):
        values = np.zeros(1, dtype=np.int64)
    return {"mean": float(values.mean()), "least": int(values.min()), "most": int(values.max())}
