"""Synthetic touches: equal for equal arguments, with the shape and event rate of the sensor's, and different by class."""

from __future__ import annotations

import runpy
from pathlib import Path

import numpy as np
import pytest

from locsnn_compile.data.read import read_recordings
from locsnn_compile.data.synthetic import synthetic_touches
from locsnn_compile.errors import InputError

EXAMPLES = Path(__file__).parents[2] / "examples"


def test_equal_arguments_give_equal_recordings() -> None:
    first = synthetic_touches(3, steps=50, seed=5)
    assert np.array_equal(synthetic_touches(3, steps=50, seed=5).spikes, first.spikes)
    assert not np.array_equal(synthetic_touches(3, steps=50, seed=6).spikes, first.spikes)
    # A longer set begins with the shorter one.
    assert np.array_equal(synthetic_touches(4, steps=50, seed=5).spikes[:3], first.spikes)


@pytest.mark.parametrize("fingertips", [1, 2])
def test_shape_labels_and_event_rate_are_those_of_the_sensor(fingertips: int) -> None:
    recordings = synthetic_touches(9, steps=250, fingertips=fingertips, classes=4)
    assert recordings.spikes.shape == (9, 250, 78 * fingertips)
    assert recordings.labels is not None
    assert recordings.labels.tolist() == [0, 1, 2, 3, 0, 1, 2, 3, 0]
    events = recordings.spikes.sum(axis=(1, 2)) / fingertips
    assert (events > 2200).all()
    assert (events < 2800).all()


def test_contact_arrives_before_it_leaves() -> None:
    spikes = synthetic_touches(1, steps=250, classes=1).spikes[0].reshape(250, 39, 2)
    # Pressing down, in the first steps of the touch, raises pressure; lifting, in the last, lowers it.
    # Of these steps, more than 8 of 39 taxels have an event.
    rising = np.flatnonzero(spikes[:, :, 0].sum(axis=1) > 8)
    falling = np.flatnonzero(spikes[:, :, 1].sum(axis=1) > 8)
    assert rising.min() < falling.min()
    assert rising.max() < falling.max()


def test_classes_differ_more_than_their_recordings() -> None:
    recordings = synthetic_touches(12, steps=250, classes=3, seed=3)
    assert recordings.labels is not None
    rates = recordings.spikes.reshape(12, 25, 10, 78).mean(axis=2).reshape(12, -1)
    means = np.stack([rates[recordings.labels == label].mean(axis=0) for label in range(3)])
    nearest = ((rates[:, None] - means[None]) ** 2).sum(axis=2).argmin(axis=1)
    assert nearest.tolist() == recordings.labels.tolist()


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
    for name, shape in (
        ("touches.npz", (8, 250, 78)),
        ("touches-long.npz", (4, 325, 78)),
        ("motions.npz", (48, 100, 78)),
        ("two-fingertips.npz", (40, 60, 156)),
    ):
        assert (tmp_path / name).read_bytes() == (EXAMPLES / "recordings" / name).read_bytes()
        assert read_recordings(EXAMPLES / "recordings" / name).spikes.shape == shape
