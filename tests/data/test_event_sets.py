"""Event data sets: N-MNIST's folders of ``.bin`` files, AEDAT4 files, and data sets of the library Tonic."""

from __future__ import annotations

import shutil
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from locsnn_compile.data import (
    event_formats,
    event_stream,
    from_tonic,
    read_recordings,
    recording_parts,
)
from locsnn_compile.data.event_stream import Binning, EventStream, bin_streams
from locsnn_compile.data.sensor import SensorLayout
from locsnn_compile.errors import InputError

SENSOR = SensorLayout("34x34", 34 * 34, polarities=2, columns=34)
EVENTS = [(0, 5, 7, 1), (20_000, 33, 33, 0), (59_999, 0, 0, 1)]
"""Microseconds, x, y and polarity."""
PLACES = [(0, 2 * (34 * 7 + 5) + 1), (1, 2 * (34 * 33 + 33)), (2, 1)]
"""Step of 20 ms and channel of each of the events; channels are 2 (34 y + x) + polarity."""


def places(spikes: np.ndarray) -> list[tuple[int, int]]:
    """Return the (step, channel) of every event of a recording."""
    return [(int(step), int(channel)) for step, channel in zip(*np.nonzero(spikes), strict=True)]


def packed(events: list[tuple[int, int, int, int]]) -> bytes:
    """Return events of 40 bits, as N-MNIST's page describes them: x, y, polarity, and 23 bits of time."""
    return b"".join((x << 32 | y << 24 | p << 23 | t).to_bytes(5, "big") for t, x, y, p in events)


def n_mnist(folder: Path) -> Path:
    """Write a set as N-MNIST: a folder per part and digit, with one, two or three events per recording."""
    for part in ("Train", "Test"):
        for digit in (0, 3, 10):
            where = folder / part / str(digit)
            where.mkdir(parents=True)
            (where / f"0000{digit}.bin").write_bytes(packed(EVENTS[: 1 + digit % 3]))
    return folder


@pytest.mark.parametrize("part", ["train", "test"])
def test_folders_of_bin_files_are_parts_and_classes(tmp_path: Path, part: str) -> None:
    path = n_mnist(tmp_path / "N-MNIST")
    assert recording_parts(path) == ("train", "test")
    recordings = read_recordings(path, split=part, sensor=SENSOR)
    assert recordings.labels is not None
    assert recordings.labels.tolist() == [0, 1, 2]
    assert recordings.class_names == ("0", "3", "10")
    assert recordings.spikes.shape == (3, 2, 2 * 34 * 34)
    assert places(recordings.spikes[2]) == PLACES[:2]


def test_times_go_on_beyond_the_bits_of_an_event(tmp_path: Path) -> None:
    """An event in row 240 marks an overflow of time: all events after it are 2^13 microseconds later."""
    mark = (0, 0, 240, 0)
    (tmp_path / "a.bin").write_bytes(
        packed([(100, 1, 0, 0), mark, (100, 2, 0, 0), mark, (100, 3, 0, 0)])
    )
    recordings = read_recordings(tmp_path / "a.bin", step_seconds=8192e-6, sensor=SENSOR)
    assert places(recordings.spikes[0]) == [(0, 2), (1, 4), (2, 6)]


def test_a_bin_file_that_ends_within_an_event_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.bin").write_bytes(packed(EVENTS)[:-1])
    with pytest.raises(InputError) as caught:
        read_recordings(tmp_path / "a.bin")
    assert (
        str(caught.value)
        == "file 'a.bin': it ends within an event (14 bytes, 5 per event). Give a whole file."
    )


def test_events_outside_the_grid_are_refused(tmp_path: Path) -> None:
    (tmp_path / "a.bin").write_bytes(packed(EVENTS))
    with pytest.raises(InputError) as caught:
        read_recordings(
            tmp_path / "a.bin", sensor=SensorLayout("16x16", taxels=256, polarities=2, columns=16)
        )
    assert (
        str(caught.value)
        == "file 'a.bin': an event lies outside the grid (x 33 against 16 columns). Give more columns."
    )


class Digits(list):
    """A data set as Tonic's users have it: a sequence of (events, label) with the size of its sensor and its classes."""

    sensor_size = (34, 34, 2)
    classes = ("zero", "one")


FIELDS = np.dtype([("x", np.int16), ("y", np.int16), ("t", np.int64), ("p", bool)])


def structured(events: list[tuple[int, int, int, int]]) -> np.ndarray:
    """Return events (t, x, y, polarity) as a structured array."""
    return np.array([(x, y, t, p) for t, x, y, p in events], dtype=FIELDS)


def test_a_data_set_of_tonic_becomes_recordings() -> None:
    recordings = from_tonic(
        Digits([(structured(EVENTS), 1), (structured([]), 0)]), step_seconds=0.02
    )
    assert recordings.spikes.shape == (2, 3, 2 * 34 * 34)
    assert places(recordings.spikes[0]) == PLACES
    assert recordings.labels is not None
    assert recordings.labels.tolist() == [1, 0]
    assert recordings.class_names == ("zero", "one")
    assert recordings.source == "Digits"


@pytest.mark.parametrize(
    ("dataset", "message"),
    [
        pytest.param(
            Digits(),
            "data set 'Digits': no events inside. Give a recording with events.",
            id="empty",
        ),
        pytest.param(
            Digits([(structured(EVENTS), "one")]),
            "data set 'Digits': its labels are not class numbers. "
            "Give a target_transform that gives them.",
            id="labels",
        ),
        pytest.param(
            Digits([(np.zeros((3, 4)), 1)]),
            "data set 'Digits', recording 0: its values are not events (2 axes). "
            "Give the fields t (microseconds), x, y if there is one, and p (0 or 1).",
            id="frames",
        ),
        pytest.param(
            Digits([(structured([(0, 0, 34, 0)]), 1)]),
            "data set 'Digits': it has events on channels that the sensor does not have (channel 2312 against 0..2311). "
            "Give events of this sensor, or more channels.",
            id="another sensor",
        ),
        pytest.param(
            Digits([(structured(EVENTS), 2)]),
            "recordings 'Digits': its class names do not fit its classes (2 different ones against 3). "
            "Give a name of 1 to 80 printable characters for each class, from class 0 on.",
            id="a class without a name",
        ),
    ],
)
def test_data_sets_that_cannot_be_converted_are_refused(dataset: Digits, message: str) -> None:
    with pytest.raises(InputError) as caught:
        from_tonic(dataset)
    assert str(caught.value) == message


def test_tonic_reads_the_same_files(tmp_path: Path) -> None:
    """Tonic's reader of N-MNIST, within a data set of Tonic made of these files, against the project's reader."""
    pytest.importorskip("tonic")
    from tonic import Dataset
    from tonic.io import read_mnist_file

    folder = n_mnist(tmp_path / "N-MNIST")
    paths = sorted((folder / "Test").glob("*/*.bin"), key=lambda path: int(path.parent.name))

    class OfFiles(Dataset):  # type: ignore[misc]
        sensor_size = (34, 34, 2)
        classes = ("0", "3", "10")

        def __init__(self) -> None:
            super().__init__(str(tmp_path))
            self.data, self.targets = paths, [0, 1, 2]

        def __getitem__(self, index: int) -> tuple[np.ndarray, int]:
            return read_mnist_file(paths[index], dtype=FIELDS), self.targets[index]

        def __len__(self) -> int:
            return len(paths)

        def _check_exists(self) -> bool:
            return True

    theirs = from_tonic(OfFiles())
    ours = read_recordings(folder, sensor=SENSOR)
    assert np.array_equal(theirs.spikes, ours.spikes)
    assert theirs.class_names == ours.class_names


CAMERA = Path(__file__).with_name("camera.aedat4")
""":data:`EVENTS` of a camera of 34 x 34 pixels, written by the camera's own library: see ``write_camera.py``."""


@pytest.fixture
def camera(tmp_path: Path) -> Path:
    """A copy of :data:`CAMERA`."""
    pytest.importorskip("aedat")
    return Path(shutil.copy(CAMERA, tmp_path / "a.aedat4"))


def test_an_aedat4_file_of_a_camera_is_read(camera: Path) -> None:
    recordings = read_recordings(camera)
    assert recordings.spikes.shape == (1, 3, 2 * 34 * 34)
    assert places(recordings.spikes[0]) == PLACES


def test_aedat4_of_several_cameras_gives_the_first(camera: Path) -> None:
    """The library that reads AEDAT4 lists cameras in another order each time."""
    shutil.copy(CAMERA.with_name("cameras.aedat4"), camera)
    recordings = read_recordings(camera)
    assert recordings.spikes.shape == (1, 3, 2 * 34 * 34)
    assert places(recordings.spikes[0]) == PLACES
    assert recordings.binned is not None
    assert recordings.binned.words == (
        "15 of 18 events dropped: 0 outside the steps, 0 in bins of at most 0, "
        "15 in further streams or before the first time"
    )


def test_aedat4_of_too_many_events_is_refused(
    camera: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for module in (event_formats, event_stream):
        monkeypatch.setattr(module, "MAX_EVENTS", 2)
    with pytest.raises(InputError) as caught:
        read_recordings(camera)
    assert (
        str(caught.value)
        == "file 'a.aedat4': it has too many events (3 against 2). Give fewer recordings."
    )


DAMAGED = "file 'a.aedat4': it is damaged, truncated or has no events. Give a whole AEDAT4 file with events."


@pytest.mark.parametrize(
    "damage",
    [
        pytest.param(lambda data: data[: len(data) // 2], id="truncated"),
        pytest.param(lambda data: b"hello", id="another file"),
        pytest.param(
            lambda data: data[:100] + bytes(b ^ 0xFF for b in data[100:]),
            id="a panic of the library",
        ),
    ],
)
def test_aedat4_that_is_damaged_is_refused_without_output_of_its_library(
    camera: Path, damage: Callable[[bytes], bytes], capfd: pytest.CaptureFixture[str]
) -> None:
    camera.write_bytes(damage(camera.read_bytes()))
    with pytest.raises(InputError) as caught:
        read_recordings(camera)
    assert str(caught.value) == DAMAGED
    assert capfd.readouterr() == ("", "")


def test_aedat4_that_takes_too_long_is_refused(
    camera: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(event_formats, "_AEDAT4_SECONDS", 0.0)
    with pytest.raises(InputError) as caught:
        read_recordings(camera)
    assert str(caught.value) == DAMAGED


def test_aedat4_says_which_package_it_needs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "aedat", None)
    (tmp_path / "a.aedat4").write_bytes(b"")
    with pytest.raises(InputError) as caught:
        read_recordings(tmp_path / "a.aedat4")
    assert str(caught.value) == (
        "file 'a.aedat4': it needs aedat, which is not installed. Install it with: pip install aedat."
    )


def test_a_stream_may_state_the_columns_of_its_sensor() -> None:
    """One event at x 1, y 2 of five columns reaches channel 11."""
    time, x, y, polarity = (np.array([value]) for value in (0, 1, 2, 0))
    stream = EventStream(time, x, y, polarity, columns=5)
    assert bin_streams([stream], "a", Binning()).spikes.shape == (1, 1, 12)


FLAT = [(0, 79, 1), (20_000, 3, 0), (45_000, 40, 1)]
"""Microseconds, taxel and polarity."""


@pytest.mark.parametrize("columns", [4, 10, 16])
@pytest.mark.parametrize("suffix", [".bs1", ".npy"])
def test_taxels_that_are_numbered_without_rows_may_exceed_the_columns_of_a_grid(
    tmp_path: Path, suffix: str, columns: int
) -> None:
    path = tmp_path / f"sample_0{suffix}"
    if suffix == ".bs1":
        path.write_bytes(b"".join((x << 24 | p << 23 | t).to_bytes(5, "big") for t, x, p in FLAT))
    else:
        np.save(path, np.array(FLAT, dtype=[("t", int), ("x", int), ("p", int)]))
    recordings = read_recordings(
        path, sensor=SensorLayout("grid", taxels=80, polarities=2, columns=columns)
    ).spikes
    assert recordings.shape == (1, 3, 160)
    assert places(recordings[0]) == [(0, 159), (1, 6), (2, 81)]
