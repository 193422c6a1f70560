"""Recordings are joined to a model's inputs by pixel and polarity, whatever the order in which each side numbers them.

A numbering is "yxp" (rows, columns, polarities) or "pyx" (polarities first). Where a side does not know its pixels, the
assumption is reported; contradictions are refused. ``reached=True`` marks columns and rows that are only the largest
places that events reach, as in files that do not state the size of their sensor.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from locsnn_compile.data.channels import Channels, image_channels
from locsnn_compile.data.joining import by_pixel, join_channels, merged
from locsnn_compile.data.recordings import Expected, Recordings
from locsnn_compile.errors import InputError

IMAGE = Channels(columns=4, rows=4, polarities=2, numbering="pyx")
MODEL = Expected("model 'm'", channels=32, inputs=IMAGE)
FLAT = Expected("model 'm'", channels=32)


def numbered(channels: Channels | None, count: int) -> Recordings:
    """Return one recording in which channel i, and no other, spikes in step i."""
    spikes = np.eye(count, dtype=np.uint8)[np.newaxis]
    return Recordings(spikes, labels=None, step_seconds=0.001, source="r", channels=channels)


def inputs_of(recordings: Recordings, model: Expected) -> list[int]:
    """Return the input of a model that each channel becomes."""
    joined = join_channels(recordings, model)
    _, steps, inputs = np.nonzero(joined.spikes)
    assert steps.tolist() == [*range(recordings.spikes.shape[1])]
    return inputs.tolist()


def channel_of(channels: Channels, x: int, y: int, p: int) -> int:
    """Return the channel of a pixel and polarity by the formula of its numbering."""
    if channels.numbering == "yxp":
        return channels.polarities * (channels.columns * y + x) + p
    return channels.columns * channels.rows * p + channels.columns * y + x


def by_hand(channels: Channels, sensor: Channels, first_polarity: int = 0) -> list[int]:
    """Return the channel of the whole sensor that each channel of a part of it is."""
    sensor_channels = {}
    for y in range(channels.rows):
        for x in range(channels.columns):
            for p in range(channels.polarities):
                channel = channel_of(channels, x, y, p)
                sensor_channels[channel] = channel_of(sensor, x, y, p + first_polarity)
    return [sensor_channels[channel] for channel in sorted(sensor_channels)]


@pytest.mark.parametrize("numbering", ["yxp", "pyx"])
@pytest.mark.parametrize(
    "sensor", [IMAGE, Channels(columns=4, rows=4, polarities=2)], ids=["an image", "a grid"]
)
@pytest.mark.parametrize(
    ("columns", "rows", "reached"), [(4, 4, False), (2, 3, True), (3, 2, True), (1, 4, True)]
)
def test_a_pixel_stays_where_it_is(
    numbering: Any, sensor: Channels, columns: int, rows: int, reached: bool
) -> None:
    recorded = Channels(columns, rows, 2, numbering, reached=reached)
    model = Expected("model 'm'", channels=32, inputs=sensor)
    assert inputs_of(numbered(recorded, recorded.count), model) == by_hand(recorded, sensor)


@pytest.mark.parametrize("polarity", [0, 1])
def test_a_single_polarity_keeps_its_number(polarity: int) -> None:
    recorded = Channels(columns=2, rows=3, polarities=1, reached=True, polarity=polarity)
    assert inputs_of(numbered(recorded, 6), MODEL) == by_hand(recorded, IMAGE, polarity)


def test_places_without_rows_are_pixels_row_by_row() -> None:
    """In SLAYER's ``.bs1`` files of an image, x is 4 * row + column."""
    recorded = Channels(columns=11, rows=1, polarities=2, reached=True)
    expected = [16 * p + place for place in range(11) for p in range(2)]
    assert inputs_of(numbered(recorded, 22), MODEL) == expected


@pytest.mark.parametrize(
    ("model", "recorded", "count", "assumptions"),
    [
        pytest.param(
            MODEL, Channels(columns=4, rows=4, polarities=2), 32, (), id="both sides know"
        ),
        pytest.param(
            MODEL,
            None,
            32,
            (
                "The recordings do not say which pixel a channel is: their numbers were taken for those of the model, "
                "16 * polarity + 4 * y + x (--grid or --axes).",
            ),
            id="recordings do not know",
        ),
        pytest.param(
            Expected("program 'm'", channels=32, numbering="pyx"),
            None,
            32,
            (
                "The recordings do not say which pixel a channel is: their numbers were taken for those of the program, "
                "in which polarities come first (--grid or --axes).",
            ),
            id="the order alone is known",
        ),
        pytest.param(
            FLAT,
            Channels(columns=4, rows=4, polarities=2),
            32,
            (
                "The model does not say how its inputs are numbered: 2 * (4 * y + x) + polarity was taken "
                "(--channel-order yxp).",
            ),
            id="the model does not know",
        ),
        pytest.param(
            FLAT,
            None,
            32,
            (
                "Neither the recordings nor the model say what a channel is: channel i was taken for input i (--grid with "
                "--channel-order).",
            ),
            id="neither knows",
        ),
        pytest.param(
            FLAT, Channels(columns=8, rows=4, polarities=1), 32, (), id="one polarity, in one order"
        ),
        pytest.param(
            Expected("model 'm'", channels=32, numbering="pyx"),
            Channels(columns=4, rows=4, polarities=2),
            32,
            (),
            id="the order of the model is known",
        ),
    ],
)
def test_an_assumption_is_reported_if_a_side_does_not_know_its_pixels(
    model: Expected, recorded: Channels | None, count: int, assumptions: tuple[str, ...]
) -> None:
    joined = join_channels(numbered(recorded, count), model)
    assert joined.assumed == assumptions
    # Joining again adds nothing.
    assert join_channels(joined, model).assumed == assumptions


@pytest.mark.parametrize(
    ("model", "recorded", "message"),
    [
        pytest.param(
            MODEL,
            Channels(columns=5, rows=4, polarities=2),
            "their sensor is not that of model 'm' (5 x 4 pixels of 2 polarities against 4 x 4 pixels of 2 polarities). "
            "Give recordings of its sensor.",
            id="another sensor",
        ),
        pytest.param(
            MODEL,
            Channels(columns=3, rows=3, polarities=2),
            "their sensor is not that of model 'm' (3 x 3 pixels of 2 polarities against 4 x 4 pixels of 2 polarities). "
            "Give recordings of its sensor.",
            id="a smaller sensor",
        ),
        pytest.param(
            MODEL,
            Channels(columns=2, rows=5, polarities=2, reached=True),
            "their events reach beyond the grid of model 'm' (2 x 5 pixels of 2 polarities against 4 x 4 pixels of 2 "
            "polarities). Give recordings of its sensor.",
            id="events outside",
        ),
        pytest.param(
            MODEL,
            Channels(columns=17, rows=1, polarities=2, reached=True),
            "a place lies outside the grid (place 16 against 4 x 4 pixels). "
            "Give recordings of this sensor.",
            id="a place outside",
        ),
        pytest.param(
            MODEL,
            Channels(columns=4, rows=4, polarities=1),
            "they do not have the polarities of model 'm' (1 against 2). "
            "Give recordings of its sensor.",
            id="one polarity for two",
        ),
        pytest.param(
            Expected(
                "model 'm'",
                channels=16,
                inputs=Channels(columns=4, rows=4, polarities=1, numbering="pyx"),
            ),
            Channels(columns=4, rows=4, polarities=2),
            "they do not have the polarities of model 'm' (2 against 1). "
            "Give --merge-polarities to merge them, or recordings of one polarity.",
            id="two polarities for one",
        ),
        pytest.param(
            FLAT,
            Channels(columns=4, rows=3, polarities=2),
            "their pixels are not those of model 'm' (4 x 3 pixels of 2 polarities against 32 channels). "
            "Give recordings of its sensor.",
            id="a grid of another size for a flat model",
        ),
        pytest.param(
            FLAT,
            Channels(columns=4, rows=3, polarities=2, reached=True),
            "the width of its grid is not known (up to 4 x 3 in 32 channels). "
            "Give --grid WxH of the sensor.",
            id="a grid of unknown width for a flat model",
        ),
    ],
)
def test_contradictions_are_refused(model: Expected, recorded: Channels, message: str) -> None:
    with pytest.raises(InputError) as caught:
        join_channels(numbered(recorded, recorded.count), model)
    assert str(caught.value) == f"recordings 'r': {message}"


@pytest.mark.parametrize(
    ("shape", "channels"),
    [
        ((2, 34, 34), Channels(columns=34, rows=34, polarities=2, numbering="pyx")),
        ((1, 2, 34, 34), Channels(columns=34, rows=34, polarities=2, numbering="pyx")),
        ((3, 2, 5), Channels(columns=5, rows=2, polarities=3, numbering="pyx")),
        # 156 taxels in a row, with axes of 1 around them.
        ((156,), None),
        ((1, 156), None),
        ((156, 1, 1), None),
    ],
    ids=str,
)
def test_an_input_of_rows_and_columns_is_an_image(
    shape: tuple[int, ...], channels: Channels | None
) -> None:
    assert image_channels(shape) == channels


def test_merged_polarities_are_one_channel_of_each_pixel() -> None:
    rng = np.random.default_rng(0)
    images = (rng.random((2, 5, 2, 3, 4)) < 0.3).astype(np.uint8)
    recordings = Recordings(
        images.reshape(2, 5, 24),
        labels=None,
        step_seconds=0.001,
        source="r",
        channels=Channels(columns=4, rows=3, polarities=2, numbering="pyx"),
    )
    merged_recordings = merged(recordings)
    assert np.array_equal(merged_recordings.spikes, images.max(axis=2).reshape(2, 5, 12))
    assert merged_recordings.channels == Channels(columns=4, rows=3, polarities=1)
    pixels_first = by_pixel(recordings).spikes
    assert np.array_equal(pixels_first, images.transpose(0, 1, 3, 4, 2).reshape(2, 5, 24))


def test_unknown_channels_are_not_merged() -> None:
    with pytest.raises(InputError) as caught:
        merged(numbered(channels=None, count=8))
    assert str(caught.value) == (
        "recordings 'r': it is not known which channels are the polarities of a pixel, so none can be merged. "
        "Give --grid WxH, or --channels N, with --polarities 2."
    )
