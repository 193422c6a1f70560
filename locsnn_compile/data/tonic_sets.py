"""Data sets of the package Tonic as recordings; it is not imported here, only what it returns is read."""

from typing import Any

import numpy as np

from locsnn_compile.data.event_formats import parse_structured
from locsnn_compile.data.event_stream import MAX_EVENTS, Binning, bin_streams
from locsnn_compile.data.recordings import Recordings
from locsnn_compile.errors import InputError, check_most


def from_tonic(
    dataset: Any, *, step_seconds: float | None = None, threshold: int | None = None, steps: int | None = None
) -> Recordings:
    """Return the recordings of a data set of Tonic, or of any sequence of (events, label).

    Events are structured arrays of ``t`` (microseconds), ``x``, (``y``,) ``p``, and become bins as in
    :class:`locsnn_compile.data.event_stream.Binning`. ``sensor_size`` of the data set, (columns, rows, polarities),
    says which channels there are, and ``classes`` names them. Raises ``InputError`` for anything else.
    """
    where, source = f"data set {type(dataset).__name__!r}", type(dataset).__name__
    places = [f"{where}, recording {index}" for index in range(len(dataset))]
    streams, labels, events = [], [], 0
    for index, place in enumerate(places):
        array, label = dataset[index]
        streams.append(parse_structured(np.asarray(array), place))
        labels.append(label)
        events += len(array)
        check_most(events, MAX_EVENTS, where, "it has too many events", fix="Give a part of it.")
    columns, rows, polarities = getattr(dataset, "sensor_size", None) or (None, None, None)
    channels = None if columns is None else columns * rows * polarities
    binning = Binning(step_seconds, threshold, channels, steps, polarities, columns)
    spikes, width, binned = bin_streams(streams, places, where, binning)
    if not all(isinstance(label, int | np.integer) for label in labels):
        raise InputError(where, "its labels are not class numbers", fix="Give a target_transform that makes them so.")
    names = getattr(dataset, "classes", None)
    named = None if names is None else tuple(map(str, names))
    return Recordings(spikes, np.array(labels), width, source, binned=binned, class_names=named)
