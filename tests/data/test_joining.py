"""Recordings and models joined by pixel and polarity: what fits, what is refused, and what is said of the rest."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from locsnn_compile.data.channels import Channels, image_channels
from locsnn_compile.data.joining import by_pixel, join_channels, merged
from locsnn_compile.data.recordings import Expected, Recordings
from locsnn_compile.errors import InputError

IMAGE = Channels(4, 4, 2, "pyx")
MODEL = Expected("model 'm'", channels=32, inputs=IMAGE)
FLAT = Expected("model 'm'", channels=32)


def numbered(channels: Channels | None, count: int) -> Recordings:
    """One recording in which channel i, and no other, spikes in step i."""
    spikes = np.eye(count, dtype=np.uint8)[np.newaxis]
    return Recordings(spikes, labels=None, step_seconds=0.001, source="r", channels=channels)


def inputs_of(recordings: Recordings, model: Expected) -> list[int]:
    """Return the input that each channel becomes."""
    joined = join_channels(recordings, model)
    _, steps, inputs = np.nonzero(joined.spikes)
    assert steps.tolist() == [*range(recordings.spikes.shape[1])]
    return inputs.tolist()


def by_hand(channels: Channels, whole: Channels, first_polarity: int = 0) -> list[int]:
    """Return the channels of the whole by the two formulas, written out."""
    places = {}
    for y in range(channels.rows):
        for x in range(channels.columns):
            for p in range(channels.polarities):
                q = p + first_polarity
                source = {
                    "yxp": channels.polarities * (channels.columns * y + x) + p,
                    "pyx": channels.columns * channels.rows * p + channels.columns * y + x,
                }[channels.numbering]
                places[source] = {
                    "yxp": whole.polarities * (whole.columns * y + x) + q,
                    "pyx": whole.columns * whole.rows * q + whole.columns * y + x,
                }[whole.numbering]
    return [places[source] for source in sorted(places)]


@pytest.mark.parametrize("numbering", ["yxp", "pyx"])
@pytest.mark.parametrize("whole", [IMAGE, Channels(4, 4, 2)], ids=["an image", "a grid"])
@pytest.mark.parametrize("size", [(4, 4, False), (2, 3, True), (3, 2, True), (1, 4, True)], ids=str)
def test_a_pixel_stays_where_it_is(numbering: Any, whole: Channels, size: Any) -> None:
    columns, rows, reached = size
    given = Channels(columns, rows, 2, numbering, reached=reached)
    model = Expected("model 'm'", channels=32, inputs=whole)
    assert inputs_of(numbered(given, given.count), model) == by_hand(given, whole)


@pytest.mark.parametrize("polarity", [0, 1])
def test_a_single_polarity_keeps_its_number(polarity: int) -> None:
    given = Channels(2, 3, 1, reached=True, polarity=polarity)
    assert inputs_of(numbered(given, 6), MODEL) == by_hand(given, IMAGE, polarity)


def test_places_without_rows_are_pixels_row_by_row() -> None:
    """SLAYER's ``.bs1`` of an image: x is 4 * row + column."""
    given = Channels(11, 1, 2, reached=True)
    wanted = [16 * p + place for place in range(11) for p in range(2)]
    assert inputs_of(numbered(given, 22), MODEL) == wanted


@pytest.mark.parametrize(
    ("model", "given", "count", "said"),
    [
        pytest.param(MODEL, Channels(4, 4, 2), 32, (), id="both sides know"),
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
            Channels(4, 4, 2),
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
        pytest.param(FLAT, Channels(8, 4, 1), 32, (), id="one polarity, in one order"),
        pytest.param(
            Expected("model 'm'", channels=32, numbering="pyx"),
            Channels(4, 4, 2),
            32,
            (),
            id="told",
        ),
    ],
)
def test_what_one_side_does_not_know_is_said(
    model: Expected, given: Channels | None, count: int, said: tuple[str, ...]
) -> None:
    joined = join_channels(numbered(given, count), model)
    assert joined.assumed == said
    assert join_channels(joined, model).assumed == said


@pytest.mark.parametrize(
    ("model", "given", "message"),
    [
        pytest.param(
            MODEL,
            Channels(5, 4, 2),
            "their sensor is not that of model 'm' (5 x 4 pixels of 2 polarities against 4 x 4 pixels of 2 polarities). "
            "Give recordings of its sensor.",
            id="another sensor",
        ),
        pytest.param(
            MODEL,
            Channels(3, 3, 2),
            "their sensor is not that of model 'm' (3 x 3 pixels of 2 polarities against 4 x 4 pixels of 2 polarities). "
            "Give recordings of its sensor.",
            id="a smaller sensor",
        ),
        pytest.param(
            MODEL,
            Channels(2, 5, 2, reached=True),
            "their events reach beyond the grid of model 'm' (2 x 5 pixels of 2 polarities against 4 x 4 pixels of 2 "
            "polarities). Give recordings of its sensor.",
            id="events outside",
        ),
        pytest.param(
            MODEL,
            Channels(17, 1, 2, reached=True),
            "a place lies outside the grid (place 16 against 4 x 4 pixels). Give recordings of this sensor.",
            id="a place outside",
        ),
        pytest.param(
            MODEL,
            Channels(4, 4, 1),
            "they do not have the polarities of model 'm' (1 against 2). Give recordings of its sensor.",
            id="one polarity for two",
        ),
        pytest.param(
            Expected("model 'm'", channels=16, inputs=Channels(4, 4, 1, "pyx")),
            Channels(4, 4, 2),
            "they do not have the polarities of model 'm' (2 against 1). "
            "Give --merge-polarities to merge them, or recordings of one polarity.",
            id="two polarities for one",
        ),
        pytest.param(
            FLAT,
            Channels(4, 3, 2),
            "their pixels are not those of model 'm' (4 x 3 pixels of 2 polarities against 32 channels). "
            "Give recordings of its sensor.",
            id="a grid of another size for a flat model",
        ),
        pytest.param(
            FLAT,
            Channels(4, 3, 2, reached=True),
            "the width of its grid is not known (up to 4 x 3 in 32 channels). Give --grid WxH of the sensor.",
            id="a grid of unknown width for a flat model",
        ),
    ],
)
def test_contradictions_are_refused(model: Expected, given: Channels, message: str) -> None:
    with pytest.raises(InputError) as caught:
        join_channels(numbered(given, given.count), model)
    assert str(caught.value) == f"recordings 'r': {message}"


@pytest.mark.parametrize(
    ("shape", "channels"),
    [
        ((2, 34, 34), Channels(34, 34, 2, "pyx")),
        ((1, 2, 34, 34), Channels(34, 34, 2, "pyx")),
        ((3, 2, 5), Channels(5, 2, 3, "pyx")),
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
        channels=Channels(4, 3, 2, "pyx"),
    )
    found = merged(recordings)
    assert np.array_equal(found.spikes, images.max(axis=2).reshape(2, 5, 12))
    assert found.channels == Channels(4, 3, 1)
    pixels_first = by_pixel(recordings).spikes
    assert np.array_equal(pixels_first, images.transpose(0, 1, 3, 4, 2).reshape(2, 5, 24))


def test_unknown_channels_are_not_merged() -> None:
    with pytest.raises(InputError) as caught:
        merged(numbered(None, 8))
    assert str(caught.value) == (
        "recordings 'r': it is not known which channels are the polarities of a pixel, so none can be merged. "
        "Give --grid WxH, or --channels N, with --polarities 2."
    )
