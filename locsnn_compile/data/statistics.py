"""Figures about recordings: rates, silence, polarity, and the channels that are busy or dead."""

from typing import Any

import numpy as np

from hw_model.values import BoolArray, IntArray
from locsnn_compile.data.recordings import Recordings
from locsnn_compile.data.sensor import POLARITIES, TAXELS, SensorLayout, neutouch

#: Busiest channels that are named.
BUSIEST = 5


def event_statistics(recordings: Recordings, sensor: SensorLayout | None = None) -> dict[str, Any]:
    """Return figures about recordings as plain values. An event is a bin that is 1.

    Without a ``sensor``, a number of channels that fits whole NeuTouch fingertips is taken to mean them.

    - ``labels``: number of recordings of each class
    - ``rate_hz_per_channel``: None if the width of a bin is not known
    - ``polarity``: shares of the events; None if taxels have one polarity, or if nothing is known of them
    - ``silence``: recordings without events; of the others, steps before the first and after the last event; and the
      share of all steps without an event
    - ``binning`` (what reading left out) and ``class_names``: only if there are any
    """
    spikes = recordings.spikes
    samples, steps, channels = spikes.shape
    by_channel = spikes.sum(axis=(0, 1), dtype=np.int64)
    by_recording = spikes.sum(axis=(1, 2), dtype=np.int64)
    active: BoolArray = np.any(spikes, axis=2)
    heard = active[by_recording > 0]
    total, width = int(by_recording.sum()), recordings.step_seconds
    if sensor is None and channels % (TAXELS * POLARITIES) == 0:
        sensor = neutouch(channels // (TAXELS * POLARITIES))
    rises = sensor is not None and sensor.polarities == POLARITIES and total > 0
    rising = float(by_channel[::POLARITIES].sum() / total) if rises else 0.0
    most = [
        channel
        for channel in np.argsort(-by_channel, kind="stable")[:BUSIEST].tolist()
        if by_channel[channel]
    ]
    places = [channel_place(channel, sensor) if sensor else "" for channel in most]
    rows = zip(most, places, by_channel[most].tolist(), strict=True)
    busiest = [
        {"channel": channel, "place": place, "events": count} for channel, place, count in rows
    ]
    labels = None if recordings.labels is None else np.unique(recordings.labels, return_counts=True)
    found: dict[str, Any] = {
        "schema": "locsnn-events/1",
        "source": recordings.source,
        "recordings": samples,
        "steps": steps,
        "channels": channels,
        "step_seconds": width,
        "labels": None
        if labels is None
        else dict(zip(labels[0].tolist(), labels[1].tolist(), strict=True)),
        "events": {
            "all": total,
            "per_recording": _spread(by_recording),
            "share_of_bins": total / spikes.size,
        },
        "rate_hz_per_channel": None
        if width is None
        else total / (samples * channels * steps * width),
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
    which = "fingertip" if sensor.is_neutouch else "surface"
    finger = f"{which} {surface + 1}, " if surface else ""
    return f"{finger}{place}" + (
        "" if sensor.polarities == 1 else " falling" if polarity else " rising"
    )


def _spread(values: IntArray) -> dict[str, float]:
    """Return mean, least and most over recordings; of none, 0."""
    values = values if len(values) else np.zeros(1, dtype=np.int64)
    return {"mean": float(values.mean()), "least": int(values.min()), "most": int(values.max())}
