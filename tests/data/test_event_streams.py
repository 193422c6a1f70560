"""Files of single events: SLAYER's ``.bs1`` and ``.bs2``, structured arrays, folders and archives of them.

Events are sorted into bins of steps and channels. Files that cannot be read are refused with the whole message tested.
"""

from __future__ import annotations

import io
import stat
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import locsnn_compile as lc
from locsnn_compile.data.read import read_recordings
from locsnn_compile.errors import InputError
from locsnn_compile.request.recordings import recordings_for

TXYP = np.dtype([("t", "i8"), ("x", "i2"), ("y", "i2"), ("p", "i1")])


def bs1(*events: tuple[int, int, int]) -> bytes:
    """Return events (neuron, polarity, microseconds) as ``.bs1`` packs them, each as one number of 40 bits."""
    return b"".join((n << 24 | p << 23 | t).to_bytes(5, "big") for n, p, t in events)


def bs2(*events: tuple[int, int, int, int]) -> bytes:
    """Return events (x, y, polarity, microseconds) in the five bytes of ``.bs2``, the highest first."""
    return b"".join((x << 32 | y << 24 | p << 23 | t).to_bytes(5, "big") for x, y, p, t in events)


def found_events(path: Path, **options: Any) -> tuple[tuple[int, ...], list[tuple[int, ...]]]:
    """Return the shape of the recordings in a file, and the (recording, step, channel) of every event."""
    recordings = read_recordings(path, **options)
    return recordings.spikes.shape, [
        tuple(map(int, where)) for where in np.argwhere(recordings.spikes)
    ]


@pytest.mark.parametrize(
    ("name", "data", "options", "shape", "events"),
    [
        pytest.param(
            "a.bs1", bs1((3, 0, 0), (1, 0, 40_000)), {}, (1, 3, 4), [(0, 0, 3), (0, 2, 1)], id="bs1"
        ),
        pytest.param(
            "a.bs1",
            bs1((3, 0, 0), (1, 1, 1)),
            {},
            (1, 1, 8),
            [(0, 0, 3), (0, 0, 6)],
            id="bs1 polarities",
        ),
        pytest.param(
            "a.bs1",
            bs1((3, 0, 0), (1, 1, 1)),
            {"merge_polarities": True},
            (1, 1, 4),
            [(0, 0, 1), (0, 0, 3)],
            id="bs1 polarities together",
        ),
        pytest.param(
            "a.bs1",
            bs1((1, 0, 0)),
            {"polarities": 2},
            (1, 1, 4),
            [(0, 0, 2)],
            id="bs1 one polarity of two",
        ),
        pytest.param(
            "a.bs1",
            bs1((0, 0, 10_000), (0, 0, 10_001)),
            {},
            (1, 2, 1),
            [(0, 0, 0), (0, 1, 0)],
            id="both sides of the middle between two steps",
        ),
        pytest.param(
            "a.bs1",
            bs1((65_535, 0, 8_388_607)),
            {},
            (1, 420, 65_536),
            [(0, 419, 65_535)],
            id="largest neuron and time",
        ),
        pytest.param(
            "a.bs1",
            bs1((0, 0, 300)),
            {"step_seconds": 0.0003},
            (1, 2, 1),
            [(0, 1, 0)],
            id="a width that floats miss",
        ),
        pytest.param(
            "a.bs1",
            bs1((0, 0, 0), (0, 0, 1), (0, 0, 20_000)),
            {"threshold": 1},
            (1, 2, 1),
            [(0, 0, 0)],
            id="threshold",
        ),
        pytest.param(
            "a.bs1",
            bs1((0, 0, 0), (0, 0, 90_000)),
            {"steps": 3},
            (1, 3, 1),
            [(0, 0, 0)],
            id="later events are cut off",
        ),
        pytest.param(
            "a.bs1",
            bs1((2, 0, 0)),
            {"channels": 6, "steps": 2},
            (1, 2, 6),
            [(0, 0, 2)],
            id="channels and steps given",
        ),
        pytest.param(
            "a.bs1", b"", {"channels": 2, "steps": 3}, (1, 3, 2), [], id="silence of a given size"
        ),
        pytest.param(
            "a.bs2",
            bs2((2, 0, 0, 0), (1, 3, 0, 0)),
            {},
            (1, 1, 11),
            [(0, 0, 2), (0, 0, 10)],
            id="bs2",
        ),
        pytest.param(
            "a.bs2",
            bs2((2, 0, 1, 0), (1, 1, 0, 0)),
            {"columns": 5},
            (1, 1, 14),
            [(0, 0, 5), (0, 0, 12)],
            id="bs2 polarities and columns",
        ),
        pytest.param(
            "a.bs2",
            bs2((255, 255, 1, 8_388_607)),
            {"polarities": 2},
            (1, 420, 131_072),
            [(0, 419, 131_071)],
            id="bs2 largest",
        ),
        pytest.param(
            "a.bs1",
            bs1((3, 1, 0), (1, 1, 0)),
            {},
            (1, 1, 4),
            [(0, 0, 1), (0, 0, 3)],
            id="bs1 of one polarity, which is 1",
        ),
        pytest.param(
            "a.bs2",
            bs2((2, 0, 1, 0), (1, 1, 1, 0)),
            {},
            (1, 1, 5),
            [(0, 0, 2), (0, 0, 4)],
            id="bs2 of one polarity, which is 1",
        ),
        pytest.param(
            "a.bs1",
            bs1((3, 1, 0)),
            {"polarities": 1},
            (1, 1, 4),
            [(0, 0, 3)],
            id="a sensor of one polarity, which is 1",
        ),
    ],
)
def test_slayer_events_become_bins(
    tmp_path: Path,
    name: str,
    data: bytes,
    options: dict[str, Any],
    shape: tuple[int, ...],
    events: list[tuple[int, ...]],
) -> None:
    (tmp_path / name).write_bytes(data)
    assert found_events(tmp_path / name, **options) == (shape, events)


PUBLISHED_TIMES = (400, 600, 1500, 2900)
"""Microseconds of four events of a published example of SLAYER, in steps of 1 ms."""


def written_events(name: str, microseconds: tuple[int, ...]) -> bytes | np.ndarray:
    """Return events of channel 0 at these times, in the format that the name ends in."""
    match name.rpartition(".")[2]:
        case "bs1":
            return bs1(*((0, 0, time) for time in microseconds))
        case "bs2" | "bin":
            return bs2(*((0, 0, 0, time) for time in microseconds))
        case _:
            return structured([(time, 0, 0, 0) for time in microseconds])


@pytest.mark.parametrize(
    ("name", "steps"),
    [("a.bs1", [0, 1, 2, 3]), ("a.bs2", [0, 1, 2, 3]), ("a.bin", [0, 1, 2]), ("a.npy", [0, 1, 2])],
)
def test_slayer_files_put_an_event_into_the_nearest_step_and_others_into_its_bin(
    tmp_path: Path, name: str, steps: list[int]
) -> None:
    content = written_events(name, PUBLISHED_TIMES)
    if isinstance(content, bytes):
        (tmp_path / name).write_bytes(content)
    else:
        np.save(tmp_path / name, content)
    recordings = read_recordings(tmp_path / name, step_seconds=0.001)
    assert np.flatnonzero(recordings.spikes[0, :, 0]).tolist() == steps


@pytest.mark.parametrize("seconds", [0.001, 0.0003, 0.0007, 0.01, 1 / 3000])
def test_steps_of_slayer_files_are_those_of_slayer_s_own_formula(
    tmp_path: Path, seconds: float
) -> None:
    """``np.round(microseconds / 1000 / Ts)``, Ts in milliseconds, as slayerPytorch and lava-dl count."""
    times = np.arange(0, 20_000, 50)
    (tmp_path / "a.bs1").write_bytes(bs1(*((0, 0, int(time)) for time in times)))
    recordings = read_recordings(tmp_path / "a.bs1", step_seconds=seconds)
    theirs = np.round(times / 1000 / (seconds * 1000)).astype(int)
    assert np.flatnonzero(recordings.spikes[0, :, 0]).tolist() == np.unique(theirs).tolist()


def structured(rows: list[tuple[float, ...]], dtype: Any = TXYP) -> np.ndarray:
    """Return a structured array of these rows, by default with the fields t, x, y and p."""
    return np.array(rows, dtype=dtype)


@pytest.mark.parametrize(
    ("array", "events"),
    [
        pytest.param(
            structured([(0, 1, 0, 0), (25_000, 0, 2, 1)]), [(0, 0, 2), (0, 1, 9)], id="t x y p"
        ),
        pytest.param(
            structured([(0, 1, 0), (25_000, 0, 1)], [("t", "u4"), ("x", "u1"), ("p", "?")]),
            [(0, 0, 2), (0, 1, 1)],
            id="without y, bool p",
        ),
        pytest.param(
            structured([(1, 0, 5e4), (-1, 1, 0)], [("p", "f4"), ("x", ">i8"), ("t", "f8")]),
            [(0, 0, 2), (0, 2, 1)],
            id="any order, floats, p -1",
        ),
    ],
)
@pytest.mark.parametrize("suffix", [".npy", ".npz"])
def test_structured_arrays_of_events_become_bins(
    tmp_path: Path, array: np.ndarray, events: list[tuple[int, ...]], suffix: str
) -> None:
    path = tmp_path / f"a_label_7{suffix}"
    np.save(path, array) if suffix == ".npy" else np.savez(path, events=array)
    assert found_events(path)[1] == events
    labels = read_recordings(path).labels
    assert labels is not None
    assert labels.tolist() == [7]


@pytest.mark.parametrize("packed", [False, True], ids=["folder", "archive"])
def test_a_set_has_one_size_and_the_order_of_its_numbers(tmp_path: Path, packed: bool) -> None:
    files = {
        "10_label_1.bs1": bs1((4, 0, 0)),
        "2_label_0.bs1": bs1((0, 1, 50_000)),
        "notes.txt": b"hello",
    }
    (tmp_path / "set").mkdir()
    for name, data in files.items():
        (tmp_path / "set" / name).write_bytes(data)
    path = tmp_path / "set"
    if packed:
        path = tmp_path / "set.zip"
        with zipfile.ZipFile(path, "w") as archive:
            for name, data in files.items():
                archive.writestr(f"train/{name}", data)
    assert found_events(path) == ((2, 3, 10), [(0, 2, 1), (1, 0, 8)])
    recordings = read_recordings(path)
    assert recordings.labels is not None
    assert recordings.labels.tolist() == [0, 1]
    assert recordings.step_seconds == 0.02


def test_an_archive_of_raw_text_has_times_of_its_grasps(tmp_path: Path) -> None:
    """The ``.startend`` file gives the time of the grasp, at which step 0 begins."""
    with zipfile.ZipFile(tmp_path / "a.zip", "w") as archive:
        archive.writestr("a_label_2.tact", "1 3 100.0\n1 3 100.005\n")
        archive.writestr("a_label_2.startend", "grasping 99.99\n")
    assert found_events(tmp_path / "a.zip") == ((1, 325, 156), [(0, 0, 4)])


def test_one_part_may_have_labels_and_the_other_none(tmp_path: Path) -> None:
    for name in ("test/sample_0.npy", "train/sample_1_label_3.npy"):
        (tmp_path / name).parent.mkdir()
        np.save(tmp_path / name, np.ones((2, 3), dtype=np.uint8))
    assert read_recordings(tmp_path).labels is None
    assert read_recordings(tmp_path, split="train").labels.tolist() == [3]


def put(name: str, data: bytes) -> Callable[[Path], Path]:
    """Return a function that writes these bytes to a file of a folder, and returns its path."""

    def make(folder: Path) -> Path:
        (folder / name).write_bytes(data)
        return folder / name

    return make


def put_npy(array: np.ndarray) -> Callable[[Path], Path]:
    """Return a function that writes an array as ``a.npy`` to a folder, and returns its path."""
    content = io.BytesIO()
    np.save(content, array)
    return put("a.npy", content.getvalue())


def put_folder(**files: bytes) -> Callable[[Path], Path]:
    """Return a function that writes a folder of files, in whose names ``__`` stands for a dot."""

    def make(folder: Path) -> Path:
        (folder / "set").mkdir()
        for name, data in files.items():
            (folder / "set" / name.replace("__", ".")).write_bytes(data)
        return folder / "set"

    return make


def zip_of(members: list[tuple[str, int]]) -> Callable[[Path], Path]:
    """Return a function that writes an archive of files with one event each, given by name and mode."""

    def make(folder: Path) -> Path:
        with zipfile.ZipFile(folder / "a.zip", "w") as archive:
            for name, mode in members:
                entry = zipfile.ZipInfo(name)
                entry.external_attr = mode << 16
                archive.writestr(entry, bs1((0, 0, 0)))
        return folder / "a.zip"

    return make


def refused(network: lc.Network, path: Path) -> str:
    """Return the message with which a file is refused for a network."""
    with pytest.raises(InputError) as caught:
        recordings_for(network, path)
    return str(caught.value)


def test_a_network_tells_the_reader_the_number_of_channels(tmp_path: Path) -> None:
    network = lc.load(Path(__file__).parents[2] / "examples/models/objects-hybrid.pt")
    (tmp_path / "a.bs1").write_bytes(bs1((3, 0, 0), (1, 1, 40_000)))
    assert recordings_for(network, tmp_path / "a.bs1").spikes.shape == (1, 3, 78)
    (tmp_path / "b.bs1").write_bytes(bs1((39, 1, 0), (0, 0, 0)))
    assert refused(network, tmp_path / "b.bs1") == (
        "file 'b.bs1': it has events on channels that the sensor does not have (channel 79 against 0..77). "
        "Give events of this sensor, or more channels."
    )


def test_a_network_refuses_events_that_may_count_taxels_or_channels(tmp_path: Path) -> None:
    network = lc.load(Path(__file__).parents[2] / "examples/models/objects-hybrid.pt")
    (tmp_path / "a.bs1").write_bytes(bs1((38, 0, 0)))
    assert refused(network, tmp_path / "a.bs1") == (
        "file 'a.bs1': its events have one polarity, so x may count taxels or channels (up to 38 of 78 channels). "
        "Give --polarities 2 (taxels) or 1 (channels)."
    )
    for polarities, channel in ((1, 38), (2, 76)):
        recordings = read_recordings(
            tmp_path / "a.bs1", polarities=polarities, model=network.expected
        )
        assert np.argwhere(recordings.spikes).tolist() == [[0, 0, channel]]
    (tmp_path / "a.bs1").write_bytes(bs1((39, 0, 0)))  # a fingertip has 39 taxels, 0 to 38
    assert np.argwhere(recordings_for(network, tmp_path / "a.bs1").spikes).tolist() == [[0, 0, 39]]


@pytest.mark.parametrize("highest", [3, 2], ids=["the last column", "no event in it"])
def test_a_grid_of_another_width_is_never_assumed(tmp_path: Path, highest: int) -> None:
    """The sensor has 12 channels, as a grid of 4 columns has; a file may not reach the last column."""
    (tmp_path / "a.bs2").write_bytes(bs2((highest, 0, 0, 0), (1, 2, 0, 0)))
    asked = {"channels": 12, "steps": 1, "polarities": 1}
    if highest == 3:
        assert found_events(tmp_path / "a.bs2", **asked) == ((1, 1, 12), [(0, 0, 3), (0, 0, 9)])
    else:
        with pytest.raises(InputError, match="the width of its grid is not known"):
            read_recordings(tmp_path / "a.bs2", **asked)
    assert found_events(tmp_path / "a.bs2", **asked, columns=4) == (
        (1, 1, 12),
        [(0, 0, highest), (0, 0, 9)],
    )


FIELDS = "Give the fields t (microseconds), x, y if there is one, and p (0 or 1)."
BAD = [
    pytest.param(
        put("a.bs1", bs1((0, 0, 0)) + b"ab"),
        {},
        "file 'a.bs1': it ends within an event (7 bytes, 5 per event). Give a whole file.",
        id="half an event",
    ),
    pytest.param(
        put("a.bs1", b""),
        {},
        "file 'a.bs1': no events inside. Give a recording with events.",
        id="no events",
    ),
    pytest.param(
        put("a.bs2", b""),
        {"steps": 4},
        "file 'a.bs2': no events inside. Give a recording with events.",
        id="no events, but steps",
    ),
    pytest.param(
        put("a.bs1", bs1((78, 0, 0))),
        {"channels": 78},
        "file 'a.bs1': it has events on channels that the sensor does not have (channel "
        "78 against 0..77). Give events of this sensor, or more channels.",
        id="a channel too high",
    ),
    pytest.param(
        put("a.bs2", bs2((7, 0, 0, 0))),
        {"columns": 7},
        "file 'a.bs2': an event lies outside the grid (x 7 against 7 columns). Give more columns.",
        id="outside the grid",
    ),
    pytest.param(
        put("a.bs2", bs2((2, 0, 0, 0), (0, 1, 0, 0))),
        {"channels": 8},
        "file 'a.bs2': the width of its grid is not known (up to 3 x 2 in 8 channels). "
        "Give --grid WxH of the sensor.",
        id="a grid of unknown width",
    ),
    pytest.param(
        put("a.bs1", bs1((0, 0, 8_000_000))),
        {"step_seconds": 1e-5},
        "file 'a.bs1': it lasts too long for its bins (8 s in bins of 1e-05 s against "
        "20000 bins). Start it at its first event with --start first.",
        id="too many bins",
    ),
    pytest.param(
        put("a.bs1", bs1((65_535, 0, 8_000_000))),
        {"step_seconds": 0.001},
        "file 'a.bs1': its recordings of 1 x 8001 x 65536 are too large (524353536 "
        "values against 200000000). Give wider bins, or shorter recordings.",
        id="too large",
    ),
    pytest.param(
        put("a.bs1", b""),
        {"polarities": 3},
        "recordings, polarities: it must be a whole number from 1 to 2 (got 3). Correct it.",
        id="three polarities",
    ),
    pytest.param(
        put_npy(structured([(0, 1)], [("t", "i8"), ("x", "i8")])),
        {},
        f"file 'a.npy': its values are not events (fields t, x). {FIELDS}",
        id="a field missing",
    ),
    pytest.param(
        put_npy(structured([(0, 1, 1, 1)], [("t", "i8"), ("x", "i8"), ("p", "i1"), ("z", "i8")])),
        {},
        f"file 'a.npy': its values are not events (fields t, x, p, z). {FIELDS}",
        id="another field",
    ),
    pytest.param(
        put_npy(structured([(0, 1, 1, 1)])[np.newaxis]),
        {},
        f"file 'a.npy': its values are not events (2 axes). {FIELDS}",
        id="two axes",
    ),
    pytest.param(
        put_npy(structured([(0, 1, 1, 1), (-5, 1, 1, 1)])),
        {},
        "file 'a.npy': its field 't' is out of range (-5 of event 1 against whole "
        f"numbers 0..9007199254740992). {FIELDS}",
        id="time before 0",
    ),
    pytest.param(
        put_npy(structured([(np.nan, 1, 1)], [("t", "f8"), ("x", "i8"), ("p", "i1")])),
        {},
        "file 'a.npy': its field 't' is out of range (nan of event 0 against whole "
        f"numbers 0..9007199254740992). {FIELDS}",
        id="time not a number",
    ),
    pytest.param(
        put_npy(structured([(0, 1, 1, 2)])),
        {},
        "file 'a.npy': its field 'p' is out of range (2 of event 0 against whole numbers "
        f"-1..1). {FIELDS}",
        id="a polarity of 2",
    ),
    pytest.param(
        put_npy(structured([(0, "a", 1)], [("t", "i8"), ("x", "U3"), ("p", "i1")])),
        {},
        f"file 'a.npy': its field 'x' is not one number (<U3). {FIELDS}",
        id="a text as place",
    ),
    pytest.param(
        put_npy(np.zeros(2, dtype=[("t", "i8"), ("x", "i8", (3,)), ("p", "i1")])),
        {},
        f"file 'a.npy': its field 'x' is not one number (int64). {FIELDS}",
        id="a vector as place",
    ),
    pytest.param(
        put_npy(np.zeros(2, dtype=[("t", "O"), ("x", "i8"), ("p", "i1")])),
        {},
        "file 'a.npy': its values are not numbers (dtype [('t', 'O'), ('x', '<i8'), "
        "('p', 'i1')]). Write it again with numpy.save.",
        id="a pickle in a field",
    ),
    pytest.param(
        put_folder(a__bs1=bs1((0, 0, 0)), b__bs2=bs2((0, 0, 0, 0))),
        {},
        "folder 'set': its recordings are of several kinds (.bs1, .bs2). "
        "Give recordings of one kind.",
        id="several kinds",
    ),
    pytest.param(
        zip_of([("a.bs1", 0o644), ("a.bs1", 0o644)]),
        {},
        "archive 'a.zip': it contains 'a.bs1' twice. Fetch the archive again.",
        id="a name twice",
    ),
    pytest.param(
        zip_of([("a.bs1", stat.S_IFLNK | 0o777)]),
        {},
        "archive 'a.zip': 'a.bs1' is a link, and links are not followed. Store the file itself.",
        id="a link in an archive",
    ),
    pytest.param(
        put_folder(a__bs1=b"abc"),
        {},
        "folder 'set', 'a.bs1': it ends within an event (3 bytes, 5 per event). Give a whole file.",
        id="half an event in a folder",
    ),
    pytest.param(
        put("a.tact", b"1 1 0\n" * 2_000_000),
        {},
        "file 'a.tact': it is too large (12000000 bytes against 10000000). Give one recording.",
        id="text that is too long",
    ),
]


@pytest.mark.filterwarnings("ignore:Duplicate name")
@pytest.mark.parametrize(("make", "options", "message"), BAD)
def test_files_without_readable_events_are_refused(
    tmp_path: Path, make: Callable[[Path], Path], options: dict[str, Any], message: str
) -> None:
    path = make(tmp_path)
    with pytest.raises(InputError) as caught:
        read_recordings(path, **options)
    assert str(caught.value) == message
