"""Recordings written in any format are equal when they are read back, with the options that the writer reports.

A format may not store the width of a step, the number of channels or steps, or silence at the start. The writer reports
such facts as options for the reader.
"""

from __future__ import annotations

import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from locsnn_compile.data import Recordings, read_recordings, synthetic_touches, write_recordings
from locsnn_compile.data.sensor import SensorLayout
from locsnn_compile.errors import InputError

TOUCHES = synthetic_touches(3, steps=40, seed=5)
BOTH = synthetic_touches(2, steps=325, fingertips=2, seed=6)


def sparse(
    channels: int, *, steps: int = 30, seconds: float | None = 0.02, labels: bool = True
) -> Recordings:
    """Return three recordings that begin and end in silence, with silent last channels."""
    spikes = (np.random.default_rng(channels).random((3, steps, channels)) < 0.1).astype(np.uint8)
    spikes[:, :3] = 0
    spikes[:, -4:] = 0
    spikes[:, :, -5:] = 0
    return Recordings(spikes, np.array([4, 0, 4]) if labels else None, seconds, "sparse")


def rising_only() -> Recordings:
    """Return recordings with events of one polarity only."""
    spikes = sparse(78).spikes.copy()
    spikes[:, :, 1::2] = 0
    return Recordings(spikes, labels=None, step_seconds=0.02, source="rising")


def no_last_column() -> Recordings:
    """Return recordings in which the last taxel of both fingertips has hardly any events.

    A reader cannot tell from such events how many columns the sensor has.
    """
    spikes = BOTH.spikes.copy()
    spikes[:, :, [76, 77]] = 0
    spikes[:, :, 154] = spikes[:, :, 155] = 0
    spikes[0, -1, 153] = 1
    return Recordings(spikes, BOTH.labels, step_seconds=0.02, source="a column")


def same(read_back: Recordings, expected: Recordings) -> None:
    """Check that recordings have equal spikes, labels and widths of a step."""
    assert np.array_equal(read_back.spikes, expected.spikes)
    assert (read_back.labels is None) == (expected.labels is None)
    if read_back.labels is not None and expected.labels is not None:
        assert read_back.labels.tolist() == expected.labels.tolist()
    assert read_back.step_seconds == expected.step_seconds


SETS = [
    pytest.param(TOUCHES, id="touches"),
    pytest.param(BOTH, id="two fingertips"),
    pytest.param(sparse(78), id="silent ends"),
    pytest.param(sparse(156, labels=False), id="no labels"),
    pytest.param(sparse(100), id="no fingertip"),
    pytest.param(sparse(78, seconds=0.001), id="milliseconds"),
    pytest.param(rising_only(), id="one polarity"),
    pytest.param(no_last_column(), id="a silent column"),
]


@pytest.mark.parametrize("name", ["out.npz", "out.pt", "out.npy", "out", "out.zip"])
@pytest.mark.parametrize(
    "shape",
    [(39, 10, 2), (2, 78, 9), (1, 78, 9), (2, 39, 14), (2, 9, 117), (3, 156, 512), (78, 2, 39)],
    ids=lambda shape: " x ".join(map(str, shape)),
)
def test_recordings_whose_sizes_suggest_another_order_of_axes_are_read_back(
    tmp_path: Path, shape: tuple[int, int, int], name: str
) -> None:
    """An axis has a size that NeuTouch has on another, such as 39 recordings of two channels for one of 39 taxels."""
    recordings = Recordings(
        (np.random.default_rng(1).random(shape) < 0.2).astype(np.uint8),
        labels=None,
        step_seconds=None,
        source="a",
    )
    left = write_recordings(tmp_path / name, recordings)
    assert left.options in ({}, {"channels": shape[2]})
    same(read_recordings(tmp_path / name, **left.options), recordings)


@pytest.mark.parametrize("recordings", SETS)
@pytest.mark.parametrize("kind", ["npz", "pt", "npy", "events", "bs1", "bs2", "tact"])
@pytest.mark.parametrize("suffix", ["", ".zip"])
def test_sets_of_recordings_are_read_back(
    tmp_path: Path, recordings: Recordings, kind: str, suffix: str
) -> None:
    whole = kind in ("npz", "pt")
    path = tmp_path / (f"out.{kind}" if whole else f"out{suffix}")
    members = "npy" if whole else kind
    if kind == "tact" and recordings.spikes.shape[2] == 100:
        with pytest.raises(InputError) as caught:
            write_recordings(path, recordings, members=members)
        assert str(caught.value) == (
            f"file '{path.name}': raw text holds one or two fingertips (100 taxels against 39 or 78). Write .npz."
        )
        assert not list(tmp_path.iterdir())
        return
    left = write_recordings(path, recordings, members=members)
    same(read_recordings(path, **left.options), recordings)  # type: ignore[arg-type]
    assert [file.name for file in tmp_path.iterdir()] == [path.name]


@pytest.mark.parametrize("kind", ["npy", "bs1", "bs2", "tact", "structured npy", "structured npz"])
def test_a_single_recording_is_read_back(tmp_path: Path, kind: str) -> None:
    one = BOTH.subset([1])
    assert one.spikes[0, 0].any()
    path = tmp_path / f"touch_label_1.{kind.split()[-1]}"
    left = write_recordings(path, one, structured=kind.startswith("structured"))
    same(read_recordings(path, **left.options), one)  # type: ignore[arg-type]
    assert [file.name for file in tmp_path.iterdir()] == [path.name]


@pytest.mark.parametrize(
    ("recordings", "kind", "options"),
    [
        pytest.param(TOUCHES, "npz", {}, id="npz"),
        pytest.param(TOUCHES, "npy", {"step_seconds": 0.02}, id="npy"),
        pytest.param(sparse(78), "bs1", {"channels": 78, "steps": 30, "polarities": 2}, id="bs1"),
        pytest.param(sparse(156), "bs2", {"channels": 156, "steps": 30, "polarities": 2}, id="bs2"),
        pytest.param(
            no_last_column(),
            "bs2",
            {"channels": 156, "polarities": 2, "columns": 39},
            id="bs2 with a silent column",
        ),
        pytest.param(
            sparse(78, seconds=0.001),
            "events",
            {"step_seconds": 0.001, "channels": 78, "steps": 30, "polarities": 2, "start": 0},
            id="events",
        ),
        pytest.param(
            rising_only(), "bs1", {"channels": 78, "steps": 30, "polarities": 2}, id="one polarity"
        ),
        pytest.param(sparse(78), "tact", {"channels": 78, "steps": 30}, id="tact"),
        pytest.param(BOTH, "tact", {}, id="tact of two fingertips and 6.5 s"),
    ],
)
def test_the_writer_reports_what_a_format_does_not_store(
    tmp_path: Path, recordings: Recordings, kind: str, options: dict[str, Any]
) -> None:
    path = tmp_path / ("a.npz" if kind == "npz" else "a.zip")
    left = write_recordings(path, recordings, members="npy" if kind == "npz" else kind)
    assert left.options == options


@given(
    seed=st.integers(0, 2**32 - 1),
    shape=st.tuples(st.integers(1, 3), st.integers(1, 40), st.sampled_from([1, 2, 7, 78, 90, 156])),
    share=st.floats(0, 0.2),
    seconds=st.sampled_from([None, 2e-6, 1 / 3000, 0.001, 0.02, 0.1]),
    kind=st.sampled_from(["npy", "events", "bs1", "bs2"]),
)
@settings(max_examples=60, deadline=None)
def test_any_recordings_are_read_back(
    seed: int, shape: tuple[int, int, int], share: float, seconds: float | None, kind: str
) -> None:
    spikes = (np.random.default_rng(seed).random(shape) < share).astype(np.uint8)
    recordings = Recordings(spikes, np.arange(shape[0]), seconds, "any")
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "a.zip"
        left = write_recordings(path, recordings, members=kind)
        read_back = read_recordings(path, **left.options)  # type: ignore[arg-type]
        assert np.array_equal(read_back.spikes, spikes)
        again = Path(folder) / "b.zip"
        write_recordings(again, recordings, members=kind)
        assert again.read_bytes() == path.read_bytes()


@given(
    seed=st.integers(0, 2**32 - 1),
    grid=st.tuples(st.integers(1, 14), st.integers(1, 7), st.integers(1, 2)),
    share=st.floats(0, 0.2),
    kind=st.sampled_from(["npy", "events", "bs1", "bs2"]),
)
@example(seed=1, grid=(13, 6, 1), share=0.2, kind="bs2")  # 78 channels, as many as a fingertip has
@example(seed=1, grid=(4, 5, 2), share=0.2, kind="bs1")
@example(seed=1, grid=(1, 1, 2), share=0.125, kind="events")  # only the second polarity has events
@settings(max_examples=60, deadline=None)
def test_recordings_of_a_grid_are_read_back_with_and_without_the_grid(
    seed: int, grid: tuple[int, int, int], share: float, kind: str
) -> None:
    columns, rows, polarities = grid
    sensor = SensorLayout("grid", columns * rows, polarities, columns=columns)
    spikes = (np.random.default_rng(seed).random((2, 9, sensor.channels)) < share).astype(np.uint8)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "a.zip"
        left = write_recordings(
            path,
            Recordings(spikes, labels=None, step_seconds=0.02, source="grid"),
            members=kind,
            sensor=sensor,
        ).options
        without = read_recordings(path, **left)  # type: ignore[arg-type]
        assert np.array_equal(without.spikes, spikes)
        known = {
            name: value
            for name, value in left.items()
            if name in ("steps", "step_seconds", "start")
        }
        read_back = read_recordings(path, sensor=sensor, **known)  # type: ignore[arg-type]
        assert np.array_equal(read_back.spikes, spikes)


@pytest.mark.parametrize("columns", [None, 13])
@pytest.mark.parametrize(("taxels", "polarities"), [(39, 1), (78, 1), (39, 2), (78, 2)])
def test_raw_text_of_a_described_sensor_is_read_back(
    tmp_path: Path, taxels: int, polarities: int, columns: int | None
) -> None:
    sensor = SensorLayout("mine", taxels, polarities, columns=columns)
    expected = sparse(sensor.channels)
    left = write_recordings(tmp_path / "a.zip", expected, members="tact", sensor=sensor).options
    assert left.get("polarities", 2) == polarities
    same(read_recordings(tmp_path / "a.zip", **left), expected)  # type: ignore[arg-type]
    same(read_recordings(tmp_path / "a.zip", sensor=sensor, steps=30), expected)


def test_events_of_a_grid_are_written_with_their_cells(tmp_path: Path) -> None:
    spikes = np.zeros((1, 3, 40), dtype=np.uint8)
    spikes[0, 1, 2 * (4 * 3 + 1) + 1] = 1  # row 3, column 1, polarity 1
    recordings = Recordings(spikes, labels=None, step_seconds=0.02, source="grid")
    sensor = SensorLayout("grid 4x5", taxels=20, polarities=2, columns=4)
    for name in ("a.bs1", "a.bs2"):
        write_recordings(tmp_path / name, recordings, sensor=sensor)
    # A cell number or x and y, then the polarity as the highest bit of 24, and 20,000 microseconds.
    polarity_and_time = [0x80, 20_000 >> 8, 20_000 & 0xFF]
    assert (tmp_path / "a.bs1").read_bytes() == bytes([0, 13, *polarity_and_time])
    assert (tmp_path / "a.bs2").read_bytes() == bytes([1, 3, *polarity_and_time])


def test_recordings_of_another_sensor_are_not_written(tmp_path: Path) -> None:
    with pytest.raises(InputError) as caught:
        write_recordings(
            tmp_path / "a.zip",
            TOUCHES,
            sensor=SensorLayout("grid 4x5", taxels=20, polarities=2, columns=4),
        )
    assert str(caught.value) == (
        f"recordings {TOUCHES.source!r}: their channels are not those of sensor 'grid 4x5' (78 against 40). "
        "Say which sensor it was: --grid WxH, with --polarities 1 or 2, --channels N, or --layout FILE."
    )
    assert not list(tmp_path.iterdir())


SILENT = Recordings(
    np.zeros((1, 5, 156), dtype=np.uint8), labels=None, step_seconds=0.02, source="silent"
)
REFUSED = [
    pytest.param(
        "a.xyz",
        TOUCHES,
        {},
        "file 'a.xyz': files ending in '.xyz' are not written. "
        "Choose one of: .bs1, .bs2, .npy, .npz, .pt, .tact, .zip.",
        id="an unknown ending",
    ),
    pytest.param(
        "a.zip",
        TOUCHES,
        {"members": "bs"},
        "members: 'bs' is not known. Did you mean 'bs2'?",
        id="an unknown kind",
    ),
    pytest.param(
        "a.bs1",
        TOUCHES,
        {},
        "file 'a.bs1': this format holds one recording only (got 3). "
        "Write a folder or .zip, with members.",
        id="several in one",
    ),
    pytest.param(
        "a.npy",
        replace(TOUCHES, labels=None),
        {"structured": True},
        "file 'a.npy': this format holds one recording only (got 3). "
        "Write a folder or .zip, with members.",
        id="several as events",
    ),
    pytest.param(
        "a.npy",
        TOUCHES,
        {},
        "file 'a.npy': this format cannot hold labels, and the file name does not give "
        "them (3 of them). Write .npz, .pt, a folder or .zip, or one recording with "
        "_label_<k> in its name.",
        id="labels of an array",
    ),
    pytest.param(
        "a.bs1",
        TOUCHES.subset([2]),
        {},
        "file 'a.bs1': this format cannot hold labels, and the file name does not give "
        "them (2). Write .npz, .pt, a folder or .zip, or one recording with _label_<k> "
        "in its name.",
        id="a label that is not in the name",
    ),
    pytest.param(
        "a_label_1.tact",
        SILENT,
        {},
        "file 'a_label_1.tact': this format cannot hold labels, and the file name does "
        "not give them (none). Write .npz, .pt, a folder or .zip, or one recording with "
        "_label_<k> in its name.",
        id="a label only in the name",
    ),
    pytest.param(
        "a.zip",
        BOTH,
        {"members": "tact", "sensor": SensorLayout("mine", taxels=156)},
        "file 'a.zip': raw text holds one or two fingertips (156 taxels against 39 or "
        "78). Write .npz.",
        id="more taxels than two fingertips have",
    ),
    pytest.param(
        "a.tact",
        SILENT,
        {},
        "file 'a.tact': recording 0 is silent, which raw text cannot express. Write .npz.",
        id="silence as text",
    ),
    pytest.param(
        "a_label_4.tact",
        sparse(78).subset([0]),
        {},
        "file 'a_label_4.tact': its first steps are silent, and without a .startend file "
        "a recording begins with its first event. "
        "Write a folder or .zip with members tact.",
        id="silence at the start of one text",
    ),
    pytest.param(
        "a.zip",
        sparse(4 * 39, steps=500),
        {"members": "bs1"},
        "file 'a.zip': an event's microsecond does not fit its bits (9900000 against "
        "8388607). Write .npz.",
        id="times after 23 bits",
    ),
    pytest.param(
        "a.zip",
        sparse(78, seconds=1e-6),
        {"members": "bs1"},
        "file 'a.zip': its bins are too narrow for times in microseconds (1e-06 s "
        "against 2e-06). Write .npz.",
        id="bins below a microsecond",
    ),
    pytest.param(
        ".",
        TOUCHES,
        {},
        "folder '{folder}': it is not empty, and recordings would mix. "
        "Name a new folder, or a .zip.",
        id="a folder that is not empty",
    ),
    pytest.param(
        "none/a.npz",
        TOUCHES,
        {},
        "file 'a.npz': its folder does not exist. Make the folder first.",
        id="into no folder",
    ),
]


@pytest.mark.parametrize(("name", "recordings", "options", "message"), REFUSED)
def test_recordings_that_a_format_cannot_hold_are_refused(
    tmp_path: Path, name: str, recordings: Recordings, options: dict[str, Any], message: str
) -> None:
    (tmp_path / "mine.txt").touch()
    with pytest.raises(InputError) as caught:
        write_recordings(tmp_path / name, recordings, **options)
    assert str(caught.value) == message.replace("{folder}", tmp_path.name)
    assert [file.name for file in tmp_path.iterdir()] == ["mine.txt"]
