"""Recordings joined to what takes them, by what their channels mean and not by their numbers.

Events and arrays of frames know their pixels and polarities. A network over images knows its own. Where one side does
not know, the numbers are taken as they are, and a sentence among the assumptions says so.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from hw_model.values import ByteArray, IntArray
from locsnn_compile.data.channels import Channels
from locsnn_compile.data.recordings import Expected, Recordings, check_size
from locsnn_compile.data.sensor import SensorLayout
from locsnn_compile.errors import InputError, counted

_MERGE = "Give --merge-polarities to merge them, or recordings of one polarity."
_GRID = "Give --grid WxH of the sensor."


def join_channels(recordings: Recordings, model: Expected) -> Recordings:
    """Return recordings whose channels are numbered as those of the model.

    Events of a smaller extent are placed in the model's grid. ``Recordings.assumed`` says what neither side knew.
    Raises ``InputError`` for recordings of another sensor. Recordings of another number of unknown channels are
    returned as they are.
    """
    if model.channels is None or recordings.origin != "given":
        return recordings
    where = f"recordings {recordings.source!r}"
    channels = recordings.channels
    if channels is None:
        return _taken_as_numbered(recordings, model)
    inputs = model.inputs or _inputs_for(channels, model, where)
    channels = _on_grid(channels, inputs, where)
    _check_polarities(channels, inputs, where, model.whose)
    _check_size(channels, inputs, where, model.whose)
    spikes = _placed(recordings.spikes, channels.places_in(inputs), inputs.count, where)
    joined = replace(recordings, spikes=spikes, channels=inputs)
    if model.inputs is None and model.numbering is None and inputs.polarities > 1:
        sentence = (
            f"The {model.kind} does not say how its inputs are numbered: {inputs.formula} was taken "
            "(--channel-order yxp)."
        )
        return joined.assuming(sentence)
    return joined


def on_one_sensor(parts: Sequence[Recordings]) -> list[Recordings]:
    """Return recordings of one sensor, each read by itself, in the channels that all of them reach.

    Where only events show the size of a sensor, files differ in it. Parts that do not say what their
    channels are keep their number. Raises ``InputError`` for sensors that differ.
    """
    known = [part.channels for part in parts if part.channels is not None]
    sizes = {part.spikes.shape[2] for part in parts}
    if not known or (len({*known}) == len(sizes) == 1 and len(known) == len(parts)):
        return list(parts)
    wanted = _common(known)
    model = Expected(f"recordings {parts[0].source!r}", channels=wanted.count, inputs=wanted)
    return [join_channels(part, model) for part in parts]


def _common(known: Sequence[Channels]) -> Channels:
    """Return the pixels of a sensor: as stated, or else as far as any events reach."""
    stated = [channels for channels in known if not channels.reached]
    grids = [channels for channels in known if channels.is_grid]
    size = next(iter([*stated, *grids, *known]))
    if not stated:
        columns = max(channels.columns for channels in known)
        rows = max(channels.rows for channels in known)
        size = replace(size, columns=columns, rows=rows)
    polarities = max(channels.polarities for channels in known)
    single = {channels.polarity for channels in known}
    if single == {0, 1}:
        polarities = 2
    polarity = next(iter(single)) if polarities == 1 and len(single) == 1 else None
    return replace(size, polarities=polarities, polarity=polarity)


def by_pixel(recordings: Recordings) -> Recordings:
    """Return recordings numbered as files are: by pixel, and then by polarity."""
    known = recordings.channels
    if known is None or known.numbering == "yxp":
        return recordings
    wanted = replace(known, numbering="yxp")
    where = f"recordings {recordings.source!r}"
    spikes = _placed(recordings.spikes, known.places_in(wanted), wanted.count, where)
    return replace(recordings, spikes=spikes, channels=wanted)


def described(recordings: Recordings, sensor: SensorLayout) -> Recordings:
    """Return recordings in bins as those of a sensor; ``InputError`` if they are not.

    Arrays with axes of rows, columns or polarities have to be of its sizes.
    """
    where = f"recordings {recordings.source!r}"
    sensor.check_channels(recordings.spikes.shape[2], where)
    stated, own = sensor.inputs, recordings.channels
    if stated is None:
        return recordings
    if own is not None and own.is_grid and stated.is_grid and own != stated:
        what = f"their axes are not those of sensor {sensor.name!r}"
        fix = "Correct --axes, or the sensor."
        raise InputError(where, what, measured=f"{own.words} against {stated.words}", fix=fix)
    return replace(recordings, channels=stated)


def merged(recordings: Recordings) -> Recordings:
    """Return recordings in which all polarities of a pixel are one channel, which spikes where any of them does."""
    own = recordings.channels
    if own is None:
        what = "it is not known which channels are the polarities of a pixel, so none can be merged"
        fix = "Give --grid WxH, or --channels N, with --polarities 2."
        raise InputError(f"recordings {recordings.source!r}", what, fix=fix)
    if own.polarities == 1:
        return recordings
    spikes = recordings.spikes[:, :, own.numbers().reshape(own.pixels, own.polarities)].max(axis=3)
    of_pixels = Channels(own.columns, own.rows, 1, reached=own.reached)
    return replace(recordings, spikes=spikes, channels=of_pixels)


def _taken_as_numbered(recordings: Recordings, model: Expected) -> Recordings:
    """Return recordings of unknown channels, taken in the numbering of the model."""
    if recordings.spikes.shape[2] != model.channels:
        return recordings
    known = model.inputs
    if known is not None and known.is_grid:
        sentence = (
            f"The recordings do not say which pixel a channel is: their numbers were taken for those of the "
            f"{model.kind}, {known.formula} (--grid or --axes)."
        )
        return replace(recordings, channels=known).assuming(sentence)
    if model.numbering == "pyx":
        sentence = (
            f"The recordings do not say which pixel a channel is: their numbers were taken for those of the "
            f"{model.kind}, in which polarities come first (--grid or --axes)."
        )
        return recordings.assuming(sentence)
    if known is None and model.numbering is None:
        sentence = (
            f"Neither the recordings nor the {model.kind} say what a channel is: channel i was taken for input i "
            "(--grid with --channel-order)."
        )
        return recordings.assuming(sentence)
    return recordings


def _inputs_for(channels: Channels, model: Expected, where: str) -> Channels:
    """Return the inputs of a flat model as pixels of the recordings' sensor; ``InputError`` if they cannot be those."""
    assert model.channels is not None
    size = replace(channels, numbering=model.numbering or "yxp", reached=False, polarity=None)
    if channels.is_grid:
        if size.count == model.channels:
            return size
        if channels.reached:
            measured = f"up to {channels.columns} x {channels.rows} in {counted(model.channels, 'channel')}"
            what = "the width of its grid is not known"
            raise InputError(where, what, measured=measured, fix=_GRID)
        measured = f"{channels.words} against {counted(model.channels, 'channel')}"
        what = f"their pixels are not those of {model.whose}"
        raise InputError(where, what, measured=measured, fix="Give recordings of its sensor.")
    places, rest = divmod(model.channels, channels.polarities)
    if rest or (not channels.reached and places != channels.columns) or places < channels.columns:
        measured = f"{channels.words} against {counted(model.channels, 'channel')}"
        what = f"their channels are not those of {model.whose}"
        raise InputError(where, what, measured=measured, fix="Give recordings of its sensor.")
    return replace(size, columns=places)


def _on_grid(channels: Channels, inputs: Channels, where: str) -> Channels:
    """Return places that are only numbered as pixels of a grid, which are numbered row by row."""
    if channels.is_grid or not inputs.is_grid or channels.columns <= inputs.columns:
        return channels
    if channels.columns > inputs.pixels:
        measured = f"place {channels.columns - 1} against {inputs.columns} x {inputs.rows} pixels"
        what, fix = "a place lies outside the grid", "Give recordings of this sensor."
        raise InputError(where, what, measured=measured, fix=fix)
    return replace(channels, columns=inputs.columns, rows=-(-channels.columns // inputs.columns))


def _check_polarities(channels: Channels, inputs: Channels, where: str, whose: str) -> None:
    """Refuse another number of polarities, unless only one occurs in events that do not say how many there are."""
    if channels.polarities == inputs.polarities or channels.polarity is not None:
        return
    measured = f"{channels.polarities} against {inputs.polarities}"
    fix = _MERGE if inputs.polarities == 1 else "Give recordings of its sensor."
    what = f"they do not have the polarities of {whose}"
    raise InputError(where, what, measured=measured, fix=fix)


def _check_size(channels: Channels, inputs: Channels, where: str, whose: str) -> None:
    """Refuse a sensor of another size, and events that reach beyond the grid."""
    sizes = (channels.columns, channels.rows)
    inside = channels.columns <= inputs.columns and channels.rows <= inputs.rows
    if inside and (channels.reached or sizes == (inputs.columns, inputs.rows)):
        return
    what = f"their sensor is not that of {whose}"
    if channels.reached:
        what = f"their events reach beyond the grid of {whose}"
    measured = f"{channels.words} against {inputs.words}"
    raise InputError(where, what, measured=measured, fix="Give recordings of its sensor.")


def _placed(spikes: ByteArray, places: IntArray, count: int, where: str) -> ByteArray:
    """Return spikes (samples, steps, channels) with channel i at ``places[i]`` of ``count``; the others are silent."""
    samples, steps, channels = spikes.shape
    if channels == count and np.array_equal(places[:channels], np.arange(count)):
        return spikes
    check_size(samples, steps, count, where)
    placed = np.zeros((samples, steps, count), dtype=np.uint8)
    # Recordings may end before the last pixel: the channels after it are silent.
    placed[:, :, places[:channels]] = spikes
    return placed
