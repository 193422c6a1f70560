"""Folders and archives with a whole set of recordings in each part (train, test), and the order of class names."""

from __future__ import annotations

import zipfile
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
import torch

from locsnn_compile.cli.main import main as locsnn
from locsnn_compile.data.read import read_recordings, recording_parts
from locsnn_compile.data.recordings import Expected
from locsnn_compile.errors import InputError
from locsnn_compile.training.config import TrainingConfig
from locsnn_compile.training.from_python import read_parts

RNG = np.random.default_rng(0)
SETS = {"train": RNG.random((5, 6, 8)) < 0.3, "test": RNG.random((3, 6, 7)) < 0.3}
"""Spikes of each part, (samples, channels, steps)."""
LABELS = {"train": np.array([0, 1, 2, 1, 0]), "test": np.array([2, 0, 1])}


def write_set(path: Path, spikes: np.ndarray, **more: Any) -> None:
    """Write a set in the format of the file's ending, with ``more`` entries; labels of a ``.npy`` get a file of their own."""
    path.parent.mkdir(parents=True, exist_ok=True)
    if path.suffix == ".npz":
        np.savez(path, spikes=spikes, **more)
    elif path.suffix == ".npy":
        np.save(path, spikes)
        np.save(path.with_name(f"{path.stem}_labels.npy"), more["labels"])
    elif path.suffix == ".pt":
        tensors = {"spikes": torch.from_numpy(spikes)}
        torch.save(tensors | {name: torch.from_numpy(value) for name, value in more.items()}, path)
    else:
        with h5py.File(path, "w") as file:
            for name, value in {"spikes": spikes, **more}.items():
                file[name] = value


def packed(folder: Path) -> Path:
    """Write an archive of a folder's files next to the folder, and return its path."""
    path = folder.with_suffix(".zip")
    with zipfile.ZipFile(path, "w") as archive:
        for file in sorted(folder.rglob("*")):
            archive.write(file, file.relative_to(folder.parent))
    return path


@pytest.mark.parametrize("archive", [False, True], ids=["folder", "archive"])
@pytest.mark.parametrize(
    "names",
    [
        ("train.npz", "test.npz"),
        ("train/x.npz", "test/x.npz"),
        ("Train/a.npz", "Test/b.npz"),
        ("shd_train.h5", "shd_test.h5"),
        ("train.npy", "test.npy"),
        ("train.pt", "test.pt"),
    ],
    ids=" ".join,
)
def test_the_parts_of_a_published_split_are_read_as_stored(
    tmp_path: Path, names: tuple[str, str], archive: bool
) -> None:
    path = tmp_path / "set"
    for part, name in zip(SETS, names, strict=True):
        write_set(path / name, SETS[part], labels=LABELS[part])
    path = packed(path) if archive else path
    assert recording_parts(path) == ("train", "test")
    for part, name in zip(SETS, names, strict=True):
        recordings = read_recordings(path, split=part)
        assert np.array_equal(recordings.spikes, SETS[part].swapaxes(1, 2))
        assert recordings.labels is not None
        assert np.array_equal(recordings.labels, LABELS[part])
        assert recordings.source == f"{path.name}, {Path(name).name}"
    assert len(read_recordings(path)) == 3


def test_files_of_one_part_are_joined_and_shorter_ones_padded_with_silence(tmp_path: Path) -> None:
    for name, part in (("a.npz", "train"), ("b.npz", "test")):
        write_set(tmp_path / "set/train" / name, SETS[part], labels=LABELS[part])
    recordings = read_recordings(tmp_path / "set", split="train")
    shorter = np.zeros((3, 8, 6), dtype=np.uint8)
    shorter[:, :7] = SETS["test"].swapaxes(1, 2)
    assert np.array_equal(
        recordings.spikes, np.concatenate([SETS["train"].swapaxes(1, 2), shorter])
    )
    assert recordings.labels is not None
    assert recordings.labels.tolist() == [0, 1, 2, 1, 0, 2, 0, 1]
    assert recordings.source == "set, 2 files"


def test_files_of_one_part_with_classes_in_other_orders_are_joined_by_name(tmp_path: Path) -> None:
    orders = {"a.npz": ["cup", "ball", "egg"], "b.npz": ["egg", "cup", "ball"]}
    for name, order in orders.items():
        write_set(tmp_path / "set" / name, SETS["test"], labels=LABELS["test"], class_names=order)
    recordings = read_recordings(tmp_path / "set")
    assert recordings.class_names == ("cup", "ball", "egg")
    assert recordings.labels is not None
    assert recordings.labels.tolist() == [2, 0, 1, 1, 2, 0]


@pytest.mark.parametrize(
    ("more", "message"),
    [
        pytest.param(
            {"spikes": SETS["train"][:, :5], "labels": LABELS["train"]},
            "folder 'set': its files hold recordings of different sensors (5 channels in b.npz against 6 in a.npz). "
            "Give recordings of one sensor.",
            id="channels",
        ),
        pytest.param(
            {"spikes": SETS["train"]},
            "folder 'set': only some of its files have labels (a.npz, not b.npz). "
            "Give labels in all or none.",
            id="labels",
        ),
        pytest.param(
            {"spikes": SETS["train"], "labels": LABELS["train"], "step_seconds": 0.02},
            "folder 'set': its files have bins of different widths (0.02 s in b.npz against unknown in a.npz). "
            "Give files of one width.",
            id="widths",
        ),
    ],
)
def test_files_of_one_part_that_differ_are_refused(
    tmp_path: Path, more: dict[str, Any], message: str
) -> None:
    write_set(tmp_path / "set/a.npz", SETS["train"], labels=LABELS["train"])
    write_set(tmp_path / "set/b.npz", **more)
    with pytest.raises(InputError) as caught:
        read_recordings(tmp_path / "set")
    assert str(caught.value) == message


def folder_of_classes(path: Path, names: list[str]) -> Path:
    """Write one recording of each class into a folder of its name; recording k has events on channel k alone."""
    for index, name in enumerate(names):
        spikes = np.zeros((len(names), 4), dtype=np.uint8)
        spikes[index] = 1
        (path / name).mkdir(parents=True)
        np.save(path / name / f"sample_{index}.npy", spikes)
    return path


ENGLISH = ["zero", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten"]


@pytest.mark.parametrize(
    ("written", "order"),
    [
        pytest.param(ENGLISH, ENGLISH, id="number words"),
        pytest.param(["Three", "ONE", "two"], ["ONE", "two", "Three"], id="in any case"),
        pytest.param(["10", "9", "1"], ["1", "9", "10"], id="numbers"),
        pytest.param(
            ["eins", "one", "null", "zero"], ["zero", "one", "null", "eins"], id="two languages"
        ),
        pytest.param(["one", "cup", "two"], ["cup", "one", "two"], id="other words among them"),
        pytest.param(["3", "0", "1"], ["0", "1", "2", "3"], id="a digit is missing"),
        pytest.param(
            ["three", "zero", "ONE"], ["zero", "ONE", "two", "three"], id="a number word is missing"
        ),
        pytest.param(["10", "0", "20"], ["0", "10", "20"], id="numbers far apart"),
        pytest.param(["01", "00", "03"], ["00", "01", "03"], id="numbers with leading zeros"),
    ],
)
def test_numbers_and_number_words_keep_their_order(
    tmp_path: Path, written: list[str], order: list[str]
) -> None:
    recordings = read_recordings(folder_of_classes(tmp_path / "set", written))
    assert recordings.class_names == tuple(order)


def test_a_digit_is_the_label_even_if_another_digit_is_missing(tmp_path: Path) -> None:
    """As in a part of N-MNIST without an 8: recordings in the folder 9 have the label 9."""
    digits = ["0", "1", "2", "3", "4", "5", "6", "7", "9"]
    recordings = read_recordings(folder_of_classes(tmp_path / "set", digits))
    assert sorted(recordings.labels.tolist()) == [0, 1, 2, 3, 4, 5, 6, 7, 9]


def true_names(recordings: Any) -> list[str]:
    """Return the class name of each recording, in the order of the channel that its events are on."""
    channel = recordings.spikes.any(axis=1).argmax(axis=1)
    return [recordings.class_names[recordings.labels[i]] for i in np.argsort(channel)]


def test_an_order_of_class_names_can_be_given(tmp_path: Path) -> None:
    names = ["cup", "ball", "egg"]
    path = folder_of_classes(tmp_path / "set", names)
    assert read_recordings(path).class_names == ("ball", "cup", "egg")
    recordings = read_recordings(path, classes="egg,cup,ball,none")
    assert recordings.class_names == ("egg", "cup", "ball", "none")
    assert true_names(recordings) == names


def test_recordings_take_the_order_of_class_names_of_their_model(tmp_path: Path) -> None:
    names = ["cup", "ball", "egg"]
    path = folder_of_classes(tmp_path / "set", names)
    model = Expected("model 'a'", class_names=("egg", "hand", "cup", "ball"))
    recordings = read_recordings(path, model=model)
    assert recordings.class_names == model.class_names
    assert true_names(recordings) == names


def test_class_names_are_given_to_labels_that_have_none(tmp_path: Path) -> None:
    write_set(tmp_path / "a.npz", SETS["test"], labels=LABELS["test"])
    recordings = read_recordings(tmp_path / "a.npz", classes="egg,cup,ball")
    assert recordings.class_names == ("egg", "cup", "ball")
    assert recordings.labels is not None
    assert recordings.labels.tolist() == LABELS["test"].tolist()


@pytest.mark.parametrize(
    ("written", "more", "labels", "names"),
    [
        pytest.param(["cup", "ball", "cup"], {}, [1, 0, 1], ("ball", "cup"), id="by name"),
        pytest.param(["two", "zero", "one"], {}, [2, 0, 1], ("zero", "one", "two"), id="words"),
        pytest.param(["10", "9", "10"], {}, [1, 0, 1], ("9", "10"), id="numbers"),
        pytest.param(
            ["cup", "ball", "cup"],
            {"class_names": ["egg", "cup", "ball"]},
            [1, 2, 1],
            ("egg", "cup", "ball"),
            id="in the order of the file",
        ),
    ],
)
def test_labels_may_be_the_names_of_classes(
    tmp_path: Path,
    written: list[str],
    more: dict[str, Any],
    labels: list[int],
    names: tuple[str, ...],
) -> None:
    write_set(tmp_path / "a.npz", SETS["test"], labels=written, **more)
    recordings = read_recordings(tmp_path / "a.npz")
    assert recordings.labels is not None
    assert recordings.labels.tolist() == labels
    assert recordings.class_names == names


def test_a_label_that_is_no_class_is_refused(tmp_path: Path) -> None:
    write_set(tmp_path / "a.npz", SETS["test"], labels=["a", "b", "c"], class_names=["a", "b"])
    with pytest.raises(InputError) as caught:
        read_recordings(tmp_path / "a.npz")
    assert str(caught.value) == (
        "file 'a.npz': a label is not among its class names ('c' against a, b). Name all classes."
    )


@pytest.mark.parametrize(
    ("classes", "message"),
    [
        (
            "egg,cup",
            "classes: recordings 'set' have other classes (ball against egg, cup). Name all of them.",
        ),
        (
            "egg,cup,cup",
            "classes: a class is named twice (cup). Name each class once, from class 0 on.",
        ),
        (
            "egg,,cup",
            "classes: a class has no name (got 'egg,,cup'). Name each class once, from class 0 on.",
        ),
    ],
)
def test_class_names_that_do_not_fit_the_classes_are_refused(
    tmp_path: Path, classes: str, message: str
) -> None:
    path = folder_of_classes(tmp_path / "set", ["cup", "ball", "egg"])
    with pytest.raises(InputError) as caught:
        read_recordings(path, classes=classes)
    assert str(caught.value) == message


def test_parts_of_a_published_split_are_trained_and_tested_on_by_name(tmp_path: Path) -> None:
    """The files of the two parts name their classes in other orders."""
    orders = {"train": ["cup", "ball", "egg"], "test": ["egg", "cup", "ball"]}
    for part, order in orders.items():
        path = tmp_path / "set" / f"{part}.npz"
        write_set(path, SETS[part], labels=LABELS[part], class_names=order)
    train, test = read_parts(tmp_path / "set", TrainingConfig(channels=6), start=None)
    assert test is not None
    assert train.class_names == test.class_names == ("cup", "ball", "egg")
    assert test.labels is not None
    assert test.labels.tolist() == [1, 2, 0]


def test_every_command_takes_an_order_of_class_names(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = folder_of_classes(tmp_path / "set", ["cup", "ball", "egg"])
    assert locsnn(["events", str(path), "--classes", "egg,cup,ball"]) == 0
    assert "recording 0, label 1 (cup):" in capsys.readouterr().out
