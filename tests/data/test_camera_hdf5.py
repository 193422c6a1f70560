"""HDF5 files of event cameras, in the layouts of the DSEC data set and of Prophesee's tools, written here by h5py."""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np
import pytest

from locsnn_compile.data.read import read_recordings
from locsnn_compile.errors import InputError

EVENTS = [(0, 1, 0, 1), (400, 0, 1, 0), (1000, 1, 1, 1), (2900, 0, 0, 1)]
"""Microseconds, x, y, polarity."""
BINS = [[0, 0, 3], [0, 0, 4], [0, 1, 7], [0, 2, 1]]
"""The events by hand in steps of 1 ms, on 2 x 2 pixels: [recording, step, channel], where channels are 2 (2 y + x) + p."""
KINDS = {"t": "<u4", "x": "<u2", "y": "<u2", "p": "|u1"}
BLOSC = 32001
"""The number of a compression filter that HDF5 has only as a plug-in."""


def dsec(path: Path, offset_us: int | None = 49_599_300_523, names: str = "txyp") -> Path:
    """Write events as DSEC does: four columns, an index of milliseconds, and the time at which t is 0."""
    with h5py.File(path, "w") as file:
        for column, name in enumerate(names):
            kind = KINDS["txyp"[column]]
            file[f"events/{name}"] = np.array([event[column] for event in EVENTS], dtype=kind)
        file["ms_to_idx"] = np.array([0, 2, 3], dtype=np.uint64)
        if offset_us is not None:
            file["t_offset"] = np.int64(offset_us)
    return path


def prophesee(path: Path) -> Path:
    """Write events as the tools of Prophesee do: records in CD/events, and their index."""
    kind = [("x", "<u2"), ("y", "<u2"), ("p", "<i2"), ("t", "<i8")]
    with h5py.File(path, "w") as file:
        rows = [(x, y, p, t) for t, x, y, p in EVENTS]
        file["CD/events"] = np.array(rows, dtype=kind)
        file["CD/indexes"] = np.zeros(1, dtype=[("id", "<u8"), ("ts", "<i8")])
        file.create_group("EXT_TRIGGER")
    return path


@pytest.mark.parametrize("write", [dsec, prophesee])
@pytest.mark.parametrize("suffix", [".h5", ".hdf5"])
def test_events_of_a_camera_are_one_recording(write, suffix: str, tmp_path: Path) -> None:
    path = write(tmp_path / f"events{suffix}")
    recordings = read_recordings(path, grid="2x2", step_seconds=0.001)
    assert recordings.spikes.shape == (1, 3, 8)
    assert np.argwhere(recordings.spikes).tolist() == BINS
    assert recordings.labels is None


def test_dsec_counts_times_from_its_offset(tmp_path: Path) -> None:
    path = dsec(tmp_path / "events.h5", offset_us=5_000)
    recordings = read_recordings(path, grid="2x2", step_seconds=0.001, start=0.003)
    assert np.argwhere(recordings.spikes).tolist() == [[0, 2 + step, c] for _, step, c in BINS]
    late = read_recordings(path, grid="2x2", step_seconds=0.001)
    assert late.assumed == (
        "Recordings start at their first event, up to 0.005 s after time 0 of their files (--start).",
    )


def test_events_under_other_names_are_refused(tmp_path: Path) -> None:
    path = dsec(tmp_path / "events.h5", names=("ts", "xs", "ys", "ps"))
    with pytest.raises(InputError) as caught:
        read_recordings(path, grid="2x2")
    assert str(caught.value) == (
        "file 'events.h5', 'events': it lacks 't', 'x', 'y' and 'p' (it has 'ps', 'ts', 'xs' and 'ys'). "
        "Call times, columns, rows and polarities t, x, y and p, as DSEC does."
    )


def test_columns_of_other_lengths_are_refused(tmp_path: Path) -> None:
    path = dsec(tmp_path / "events.h5")
    with h5py.File(path, "a") as file:
        del file["events/p"]
        file["events/p"] = np.zeros(3, dtype=np.uint8)
    with pytest.raises(InputError) as caught:
        read_recordings(path, grid="2x2")
    assert str(caught.value) == (
        "file 'events.h5', 'events', 'p': its size is another ((3,) against (4,)). "
        "Give as many of t, x, y and p."
    )


def test_a_filter_that_is_not_installed_is_named(tmp_path: Path) -> None:
    path = dsec(tmp_path / "events.h5")
    with h5py.File(path, "a") as file:
        del file["events/t"]
        created = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
        created.set_chunk((4,))
        created.set_filter(BLOSC, h5py.h5z.FLAG_OPTIONAL)
        space = h5py.h5s.create_simple((4,))
        group = file["events"].id
        h5py.h5d.create(group, b"t", h5py.h5t.NATIVE_UINT32, space, dcpl=created)
    with pytest.raises(InputError) as caught:
        read_recordings(path, grid="2x2")
    assert str(caught.value) == (
        "file 'events.h5', 'events': 't' is compressed by a filter that HDF5 does not have here "
        "(number 32001, ''). Store it with gzip, or uncompressed."
    )
