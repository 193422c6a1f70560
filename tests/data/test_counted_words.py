"""Messages that count things use the singular for one: ``1 axis``, ``2 axes``."""

import numpy as np
import pytest

import locsnn_compile as lc
from hw_model.errors import counted
from hw_model.values import Shown
from locsnn_compile.data.axes import to_step_major
from locsnn_compile.data.event_formats import parse_slayer_events
from locsnn_compile.data.recordings import Binned
from locsnn_compile.data.sensor import SensorLayout, asked_layout
from locsnn_compile.data.tact import parse_tact
from locsnn_compile.errors import InputError


class _Holds(Shown):
    """A type that prints by ``Shown``, which counts the entries of its dict."""

    values: dict[str, int]


def refused(call, *arguments):
    """Return the message with which a call is refused."""
    with pytest.raises(InputError) as caught:
        call(*arguments)
    return str(caught.value)


@pytest.mark.parametrize(
    ("make_text", "expected"),
    [
        (lambda: counted(number=1, one="axis", many="axes"), "1 axis"),
        (lambda: counted(number=0, one="axis", many="axes"), "0 axes"),
        (lambda: counted(2, "core"), "2 cores"),
        (
            lambda: refused(to_step_major, np.zeros(5), "file 'a.npy'"),
            "file 'a.npy': its shape is not one of recordings (1 axis against 2 to 4). "
            "Give (samples, channels, steps) or (samples, taxels, polarities, steps).",
        ),
        (
            lambda: refused(parse_slayer_events, b"a", ".bs1", "file 'e.bs1'"),
            "file 'e.bs1': it ends within an event (1 byte, 5 per event). Give a whole file.",
        ),
        (
            lambda: Binned(threshold=0, events=1, outside=1, below=0).words,
            "1 of 1 event dropped: 1 outside the steps, 0 in bins of at most 0",
        ),
        (
            lambda: Binned(threshold=0, events=2, outside=1, below=0).words,
            "1 of 2 events dropped: 1 outside the steps, 0 in bins of at most 0",
        ),
        (
            lambda: asked_layout(grid=None, polarities=None, channels=1, layout=None).name,
            "1 channel",
        ),
        (
            lambda: refused(
                lambda: SensorLayout(
                    "skin", taxels=2, polarities=1, columns=1, positions=((0.0, 0.0), (1.0, 0.0))
                )
            ),
            "sensor 'skin': its positions follow from its columns, but others were given (1 "
            "column). Correct the layout of the sensor.",
        ),
        (
            lambda: refused(parse_tact, b"1 2 3\n", "file 'a.tact'", b"1.5\n", "file 'a.startend'"),
            "file 'a.startend': it does not give the time of 'grasping' (1 number). "
            "Give the times of start, reaching, reached, grasping, lifting, holding.",
        ),
        (lambda: repr(_Holds({"a": 1})), "_Holds(values=<1 entry>)"),
    ],
    ids=[
        "one",
        "none",
        "two",
        "axes",
        "bytes",
        "an event",
        "events",
        "a channel",
        "a column",
        "a time",
        "an entry",
    ],
)
def test_one_of_a_kind_is_singular(make_text, expected):
    assert make_text() == expected


def test_one_channel_of_recordings_is_singular():
    network = lc.load("examples/models/two-fingertips.pt")
    assert refused(network.fit, np.zeros((1, 3, 1), np.uint8), "one.npy") == (
        "events 'one.npy': the channel count differs from the model's (1 channel against 156). "
        "Give recordings of 156 channels."
    )
