"""Event data as others have it: N-MNIST's folders of ``.bin``."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from locsnn_compile.data import read_recordings, recording_parts
from locsnn_compile.data.sensor import SensorLayout
from locsnn_compile.errors import InputError

SENSOR = SensorLayout("34x34", 34 * 34, 2, columns=34)
EVENTS = [(0, 5, 7, 1), (20_000, 33, 33, 0), (59_999, 0, 0, 1)]
"""Microseconds, x, y and polarity."""
PLACES = [(0, 2 * (34 * 7 + 5) + 1), (1, 2 * (34 * 33 + 33)), (2, 1)]
"""Steps of 20 ms and channels of these."""


def places(spikes: np.ndarray) -> list[tuple[int, int]]:
    return [(int(step), int(channel)) for step, channel in zip(*np.nonzero(spikes), strict=True)]


def packed(events: list[tuple[int, int, int, int]]) -> bytes:
    """Return the 40 bits of an event as N-MNIST's page has them: x, y, polarity, and 23 bits of time."""
    return b"".join((x << 32 | y << 24 | p << 23 | t).to_bytes(5, "big") for t, x, y, p in events)


def n_mnist(folder: Path) -> Path:
    for part in ("Train", "Test"):
        for digit in (0, 3, 10):
            where = folder / part / str(digit)
            where.mkdir(parents=True)
            (where / f"0000{digit}.bin").write_bytes(packed(EVENTS[: 1 + digit % 3]))
    return folder


@pytest.mark.parametrize("part", ["train", "test"])
def test_folders_of_bin_files(tmp_path: Path, part: str) -> None:
    path = n_mnist(tmp_path / "N-MNIST")
    assert recording_parts(path) == ("train", "test")
    found = read_recordings(path, split=part, sensor=SENSOR)
    assert found.labels is not None
    assert found.labels.tolist() == [0, 1, 2]
    assert found.class_names == ("0", "3", "10")
    assert found.spikes.shape == (3, 2, 2 * 34 * 34)
    assert places(found.spikes[2]) == PLACES[:2]


def test_time_goes_on_where_its_bits_end(tmp_path: Path) -> None:
    """Row 240 is no event: everything after it is 2^13 microseconds later."""
    mark = (0, 0, 240, 0)
    (tmp_path / "a.bin").write_bytes(packed([(100, 1, 0, 0), mark, (100, 2, 0, 0), mark, (100, 3, 0, 0)]))
    found = read_recordings(tmp_path / "a.bin", step_seconds=8192e-6, sensor=SENSOR)
    assert places(found.spikes[0]) == [(0, 2), (1, 4), (2, 6)]


def test_a_bin_file_that_ends_within_an_event(tmp_path: Path) -> None:
    (tmp_path / "a.bin").write_bytes(packed(EVENTS)[:-1])
    with pytest.raises(InputError) as caught:
        read_recordings(tmp_path / "a.bin")
    assert str(caught.value) == "file 'a.bin': it ends within an event (14 bytes, 5 an event). Give a whole file."


def test_events_beside_the_grid_are_refused(tmp_path: Path) -> None:
    (tmp_path / "a.bin").write_bytes(packed(EVENTS))
    with pytest.raises(InputError) as caught:
        read_recordings(tmp_path / "a.bin", sensor=SensorLayout("16x16", 256, 2, columns=16))
    assert (
        str(caught.value) == "file 'a.bin': an event lies beside the grid (x 33 against 16 columns). Give more columns."
    )
