"""The train and the test part of one sensor get the same channels, although they are read separately.

Where only events show how large a sensor is, each part alone would have as many channels as its own events reach.
"""

from pathlib import Path

import numpy as np
import pytest

import locsnn_compile as lc
from locsnn_compile.data.read import read_recordings
from locsnn_compile.training.config import TrainingConfig
from locsnn_compile.training.from_python import read_parts

FIELDS = [("x", "i2"), ("y", "i2"), ("t", "i8"), ("p", "i1")]
WIDTH_US = 20_000
"""Width of the default bin, in microseconds."""


def events(*rows: tuple[int, int, int]) -> np.ndarray:
    """Return events (x, y, p), one in each step."""
    return np.array([(x, y, step * WIDTH_US, p) for step, (x, y, p) in enumerate(rows)], FIELDS)


def write(folder: Path, parts: dict[str, np.ndarray]) -> Path:
    """Write a folder of parts, each with one recording of each of two classes."""
    for part, table in parts.items():
        for label in (0, 1):
            (folder / part / str(label)).mkdir(parents=True)
            np.save(folder / part / str(label) / "sample_0.npy", table)
    return folder


def channels_of(recordings, sample: int = 0) -> list[int]:
    """Return the channel of the event in each step of a recording."""
    return [int(np.flatnonzero(step)[0]) for step in recordings.spikes[sample]]


# Channels by hand: 2 (4 y + x) + p on the 4 x 3 pixels that both parts reach together.
NEAR, FAR = events((0, 0, 0), (2, 1, 1), (1, 1, 0)), events((3, 0, 1), (1, 2, 1), (0, 1, 1))
NEAR_CHANNELS, FAR_CHANNELS = [0, 13, 10], [7, 19, 9]


@pytest.mark.parametrize(
    ("train", "test", "channels"),
    [
        pytest.param(NEAR, FAR, (NEAR_CHANNELS, FAR_CHANNELS), id="the test part reaches farther"),
        pytest.param(FAR, NEAR, (FAR_CHANNELS, NEAR_CHANNELS), id="the train part reaches farther"),
    ],
)
def test_parts_get_the_channels_that_both_reach_together(train, test, channels, tmp_path):
    folder = write(tmp_path, {"train": train, "test": test})
    parts = read_parts(folder, TrainingConfig(), start=None)
    # Two recordings of three steps; 4 x 3 pixels with two polarities.
    assert [part.spikes.shape for part in parts] == [(2, 3, 24), (2, 3, 24)]
    assert tuple(map(channels_of, parts)) == channels


def test_parts_with_events_of_different_polarities_get_both(tmp_path):
    off, on = events((0, 0, 0), (1, 1, 0)), events((1, 0, 1), (0, 1, 1))
    folder = write(tmp_path, {"train": off, "test": on})
    parts = read_parts(folder, TrainingConfig(), start=None)
    # Channels by hand: 2 (2 y + x) + p on 2 x 2 pixels.
    assert [channels_of(part) for part in parts] == [[0, 6], [3, 5]]


def test_files_of_one_part_get_the_channels_that_all_reach_together(tmp_path):
    for name, table in (("a", NEAR), ("b", FAR)):
        (tmp_path / "train").mkdir(exist_ok=True)
        np.savez(tmp_path / "train" / f"{name}.npz", **{k: table[k] for k, _ in FIELDS})
    recordings = read_recordings(tmp_path, split="train")
    assert [channels_of(recordings, sample) for sample in (0, 1)] == [NEAR_CHANNELS, FAR_CHANNELS]


LABELS = np.arange(4) % 2
FINGERTIP_CHANNELS = 78  # 39 taxels with two polarities


def bins(channels: int) -> np.ndarray:
    """Recordings (samples, channels, steps) full of events."""
    return np.ones((4, channels, 5), dtype=np.uint8)


def test_parts_of_different_sensors_are_refused_before_training(tmp_path):
    np.savez(tmp_path / "train.npz", spikes=bins(FINGERTIP_CHANNELS), labels=LABELS)
    np.savez(tmp_path / "test.npz", spikes=bins(80), labels=LABELS)
    with pytest.raises(lc.InputError) as caught:
        read_parts(tmp_path, TrainingConfig(), start=None)
    name = tmp_path.name
    assert str(caught.value) == (
        f"recordings '{name}, test.npz': their channels are not those of recordings '{name}, train.npz' "
        "(80 against 78). Give recordings of one sensor."
    )


def test_parts_in_memory_of_different_sensors_are_refused_before_training():
    train, test = (
        lc.Recordings(bins(channels).transpose(0, 2, 1), LABELS, None, source)
        for channels, source in ((FINGERTIP_CHANNELS, "train"), (2 * FINGERTIP_CHANNELS, "test"))
    )
    with pytest.raises(lc.InputError) as caught:
        lc.train(train, {"epochs": 100_000}, test=test)
    assert str(caught.value) == (
        "recordings 'test': their channels are not those of recordings 'train' (156 against 78). "
        "Give recordings of one sensor."
    )
