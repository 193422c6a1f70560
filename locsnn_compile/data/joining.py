"""Renumber the channels of recordings for the model that takes them, by pixel and polarity.

Channel 5 of a recording and input 5 of a network need not be the same pixel. Events and arrays of frames know which
pixel and polarity each channel is, and a network over images knows it of its inputs; where both know, channels are
joined by pixel and polarity. Where one side does not know, channel i is taken for input i, and a sentence among the
recordings' assumptions says so.
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
    """Return recordings whose channels are numbered as the inputs of the model.

    Events that reach only a part of the model's grid are placed in it. ``Recordings.assumed`` says what neither side
    knew. Raises ``InputError`` for recordings of another sensor. Recordings that do not know their pixels and have
    another number of channels than the model are returned unchanged: whoever plays them refuses them.
    """
    if model.channels is None or recordings.origin != "given":
        return recordings  # Recordings that are not the user's were made for the model.
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
    """Return recordings of one sensor that were read from several files, all with the same channels.

    If only events show the size of the sensor, each file may have another. Files that do not say which pixels their
    channels are keep their number of channels. Raises ``InputError`` for files of different sensors.
    """
    known = [part.channels for part in parts if part.channels is not None]
    sizes = {part.spikes.shape[2] for part in parts}
    are_alike = len({*known}) == len(sizes) == 1 and len(known) == len(parts)
    if not known or are_alike:
        return list(parts)
    common = _common(known)
    # Each file is joined to the common sensor as if that were the inputs of a model.
    model = Expected(f"recordings {parts[0].source!r}", channels=common.count, inputs=common)
    return [join_channels(part, model) for part in parts]


def _common(known: Sequence[Channels]) -> Channels:
    """Return the pixels of the sensor that several files share.

    Its size is the stated one, or else as far as the events of any file reach. It has two polarities
    if a file does, or if different files have events of different polarities.
    """
    stated = [channels for channels in known if not channels.reached]
    grids = [channels for channels in known if channels.is_grid]
    # The first that states a size, else the first grid, else the first.
    size = next(iter([*stated, *grids, *known]))
    if not stated:
        columns = max(channels.columns for channels in known)
        rows = max(channels.rows for channels in known)
        size = replace(size, columns=columns, rows=rows)
    polarities = max(channels.polarities for channels in known)
    single_polarities = {channels.polarity for channels in known}
    if single_polarities == {0, 1}:
        polarities = 2
    polarity = None
    if polarities == 1 and len(single_polarities) == 1:
        (polarity,) = single_polarities
    return replace(size, polarities=polarities, polarity=polarity)


def by_pixel(recordings: Recordings) -> Recordings:
    """Return recordings with channels in the numbering of files, ``yxp``: by pixel, and then by polarity."""
    known = recordings.channels
    if known is None or known.numbering == "yxp":
        return recordings
    in_files = replace(known, numbering="yxp")
    where = f"recordings {recordings.source!r}"
    spikes = _placed(recordings.spikes, known.places_in(in_files), in_files.count, where)
    return replace(recordings, spikes=spikes, channels=in_files)


def described(recordings: Recordings, sensor: SensorLayout) -> Recordings:
    """Return recordings whose channels are the pixels of a sensor that an option describes.

    Raises ``InputError`` if they have another number of channels, or if their file had axes of rows and columns that
    are not those of the sensor.
    """
    where = f"recordings {recordings.source!r}"
    sensor.check_channels(recordings.spikes.shape[2], where)
    stated = sensor.inputs
    of_file = recordings.channels
    if stated is None:
        return recordings
    if of_file is not None and of_file.is_grid and stated.is_grid and of_file != stated:
        what = f"their axes are not those of sensor {sensor.name!r}"
        fix = "Correct --axes, or the sensor."
        raise InputError(where, what, measured=f"{of_file.words} against {stated.words}", fix=fix)
    return replace(recordings, channels=stated)


def merged(recordings: Recordings) -> Recordings:
    """Return recordings in which both polarities of a pixel are one channel, which spikes whenever either does."""
    sensor = recordings.channels
    if sensor is None:
        what = "it is not known which channels are the polarities of a pixel, so none can be merged"
        fix = "Give --grid WxH, or --channels N, with --polarities 2."
        raise InputError(f"recordings {recordings.source!r}", what, fix=fix)
    if sensor.polarities == 1:
        return recordings
    channels_of_pixel = sensor.numbers().reshape(sensor.pixels, sensor.polarities)
    spikes = recordings.spikes[:, :, channels_of_pixel].max(axis=3)
    of_pixels = Channels(sensor.columns, sensor.rows, 1, reached=sensor.reached)
    return replace(recordings, spikes=spikes, channels=of_pixels)


def _taken_as_numbered(recordings: Recordings, model: Expected) -> Recordings:
    """Return recordings of unknown pixels, taking channel i for input i of the model.

    If that is an assumption, its sentence is added: the model may have a grid (``inputs``), only an order of its axes
    (``numbering``), or nothing. A model of a row of taxels needs no sentence: its inputs are only numbers as well.
    """
    if recordings.spikes.shape[2] != model.channels:
        return recordings
    inputs = model.inputs
    if inputs is not None and inputs.is_grid:
        sentence = (
            f"The recordings do not say which pixel a channel is: their numbers were taken for those of the "
            f"{model.kind}, {inputs.formula} (--grid or --axes)."
        )
        return replace(recordings, channels=inputs).assuming(sentence)
    if model.numbering == "pyx":
        sentence = (
            f"The recordings do not say which pixel a channel is: their numbers were taken for those of the "
            f"{model.kind}, in which polarities come first (--grid or --axes)."
        )
        return recordings.assuming(sentence)
    if inputs is None and model.numbering is None:
        sentence = (
            f"Neither the recordings nor the {model.kind} say what a channel is: channel i was taken for input i "
            "(--grid with --channel-order)."
        )
        return recordings.assuming(sentence)
    return recordings


def _inputs_for(channels: Channels, model: Expected, where: str) -> Channels:
    """Return the inputs of a model that does not know its pixels, as pixels of the recordings' sensor.

    Raises ``InputError`` if the number of inputs is not that of such pixels.
    """
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
    # A row of taxels: the model may have more of them only if the recordings' size is just the reach
    # of their events.
    places, remainder = divmod(model.channels, channels.polarities)
    if (
        remainder
        or (not channels.reached and places != channels.columns)
        or places < channels.columns
    ):
        measured = f"{channels.words} against {counted(model.channels, 'channel')}"
        what = f"their channels are not those of {model.whose}"
        raise InputError(where, what, measured=measured, fix="Give recordings of its sensor.")
    return replace(size, columns=places)


def _on_grid(channels: Channels, inputs: Channels, where: str) -> Channels:
    """Return a row of numbered places as pixels of the inputs' grid, which is numbered row by row.

    Other channels are returned unchanged.
    """
    if channels.is_grid or not inputs.is_grid or channels.columns <= inputs.columns:
        return channels
    if channels.columns > inputs.pixels:
        measured = f"place {channels.columns - 1} against {inputs.columns} x {inputs.rows} pixels"
        what, fix = "a place lies outside the grid", "Give recordings of this sensor."
        raise InputError(where, what, measured=measured, fix=fix)
    return replace(channels, columns=inputs.columns, rows=-(-channels.columns // inputs.columns))


def _check_polarities(channels: Channels, inputs: Channels, where: str, whose: str) -> None:
    """Refuse recordings with another number of polarities than the model has.

    Events in which only one polarity occurs, without a statement how many there are, fit any number.
    """
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
    """Return spikes (samples, steps, ``count``) with channel i moved to ``places[i]``; other channels are silent."""
    samples, steps, channels = spikes.shape
    if channels == count and np.array_equal(places[:channels], np.arange(count)):
        return spikes  # Nothing moves.
    check_size(samples, steps, count, where)
    placed = np.zeros((samples, steps, count), dtype=np.uint8)
    # Recordings may end before the last pixel: the channels after it are silent.
    placed[:, :, places[:channels]] = spikes
    return placed
