"""Synthetic touches: equal for equal arguments, with the shape and event rate of the sensor's, and different by class.

The sensor is the fingertip NeuTouch: 39 taxels, each with a channel for rising and one for falling pressure. The event
rate is compared with that of the published recordings of objects (Ev-Objects).
"""

from __future__ import annotations

import runpy
from pathlib import Path

import numpy as np
import pytest

from locsnn_compile.data.read import read_recordings
from locsnn_compile.data.sensor import POLARITIES, TAXELS
from locsnn_compile.data.synthetic import synthetic_touches
from locsnn_compile.errors import InputError

EXAMPLES = Path(__file__).parents[2] / "examples"
CHANNELS = TAXELS * POLARITIES
STEPS = 250
"""Steps of a published recording."""
PUBLISHED_EVENTS = 2490
"""Events of a recording of Ev-Objects with one fingertip, on average."""
EVENT_TOLERANCE = 290
"""How far a single recording may be from it: nearly six times the square root of the events. Chosen by hand."""
MANY_TAXELS = 8
"""More taxels than this have an event in a step in which the contact moves down or up. Noise alone causes 0.5 events per
step and polarity. Chosen by hand."""


def test_equal_arguments_give_equal_recordings() -> None:
    first = synthetic_touches(3, steps=50, seed=5)
    assert np.array_equal(synthetic_touches(3, steps=50, seed=5).spikes, first.spikes)
    assert not np.array_equal(synthetic_touches(3, steps=50, seed=6).spikes, first.spikes)
    # A longer set begins with the shorter one.
    assert np.array_equal(synthetic_touches(4, steps=50, seed=5).spikes[:3], first.spikes)


@pytest.mark.parametrize("fingertips", [1, 2])
def test_shape_labels_and_event_rate_are_those_of_the_sensor(fingertips: int) -> None:
    recordings = synthetic_touches(9, steps=STEPS, fingertips=fingertips, classes=4)
    assert recordings.spikes.shape == (9, STEPS, CHANNELS * fingertips)
    assert recordings.labels is not None
    assert recordings.labels.tolist() == [0, 1, 2, 3, 0, 1, 2, 3, 0]
    events_per_fingertip = recordings.spikes.sum(axis=(1, 2)) / fingertips
    assert (np.abs(events_per_fingertip - PUBLISHED_EVENTS) < EVENT_TOLERANCE).all()


def test_contact_arrives_before_it_leaves() -> None:
    recording = synthetic_touches(1, steps=STEPS, classes=1).spikes[0]
    spikes = recording.reshape(STEPS, TAXELS, POLARITIES)
    # Pressing down, in the first steps of the touch, raises pressure; lifting, in the last, lowers it. In both, many
    # taxels have an event at once. The steps of each kind:
    rising = np.flatnonzero(spikes[:, :, 0].sum(axis=1) > MANY_TAXELS)
    falling = np.flatnonzero(spikes[:, :, 1].sum(axis=1) > MANY_TAXELS)
    assert rising.min() < falling.min()
    assert rising.max() < falling.max()


def test_classes_differ_more_than_their_recordings() -> None:
    """Every recording is closest to the mean of its own class, by the rates of its channels in windows of 10 steps."""
    samples = 12
    classes = 3
    window_steps = 10  # chosen by hand
    recordings = synthetic_touches(samples, steps=STEPS, classes=classes, seed=3)
    assert recordings.labels is not None
    windows = recordings.spikes.reshape(samples, STEPS // window_steps, window_steps, CHANNELS)
    rates = windows.mean(axis=2).reshape(samples, -1)
    means = np.stack([rates[recordings.labels == label].mean(axis=0) for label in range(classes)])
    squared_distances = ((rates[:, np.newaxis] - means[np.newaxis]) ** 2).sum(axis=2)
    assert squared_distances.argmin(axis=1).tolist() == recordings.labels.tolist()


@pytest.mark.parametrize(
    ("values", "message"),
    [
        pytest.param(
            {"samples": 0},
            "synthetic touches, 'samples': it is out of range (got 0 against 1..100000). "
            "Correct the number.",
            id="no samples",
        ),
        pytest.param(
            {"seed": -1},
            "synthetic touches, 'seed': it is out of range (got -1 against 0..4294967295). "
            "Correct the number.",
            id="negative seed",
        ),
        pytest.param(
            {"steps": 10**9},
            "synthetic touches, 'steps': it is out of range (got 1000000000 against 1..20000). "
            "Correct the number.",
            id="absurd steps",
        ),
    ],
)
def test_numbers_out_of_range_are_refused(values: dict[str, int], message: str) -> None:
    with pytest.raises(InputError) as caught:
        synthetic_touches(**{"samples": 1, "steps": 5, **values})  # type: ignore[arg-type]
    assert str(caught.value) == message


def test_example_recordings_are_those_that_their_script_writes(tmp_path: Path) -> None:
    runpy.run_path(str(EXAMPLES / "make_recordings.py"))["main"](tmp_path)
    # Shapes are (samples, steps, channels).
    for name, shape in (
        ("touches.npz", (8, STEPS, CHANNELS)),
        ("touches-long.npz", (4, 325, CHANNELS)),
        ("motions.npz", (48, 100, CHANNELS)),
        ("two-fingertips.npz", (40, 60, 2 * CHANNELS)),
    ):
        assert (tmp_path / name).read_bytes() == (EXAMPLES / "recordings" / name).read_bytes()
        assert read_recordings(EXAMPLES / "recordings" / name).spikes.shape == shape
