"""HDF5 recordings: arrays by name, and spike times in the layout of the Heidelberg data sets, written here by h5py."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest

from locsnn_compile.data.read import read_recordings
from locsnn_compile.data.sensor import asked_layout
from locsnn_compile.errors import InputError

TIMES = [[0.0, 0.013, 0.055], [], [0.029]]
UNITS = [[3, 699, 3], [], [0]]
"""Seconds and channels (units) of the spikes of three recordings, of which the second is silent."""


def heidelberg(
    path: Path,
    times: list = TIMES,
    units: list = UNITS,
    kinds: tuple[str, str] = ("<f2", "<u2"),
    **more: object,
) -> Path:
    """Write spike times (seconds) and units, a row per recording; ``kinds`` are their dtypes, ``more`` further entries."""
    with h5py.File(path, "w") as file:
        for name, rows, kind in (("times", times, kinds[0]), ("units", units, kinds[1])):
            held = file.create_dataset(
                f"spikes/{name}", (len(rows),), dtype=h5py.vlen_dtype(np.dtype(kind))
            )
            for index, row in enumerate(rows):
                held[index] = np.array(row, dtype=kind)
        file["labels"] = np.array([1, 0, 1], dtype=np.uint16)[: len(times)]
        file["extra/keys"] = np.array([b"zero", b"one"])
        for name, value in more.items():
            file[name] = value
    return path


def test_spike_times_become_bins(tmp_path: Path) -> None:
    recordings = read_recordings(heidelberg(tmp_path / "shd.h5"), step_seconds=0.01, channels=700)
    assert recordings.spikes.shape == (3, 6, 700)
    assert np.argwhere(recordings.spikes).tolist() == [[0, 0, 3], [0, 1, 699], [0, 5, 3], [2, 2, 0]]
    assert recordings.labels is not None
    assert recordings.labels.tolist() == [1, 0, 1]
    assert recordings.class_names == ("zero", "one")
    assert recordings.step_seconds == 0.01


@pytest.mark.parametrize(
    "kinds", [(">f2", "<u2"), (">f4", ">u2"), (">f8", ">i4"), ("<f8", ">i8"), (">i4", "<i4")]
)
def test_numbers_of_any_byte_order_are_read(tmp_path: Path, kinds: tuple[str, str]) -> None:
    path = heidelberg(tmp_path / "shd.h5", [[0, 1, 5], [], [2]], kinds=kinds)
    recordings = read_recordings(path, step_seconds=1.0, channels=700)
    assert np.argwhere(recordings.spikes).tolist() == [[0, 0, 3], [0, 1, 699], [0, 5, 3], [2, 2, 0]]


@pytest.mark.parametrize(("grid", "polarities"), [("35x10", 2), ("35x20", 1)])
def test_units_are_channels_of_a_grid(tmp_path: Path, grid: str, polarities: int) -> None:
    sensor = asked_layout(grid, polarities, channels=None, layout=None)
    recordings = read_recordings(heidelberg(tmp_path / "shd.h5"), step_seconds=0.01, sensor=sensor)
    assert np.argwhere(recordings.spikes).tolist() == [[0, 0, 3], [0, 1, 699], [0, 5, 3], [2, 2, 0]]


def test_later_spikes_are_cut_and_counted(tmp_path: Path) -> None:
    recordings = read_recordings(
        heidelberg(tmp_path / "shd.hdf5"), step_seconds=0.01, channels=700, steps=2
    )
    assert recordings.spikes.sum() == 2
    assert recordings.binned is not None
    assert recordings.binned.document() == {
        "threshold": 0,
        "events": 4,
        "outside": 2,
        "below": 0,
        "elsewhere": 0,
        "dropped": 2,
    }


@pytest.mark.parametrize("axes", ["samples,channels,steps", "samples,steps,channels"])
def test_arrays_are_read_by_name_in_the_order_of_axes_that_the_file_states(
    tmp_path: Path, axes: str
) -> None:
    spikes = (np.random.default_rng(0).random((4, 5, 7)) < 0.3).astype(np.uint8)
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["spikes"] = spikes.transpose(
            [("samples", "steps", "channels").index(axis) for axis in axes.split(",")]
        )
        file["labels"], file["step_seconds"], file["axes"] = [0, 1, 1, 0], 0.02, axes
        file["class_names"] = ["left", "right"]
    recordings = read_recordings(tmp_path / "a.h5", channels=7)
    assert np.array_equal(recordings.spikes, spikes)
    assert recordings.class_names == ("left", "right")
    assert recordings.step_seconds == 0.02


def link(path: Path) -> None:
    with h5py.File(path, "w") as file:
        file["spikes"] = h5py.ExternalLink("other.h5", "/spikes")


def many(path: Path) -> None:
    with h5py.File(path, "w") as file:
        for name in ("times", "units"):
            file.create_dataset(
                f"spikes/{name}", (10**12,), dtype=h5py.vlen_dtype(np.float32), chunks=(1000,)
            )


def large(path: Path) -> None:
    with h5py.File(path, "w") as file:
        file.create_dataset("spikes", (10**6, 10**6), dtype=np.uint8, chunks=(100, 100))


def text(path: Path) -> None:
    with h5py.File(path, "w") as file:
        file["spikes"], file["class_names"] = np.ones((1, 3, 4)), [1, 2]


PLACE = "file 'a.h5', recording 0: it does not hold a time and a channel"
WAY = "Give times and units from 0 up."


@pytest.mark.parametrize(
    ("make", "message"),
    [
        pytest.param(
            lambda path: heidelberg(path, [[1.0, -0.5]], [[0, 1]]),
            f"{PLACE} (spike 1: -0.5 s, unit 1.0). {WAY}",
            id="before the start",
        ),
        pytest.param(
            lambda path: heidelberg(path, [[np.nan]], [[0]]),
            f"{PLACE} (spike 0: nan s, unit 0.0). {WAY}",
            id="no time",
        ),
        pytest.param(
            lambda path: heidelberg(path, [[0.1]], [[0, 1]]),
            "file 'a.h5': its times and units differ in number. "
            "Give a time and a unit for each spike.",
            id="ragged",
        ),
        pytest.param(
            lambda path: heidelberg(path, [[60_000.0]], [[0]]),
            "file 'a.h5', recording 0: it lasts too long for its bins (60000 s in bins of 0.02 s "
            "against 20000 bins). Start it at its first event with --start first.",
            id="too long",
        ),
        pytest.param(
            many,
            "file 'a.h5': 'times' has too many rows (1000000000000 against 100000). "
            "Give fewer recordings.",
            id="absurd rows",
        ),
        pytest.param(
            large,
            "file 'a.h5': 'spikes': the file unpacks to more than is read "
            "(8000000000000 bytes against 500000000). Give a smaller file.",
            id="absurd array",
        ),
        pytest.param(
            link,
            "file 'a.h5': 'spikes' is a link, and links are not followed. Store the data itself.",
            id="a link out",
        ),
        pytest.param(
            text,
            "file 'a.h5': 'class_names' is not text (int64). Give a whole file, or write it again.",
            id="names that are numbers",
        ),
        pytest.param(
            lambda path: path.write_bytes(b"\x89HDF\r\n\x1a\n" + bytes(100)),
            "file 'a.h5': it is damaged, truncated or not an HDF5 file. "
            "Give a whole file, or write it again.",
            id="damaged",
        ),
    ],
)
def test_files_without_readable_recordings_are_refused(
    make: Callable[[Path], object], message: str, tmp_path: Path
) -> None:
    make(tmp_path / "a.h5")
    with pytest.raises(InputError) as caught:
        read_recordings(tmp_path / "a.h5")
    assert str(caught.value) == message
