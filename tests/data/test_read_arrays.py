"""Array files (``.npy``, ``.npz``, ``.pt``, HDF5): orders of axes, places of labels, equal bytes when written, refusals.

Files may be hostile: none of their objects may run code, and no declared size may exhaust memory.
"""

from __future__ import annotations

import os
import warnings
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
import torch

from hw_model.io.files import npy_bytes
from locsnn_compile.data.read import read_recordings, recording_parts
from locsnn_compile.data.recordings import Expected, Recordings
from locsnn_compile.data.write import write_recordings
from locsnn_compile.errors import InputError

FULL = np.random.default_rng(3).integers(0, 2, size=(4, 39, 2, 10), dtype=np.uint8)
"""Recordings (samples, taxels, polarities, steps) of a NeuTouch fingertip."""
STEPS = FULL.reshape(4, 78, 10).transpose(0, 2, 1)
"""The same recordings as they are read: (samples, steps, channels)."""
LABELS = np.array([3, 0, 2, 2])


@pytest.mark.parametrize(
    ("array", "expected"),
    [
        pytest.param(FULL, STEPS, id="samples, taxels, polarities, steps"),
        pytest.param(FULL.reshape(4, 78, 10), STEPS, id="samples, channels, steps"),
        pytest.param(FULL[1], STEPS[1:2], id="one: taxels, polarities, steps"),
        pytest.param(FULL[1].reshape(78, 10), STEPS[1:2], id="one: channels, steps"),
        pytest.param(FULL.astype(np.float32), STEPS, id="float32"),
        pytest.param(FULL.astype(bool), STEPS, id="bool"),
        pytest.param(np.asfortranarray(FULL), STEPS, id="column-major"),
    ],
)
@pytest.mark.parametrize("suffix", [".npy", ".npz", ".pt"])
def test_arrays_of_usual_orders_of_axes_are_read(
    tmp_path: Path, array: np.ndarray, expected: np.ndarray, suffix: str
) -> None:
    path = tmp_path / f"x{suffix}"
    if suffix == ".npy":
        np.save(path, array)
    elif suffix == ".npz":
        np.savez_compressed(path, touches=array)
    else:
        torch.save(torch.from_numpy(array), path)
    read_back = read_recordings(path)
    assert np.array_equal(read_back.spikes, expected)
    assert read_back.labels is None
    assert read_back.step_seconds is None
    assert read_back.source == f"x{suffix}"
    assert recording_parts(path) == ()


def labels_beside(path: Path) -> Path:
    np.save(path / "x.npy", FULL)
    np.save(path / "x_labels.npy", LABELS)
    return path / "x.npy"


def labels_in_npz(path: Path) -> Path:
    np.savez(path / "x.npz", data=FULL, labels=LABELS.astype(float), step_seconds=0.02)
    return path / "x.npz"


def labels_in_pt(path: Path) -> Path:
    values = {
        "spikes": torch.from_numpy(FULL),
        "labels": torch.from_numpy(LABELS),
        "step_seconds": 0.02,
    }
    torch.save(values, path / "x.pt")
    return path / "x.pt"


@pytest.mark.parametrize("make", [labels_beside, labels_in_npz, labels_in_pt])
def test_labels_may_be_a_vector_in_the_file_or_next_to_it(
    tmp_path: Path, make: Callable[[Path], Path]
) -> None:
    read_back = read_recordings(make(tmp_path))
    assert read_back.labels is not None
    assert read_back.labels.tolist() == LABELS.tolist()


def test_a_label_may_be_in_the_name_of_the_file(tmp_path: Path) -> None:
    np.save(tmp_path / "sample_4_label_17.npy", FULL[0])
    read_back = read_recordings(tmp_path / "sample_4_label_17.npy")
    assert read_back.labels is not None
    assert read_back.labels.tolist() == [17]


def test_a_bin_width_that_is_not_the_files_is_refused(tmp_path: Path) -> None:
    path = labels_in_npz(tmp_path)
    assert read_recordings(path).step_seconds == 0.02
    assert read_recordings(path, step_seconds=0.1 / 5).step_seconds == 0.02
    with pytest.raises(InputError) as caught:
        read_recordings(path, step_seconds=0.5)
    assert str(caught.value) == (
        f"step_seconds: file {path.name!r} holds bins of another width (got 0.5 against 0.02). Leave it out."
    )


@pytest.mark.parametrize("width", [0.02, 0.001, 1e-4, 0.3])
def test_a_bin_width_in_single_precision_is_that_of_its_model(tmp_path: Path, width: float) -> None:
    np.savez(tmp_path / "x.npz", spikes=FULL, step_seconds=np.float32(width))
    model = Expected("model 'm'", step_seconds=width, steps=FULL.shape[-1])
    read_back = read_recordings(tmp_path / "x.npz", step_seconds=width, model=model)
    assert read_back.step_seconds == float(np.float32(width))


@pytest.mark.parametrize(
    "recordings",
    [
        pytest.param(
            Recordings(STEPS, LABELS, step_seconds=0.02, source="x.npz"), id="all entries"
        ),
        pytest.param(
            Recordings(STEPS, labels=None, step_seconds=None, source="x.npz"), id="spikes alone"
        ),
    ],
)
def test_written_recordings_come_back_and_are_the_same_bytes(
    tmp_path: Path, recordings: Recordings
) -> None:
    write_recordings(tmp_path / "x.npz", recordings)
    read_back = read_recordings(tmp_path / "x.npz")
    assert np.array_equal(read_back.spikes, recordings.spikes)
    if recordings.labels is None:
        assert read_back.labels is None
    else:
        assert np.array_equal(read_back.labels, recordings.labels)
    assert read_back.step_seconds == recordings.step_seconds
    write_recordings(tmp_path / "again.npz", read_back)
    assert (tmp_path / "again.npz").read_bytes() == (tmp_path / "x.npz").read_bytes()
    assert sorted(file.name for file in tmp_path.iterdir()) == ["again.npz", "x.npz"]
    with np.load(tmp_path / "x.npz") as entries:
        assert entries["spikes"].shape == (4, 78, 10)


def test_writing_into_a_folder_that_does_not_exist_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError) as caught:
        write_recordings(
            tmp_path / "none" / "x.npz",
            Recordings(STEPS, labels=None, step_seconds=None, source="x"),
        )
    assert str(caught.value) == ("file 'x.npz': its folder does not exist. Make the folder first.")


class Hostile:
    """An object that creates a file ``ran`` when it is unpickled."""

    def __reduce__(self) -> tuple[Callable[..., Any], tuple[str]]:
        return os.system, ("touch ran",)


def twice(*names):
    """Return a function that writes a ``.npz`` with the same array under each of the names."""

    def make(path):
        with warnings.catch_warnings(), zipfile.ZipFile(path, "w") as archive:
            warnings.simplefilter("ignore")  # zipfile warns of the name that it writes again
            for name in names:
                archive.writestr(name, npy_bytes(np.asarray(FULL)))

    return make


def npz(**entries: Any) -> Callable[[Path], object]:
    """Return a function that writes a ``.npz`` of these entries."""
    return lambda path: np.savez(path, **entries)


def half_npz(path: Path) -> None:
    np.savez(path, spikes=FULL)
    path.write_bytes(path.read_bytes()[:1500])


def bomb(path: Path) -> None:
    """Write a small ``.npz`` whose entry declares three billion values."""
    header = b"\x93NUMPY\x01\x00v\x00"
    text = b"{'descr': '|u1', 'fortran_order': False, 'shape': (3000000000,), }"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("spikes.npy", header + text.ljust(117) + b"\n")


def bad_label_shape(path: Path) -> None:
    np.save(path, FULL)
    np.save(path.with_name("a_labels.npy"), LABELS[:3])


BAD: list[tuple[str, str, Callable[[Path], object], str]] = [
    ("missing", "a.npy", lambda path: None, "file 'a.npy': it does not exist. Check the path."),
    (
        "unknown kind",
        "a.xyz",
        Path.touch,
        "file 'a.xyz': its kind is not known (ending '.xyz'). "
        "Give one of: .zip, .npy, .npz, .pt, .h5, .hdf5, .tact, .bs1, .bs2, .bin, .aedat4, "
        ".aedat, .raw, .dat, .csv, or a folder.",
    ),
    (
        "empty npy",
        "a.npy",
        Path.touch,
        "file 'a.npy': it is damaged or not a numpy file. Write it again with numpy.save.",
    ),
    (
        "pickle in npy",
        "a.npy",
        lambda path: np.save(path, np.array([Hostile()], dtype=object), allow_pickle=True),
        "file 'a.npy': its values are not numbers (dtype object). Write it again with numpy.save.",
    ),
    (
        "five axes",
        "a.npy",
        lambda path: np.save(path, FULL[np.newaxis]),
        "file 'a.npy': its shape is not one of recordings (5 axes against 2 to 4). "
        "Give (samples, channels, steps) or (samples, taxels, polarities, steps).",
    ),
    (
        "a number",
        "a.npy",
        lambda path: np.save(path, 0),
        "file 'a.npy': its shape is not one of recordings (0 axes against 2 to 4). "
        "Give (samples, channels, steps) or (samples, taxels, polarities, steps).",
    ),
    (
        "no samples",
        "a.npy",
        lambda path: np.save(path, FULL[:0]),
        "recordings 'a.npy': no recordings inside (shape (0, 10, 78)). "
        "Give binned recordings of zeros and ones.",
    ),
    (
        "NaN",
        "a.npy",
        lambda path: np.save(path, np.full((1, 2, 3), np.nan)),
        "recordings 'a.npy': its values are not all 0 or 1 (nan at sample 0, channel 0, step 0). "
        "Give binned recordings of zeros and ones; numbers go to layers on the host (locsnn-compile "
        "--host-layers).",
    ),
    (
        "labels of another number",
        "a.npy",
        bad_label_shape,
        "recordings 'a.npy': labels and recordings differ in number ((3,) against (4,)). "
        "Give one class number from 0 up per recording.",
    ),
    (
        "truncated npz",
        "a.npz",
        half_npz,
        "file 'a.npz': it is damaged, truncated or not a .npz file. Write it again with numpy.savez.",
    ),
    (
        "absurd shape in npz",
        "a.npz",
        bomb,
        "file 'a.npz', 'spikes.npy': its declared shape is too large (3000000000 against 200000000 values). "
        "Give a smaller array.",
    ),
    (
        "npz with several arrays",
        "a.npz",
        npz(a=FULL, b=FULL),
        "file 'a.npz': it is not clear which entry holds the recordings (entries: a, b). "
        "Name the entry 'spikes'.",
    ),
    (
        "npz with labels alone",
        "a.npz",
        npz(labels=LABELS),
        "file 'a.npz': no recordings inside (entries: labels). Name the entry 'spikes'.",
    ),
    (
        "npz with an entry twice",
        "a.npz",
        twice("spikes.npy", "spikes.npy"),
        "file 'a.npz': it contains 'spikes.npy' twice. Write it again with numpy.savez.",
    ),
    (
        "npz with an entry of two spellings",
        "a.npz",
        twice("spikes.npy", "spikes"),
        "file 'a.npz': it contains an entry twice, with and without '.npy'. "
        "Write it again with numpy.savez.",
    ),
    (
        "pt with a label that no float holds",
        "a.pt",
        lambda path: torch.save({"spikes": torch.zeros(1, 4, 9), "labels": [10**400]}, path),
        "file 'a.pt': its entry 'labels' holds no numbers. Give plain numbers.",
    ),
    (
        "bin width of two numbers",
        "a.npz",
        npz(spikes=FULL, step_seconds=[1.0, 2.0]),
        "file 'a.npz': its entry 'step_seconds' is not one number. Give the width of a bin.",
    ),
    (
        "damaged pt",
        "a.pt",
        lambda path: path.write_bytes(b"PK\x03\x04 not really"),
        "file 'a.pt': it is damaged, truncated or not a torch file. Write it again with torch.save.",
    ),
    (
        "hostile pt",
        "a.pt",
        lambda path: torch.save({"spikes": Hostile()}, path),
        "file 'a.pt': it contains objects that would run code when read, so it was not read (posix.system). "
        "Save tensors and plain values only.",
    ),
    (
        "a checkpoint as events",
        "a.pt",
        lambda path: torch.save({"format": "locsnn-checkpoint", "weights": {}}, path),
        "file 'a.pt': it is a trained network, not recordings. "
        "Give it as the model, and recordings as events.",
    ),
    (
        "text in pt",
        "a.pt",
        lambda path: torch.save({"spikes": "none"}, path),
        "file 'a.pt': its entry 'spikes' is not an array (str). Give the recordings as one tensor.",
    ),
    (
        "float8 in pt",
        "a.pt",
        lambda path: torch.save(torch.zeros(2, 3, 4).to(torch.float8_e5m2), path),
        "file 'a.pt': its entry 'spikes' is not an array (torch.float8_e5m2). Give uint8.",
    ),
    (
        "sparse tensor",
        "a.pt",
        lambda path: torch.save(torch.zeros(2, 3, 4).to_sparse(), path),
        "file 'a.pt': its entry 'spikes' is not an array (torch.sparse_coo on cpu). "
        "Give a dense tensor.",
    ),
    (
        "tensor that claims to be huge",
        "a.pt",
        lambda path: torch.save(torch.zeros(1, 1, 1, 1).expand(10**9, 39, 2, 10), path),
        "file 'a.pt': it is too large (780000000000 values against 200000000). Give at most 256410 at a time "
        "and average the figures of the parts, or give wider bins.",
    ),
    (
        "labels of text in pt",
        "a.pt",
        lambda path: torch.save({"spikes": torch.zeros(1, 2, 3), "labels": ["cup"]}, path),
        "file 'a.pt': its entry 'labels' holds no numbers. Give plain numbers.",
    ),
]


@pytest.mark.parametrize(
    ("name", "make", "message"), [pytest.param(n, m, t, id=i) for i, n, m, t in BAD]
)
def test_files_without_readable_recordings_are_refused(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    name: str,
    make: Callable[[Path], object],
    message: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    make(tmp_path / name)
    with pytest.raises(InputError) as caught, warnings.catch_warnings(record=True) as leaked:
        read_recordings(tmp_path / name)
    assert str(caught.value) == message
    assert not leaked
    assert not (tmp_path / "ran").exists()


MEANT = {
    "label": "labels",
    "Labels": "labels",
    "lables": "labels",
    "step_second": "step_seconds",
    "class_name": "class_names",
}


@pytest.mark.parametrize("name", MEANT)
@pytest.mark.parametrize("suffix", [".npz", ".pt", ".h5"])
def test_an_entry_that_is_almost_of_a_known_name_is_refused(
    tmp_path: Path, name: str, suffix: str
) -> None:
    """Such an entry is probably a misspelling, so it is not ignored as others are."""
    path = tmp_path / f"a{suffix}"
    if suffix == ".npz":
        np.savez(path, spikes=FULL, **{name: LABELS})
    elif suffix == ".pt":
        torch.save({"spikes": torch.from_numpy(FULL), name: torch.from_numpy(LABELS)}, path)
    else:
        with h5py.File(path, "w") as file:
            file["spikes"], file[name] = FULL, LABELS
    with pytest.raises(InputError) as caught:
        read_recordings(path)
    meant = f"Did you mean {MEANT[name]!r}? Rename or remove it."
    assert str(caught.value) == f"file 'a{suffix}', entry {name!r}: it has no meaning here. {meant}"


def test_arrays_of_other_names_are_ignored(tmp_path: Path) -> None:
    others = ("taxels", "times", "names", "mask", "classes", "train_labels", "spikes2")
    np.savez(
        tmp_path / "a.npz",
        spikes=FULL,
        labels=LABELS,
        label=LABELS + 1,
        **dict.fromkeys(others, LABELS),
    )
    read_back = read_recordings(tmp_path / "a.npz").labels
    assert read_back is not None
    assert np.array_equal(read_back, LABELS)


class Notes:
    """An object of a user's own class, which numpy and torch pickle."""


WORDS = ["Ada", "Böge", "Chi", "Dee"]
NOT_NUMBERS = {
    "speakers": np.array(WORDS),
    "raw_speakers": np.array([word.encode() for word in WORDS]),
    "dates": np.array(["2024-01-01"] * 4, dtype="datetime64[D]"),
    "notes": np.array([Notes()] * 4, dtype=object),
    "spread": np.full(4, np.nan),
    "phase": np.full(4, 1j),
}
"""Arrays that people store next to recordings: texts, dates, objects, numbers that are not finite or not real."""


@pytest.mark.parametrize("called", ["spikes", "touches"])
@pytest.mark.parametrize("suffix", [".npz", ".pt", ".h5"])
def test_entries_that_are_not_numbers_are_ignored(tmp_path: Path, called: str, suffix: str) -> None:
    path = tmp_path / f"a{suffix}"
    more = {name: array for name, array in NOT_NUMBERS.items() if array.dtype.kind in "SUMO"}
    if called == "spikes":
        more = NOT_NUMBERS
    if suffix == ".npz":
        np.savez(path, labels=LABELS, **{called: FULL}, **more)
    elif suffix == ".pt":
        held = {called: torch.from_numpy(FULL), "labels": torch.from_numpy(LABELS)}
        torch.save({**held, "speakers": WORDS, "sensor": {"taxels": 39}, "age": 3}, path)
    else:
        with h5py.File(path, "w") as file:
            file[called], file["labels"] = FULL, LABELS
            file["speakers"] = WORDS
            file.create_dataset("empty", data=h5py.Empty("f"))
            if called == "spikes":
                file["spread"], file["phase"] = NOT_NUMBERS["spread"], NOT_NUMBERS["phase"]
    read_back = read_recordings(path)
    assert np.array_equal(read_back.spikes, STEPS)
    assert read_back.labels is not None
    assert np.array_equal(read_back.labels, LABELS)


def test_bins_may_be_as_narrow_as_the_steps_of_a_model(tmp_path: Path) -> None:
    """The limit of bin widths is for sorting events into bins; these recordings are bins already."""
    np.save(tmp_path / "a.npy", np.zeros((1, 2, 3)))
    read_back = read_recordings(
        tmp_path / "a.npy", model=Expected("model 'a'", step_seconds=1e-7, channels=2)
    )
    assert read_back.spikes.shape == (1, 3, 2)
    assert read_back.step_seconds == 1e-7


def test_a_part_of_a_single_file_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError) as caught:
        read_recordings(labels_beside(tmp_path), split="train")
    assert str(caught.value) == (
        "file 'x.npy': there is no part 'train' (a single file is not divided). Leave the part out."
    )


def test_a_size_of_true_is_one(tmp_path: Path) -> None:
    """numpy accepts the size True in a header, but not for an array."""
    path = tmp_path / "a.npy"
    path.write_bytes(
        npy_bytes(np.zeros((1, 78, 4), np.uint8)).replace(b"(1, 78, 4), }   ", b"(True, 78, 4), }")
    )
    assert read_recordings(path).spikes.shape == (1, 4, 78)
