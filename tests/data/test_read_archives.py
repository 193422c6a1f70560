"""Archives and folders of one ``.npy`` file per recording, as the EvTouch data sets are published.

Files are named ``sample_<i>_label_<k>.npy``, in folders of a train and a test part. Each has the axes (taxels,
polarities, steps).
"""

from __future__ import annotations

import io
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from locsnn_compile.data.read import read_recordings, recording_parts
from locsnn_compile.data.recordings import Binned
from locsnn_compile.errors import InputError
from tests.support.real_recordings import REAL, on_real_recordings

RNG = np.random.default_rng(7)
ONE = [RNG.integers(0, 2, size=(39, 2, 12)).astype(np.float32) for _ in range(12)]


def npy(array: np.ndarray) -> bytes:
    """Return the bytes of an array as a ``.npy`` file."""
    stream = io.BytesIO()
    np.save(stream, array)
    return stream.getvalue()


def archive(path: Path, members: dict[str, bytes]) -> Path:
    """Write a ``.zip`` of these members."""
    with zipfile.ZipFile(path, "w") as packed:
        for name, data in members.items():
            packed.writestr(name, data)
    return path


def divided(path: Path) -> Path:
    """Write an archive with two parts, whose files are not in the order of their numbers."""
    members = {f"Ev-X/test/sample_{i}_label_{i % 3}.npy": npy(ONE[i]) for i in (10, 2, 0)}
    members |= {f"Ev-X/train/sample_{i}_label_{i % 3}.npy": npy(ONE[i]) for i in (11, 1)}
    return archive(path, {"Ev-X/": b"", "Ev-X/README": b"x", **members})


@pytest.mark.parametrize(
    ("split", "samples", "labels"),
    [
        pytest.param(None, [0, 2, 10], [0, 2, 1], id="test by default"),
        pytest.param("test", [0, 2, 10], [0, 2, 1], id="test"),
        pytest.param("train", [1, 11], [1, 2], id="train"),
    ],
)
@pytest.mark.parametrize("unpacked", [False, True], ids=["archive", "folder"])
def test_parts_are_read_in_the_order_of_their_numbers(
    tmp_path: Path, split: str | None, samples: list[int], labels: list[int], unpacked: bool
) -> None:
    path = divided(tmp_path / "Ev-X.zip")
    if unpacked:
        with zipfile.ZipFile(path) as packed:
            packed.extractall(tmp_path / "x")
        path = tmp_path / "x"
    recordings = read_recordings(path, split=split, step_seconds=0.02)
    assert recordings.labels is not None
    assert recordings.labels.tolist() == labels
    for row, sample in enumerate(samples):
        for taxel, polarity, step in np.ndindex(39, 2, 12):
            assert (
                recordings.spikes[row, step, 2 * taxel + polarity]
                == ONE[sample][taxel, polarity, step]
            )
    assert recordings.source == path.name
    assert recordings.step_seconds == 0.02
    assert recording_parts(path) == ("train", "test")


def test_an_archive_without_parts_is_read_whole(tmp_path: Path) -> None:
    path = archive(tmp_path / "a.zip", {f"sample_{i}_label_0.npy": npy(ONE[i]) for i in (1, 0)})
    assert np.array_equal(read_recordings(path).spikes[1, 3], ONE[1][..., 3].reshape(-1))
    assert recording_parts(path) == ()


def members(**values: bytes) -> Callable[[Path], object]:
    """Return a function that writes an archive of test recordings of class 0, one for each value."""
    return lambda path: archive(
        path, {f"test/sample_{name[1:]}_label_0.npy": data for name, data in values.items()}
    )


def truncated(path: Path) -> None:
    """Write an archive without its last bytes."""
    path.write_bytes(divided(path).read_bytes()[:-200])


def flipped(path: Path) -> None:
    """Write an archive with one wrong bit in its recording."""
    data = bytearray(archive(path, {"test/sample_0_label_0.npy": npy(ONE[0])}).read_bytes())
    data[300] ^= 1
    path.write_bytes(data)


def huge_header() -> bytes:
    """Return a ``.npy`` header that declares 10^18 values, without values."""
    stream = io.BytesIO()
    np.lib.format.write_array_header_1_0(
        stream, {"shape": (10**6, 10**6, 10**6), "fortran_order": False, "descr": "<f4"}
    )
    return stream.getvalue()


BAD: list[tuple[str, Callable[[Path], object], str]] = [
    (
        "missing",
        lambda path: None,
        "archive 'a.zip': it cannot be read (No such file or directory). Check the path.",
    ),
    (
        "empty file",
        Path.touch,
        "archive 'a.zip': it is damaged, truncated or not a zip archive. Fetch the archive again.",
    ),
    (
        "truncated",
        truncated,
        "archive 'a.zip': it is damaged, truncated or not a zip archive. Fetch the archive again.",
    ),
    (
        "damaged member",
        flipped,
        "archive 'a.zip', 'sample_0_label_0.npy': it is damaged. Fetch the archive again.",
    ),
    (
        "nothing inside",
        lambda path: archive(path, {"notes.txt": b"x"}),
        "archive 'a.zip': no recordings inside. "
        "Give sample_<i>.npy or sample_<i>_label_<k>.npy files, or one .npz file.",
    ),
    (
        "an array of another name",
        lambda path: archive(
            path,
            {"a/sample_0.npy": npy(ONE[0]), "b/touch.npy": npy(ONE[1]), "b/._sample_0.npy": b""},
        ),
        "archive 'a.zip': 'b/touch.npy' is not named as recordings are. "
        "Rename it to sample_<i>.npy or sample_<i>_label_<k>.npy, or move it away.",
    ),
    (
        "empty folder",
        Path.mkdir,
        "folder 'a.zip': no recordings inside. "
        "Give sample_<i>.npy or sample_<i>_label_<k>.npy files, or one .npz file.",
    ),
    (
        "mixed shapes",
        members(_0=npy(ONE[0]), _1=npy(np.concatenate([ONE[1], ONE[1]]))),
        "archive 'a.zip', 'sample_1_label_0.npy': its channels are not those of the first recording "
        "(156 against 78). Give recordings of one sensor.",
    ),
    (
        "a count inside",
        members(_0=npy(ONE[0]), _1=npy(ONE[1] * 3)),
        "archive 'a.zip', 'sample_1_label_0.npy': its values are not all 0 or 1 "
        "(3.0 at {first}). Give binned recordings of zeros and ones; numbers go to layers on the "
        "host (locsnn-compile --host-layers).",
    ),
    (
        "text values",
        members(_0=npy(np.array([["a"]]))),
        "archive 'a.zip', 'sample_0_label_0.npy': its values are not numbers (dtype <U1). "
        "Write it again with numpy.save.",
    ),
    (
        "pickled objects",
        members(_0=npy(np.array([[None]], dtype=object))),
        "archive 'a.zip', 'sample_0_label_0.npy': its values are not numbers (dtype object). "
        "Write it again with numpy.save.",
    ),
    (
        "no numpy file",
        members(_0=b"hello"),
        "archive 'a.zip', 'sample_0_label_0.npy': it is damaged or not a numpy file. "
        "Write it again with numpy.save.",
    ),
    (
        "truncated member",
        members(_0=npy(ONE[0])[:-10]),
        "archive 'a.zip', 'sample_0_label_0.npy': it is truncated (3734 of 3744 bytes). "
        "Write it again with numpy.save.",
    ),
    (
        "absurd declared shape",
        members(_0=huge_header()),
        "archive 'a.zip', 'sample_0_label_0.npy': its declared shape is too large "
        "(1000000x1000000x1000000 against 200000000 values). Give a smaller array.",
    ),
    (
        "a label in some names",
        lambda path: archive(
            path, {"sample_0_label_1.npy": npy(ONE[0]), "sample_1.npy": npy(ONE[1])}
        ),
        "archive 'a.zip', 'sample_1.npy': its name has no label, although others have one. "
        "Name it like the others, or move it away.",
    ),
    (
        "several recordings in one file",
        members(_0=npy(np.zeros((2, 39, 2, 5)))),
        "archive 'a.zip', 'sample_0_label_0.npy': it is not one recording (2 against 1). "
        "Give one per file.",
    ),
]


@pytest.mark.parametrize(("make", "message"), [pytest.param(m, t, id=i) for i, m, t in BAD])
def test_archives_without_readable_recordings_are_refused(
    tmp_path: Path, make: Callable[[Path], object], message: str
) -> None:
    path = tmp_path / "a.zip"
    make(path)
    channel, step = next(
        (c, t) for t in range(12) for c in range(78) if ONE[1].reshape(78, 12)[c, t]
    )
    with pytest.raises(InputError) as caught:
        read_recordings(path)
    assert str(caught.value) == message.replace(
        "{first}", f"sample 0, channel {channel}, step {step}"
    )


@pytest.mark.parametrize("steps", [None, 9, 20])
def test_recordings_of_different_lengths_are_padded_or_cut(
    tmp_path: Path, steps: int | None
) -> None:
    path = archive(
        tmp_path / "a.zip", {f"sample_{i}.npy": npy(ONE[i][..., : 12 - 5 * i]) for i in (0, 1, 2)}
    )
    recordings = read_recordings(path, steps=steps)
    assert recordings.spikes.shape == (3, steps or 12, 78)
    for i, spikes in enumerate(recordings.spikes):
        expected = np.zeros((steps or 12, 78))
        own = ONE[i][..., : min(12 - 5 * i, len(expected))].reshape(78, -1).T
        expected[: len(own)] = own
        assert np.array_equal(spikes, expected)
    late = int(ONE[0][..., 9:].sum())
    assert recordings.binned == (
        Binned(
            threshold=None,
            events=int(sum(ONE[i][..., : 12 - 5 * i].sum() for i in range(3))),
            outside=late,
            below=0,
        )
        if steps == 9
        else None
    )


def test_a_part_of_an_archive_without_parts_is_refused(tmp_path: Path) -> None:
    path = archive(tmp_path / "a.zip", {"sample_0_label_0.npy": npy(ONE[0])})
    with pytest.raises(InputError) as caught:
        read_recordings(path, split="train")
    what = "there is no part 'train' (it is not divided)"
    assert (
        str(caught.value)
        == f"archive 'a.zip': {what}. Leave the part out, or divide it by --split."
    )


@pytest.mark.parametrize(
    ("split", "message"),
    [
        pytest.param(
            "tests", "split: 'tests' is not known. Did you mean 'test'?", id="unknown part"
        ),
        pytest.param(
            "train",
            "archive 'a.zip': there is no part 'train' (it has test). Choose one of: test.",
            id="part that is missing",
        ),
    ],
)
def test_parts_that_do_not_exist_are_refused(tmp_path: Path, split: str, message: str) -> None:
    path = archive(tmp_path / "a.zip", {"test/sample_0_label_0.npy": npy(ONE[0])})
    with pytest.raises(InputError) as caught:
        read_recordings(path, split=split)
    assert str(caught.value) == message


@on_real_recordings
@pytest.mark.parametrize(
    ("name", "steps", "classes", "train", "test"),
    [
        pytest.param("Ev-Objects", 250, 36, 576, 144, id="objects"),
        pytest.param("Ev-Containers", 325, 20, 240, 60, id="containers"),
    ],
)
def test_real_archives_have_the_published_recordings(
    name: str, steps: int, classes: int, train: int, test: int
) -> None:
    """Every class has as many recordings; a recording has some 2,500 events."""
    for split, samples in (("train", train), ("test", test)):
        recordings = read_recordings(REAL / f"{name}.zip", split=split)
        assert recordings.labels is not None
        assert recordings.spikes.shape == (samples, steps, 78)
        assert np.bincount(recordings.labels).tolist() == [samples // classes] * classes
        assert 2400 < recordings.spikes.sum() / samples < 2700
