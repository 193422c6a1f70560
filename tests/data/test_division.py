"""Train and test parts of data sets that are not in separate folders.

Either a share of every class is tested on (``--split``), or files list the recordings of each part, as those of VT_SNN
do for five rounds of cross-validation (``--fold``): in round 1, ``test_80_20_1.txt`` lists the 20 % that are tested on
and ``train_80_20_1.txt`` the others, each with the number of a recording and its class on a line.
"""

from __future__ import annotations

import contextlib
import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from locsnn_compile.cli.compile import main as compile_main
from locsnn_compile.cli.main import main
from locsnn_compile.data import Recordings, read_recordings, recording_parts, write_recordings
from locsnn_compile.data.read import stratified_split
from locsnn_compile.data.synthetic import synthetic_touches
from locsnn_compile.errors import InputError
from locsnn_compile.models.checkpoint_reader import read_checkpoint
from tests.support.published_files import write_preprocessed, write_slip

CHANNELS = 78
"""Channels of a fingertip; preprocessed recordings of VT_SNN have two fingertips."""
LABELS = [0] * 10 + [1] * 5 + [2]
"""Labels of the 16 recordings below: ten, five and one of a class."""


def write_single(folder: Path, name: str = "set.npz") -> Path:
    """Write 16 recordings that can be told apart: number k has its only event in channel k."""
    number = np.arange(len(LABELS))
    spikes = np.zeros((len(LABELS), 40, CHANNELS), dtype=np.uint8)
    spikes[number, 3, number] = 1
    write_recordings(
        folder / name, Recordings(spikes, np.array(LABELS), step_seconds=0.02, source=name)
    )
    return folder / name


def numbers(recordings: Recordings) -> list[int]:
    """Return the number of the one channel on which each recording has events."""
    return [int(spikes.any(axis=0).argmax()) for spikes in recordings.spikes]


def test_a_share_of_every_class_is_in_the_test_part(tmp_path: Path) -> None:
    path = write_single(tmp_path)
    train = read_recordings(path, split="train", test_share=0.2)
    test = read_recordings(path, split="test", test_share=0.2)
    by_default = read_recordings(path, test_share=0.2)
    assert sorted(numbers(train) + numbers(test)) == list(range(len(LABELS)))
    assert test.labels is not None
    # A fifth of ten and of five; the one recording of the last class is trained on.
    assert np.bincount(test.labels, minlength=3).tolist() == [2, 1, 0]
    assert [LABELS[number] for number in numbers(test)] == test.labels.tolist()
    assert numbers(by_default) == numbers(test)
    assert train.source == "set.npz, train part (split 0.2, round 1)"
    assert test.source == "set.npz, test part (split 0.2, round 1)"
    assert recording_parts(path) == ()
    assert recording_parts(path, test_share=0.2) == ("train", "test")


def test_rounds_take_turns(tmp_path: Path) -> None:
    path = write_single(tmp_path)
    tested = [numbers(read_recordings(path, test_share=0.2, fold=fold)) for fold in range(1, 6)]
    # The one recording of the last class is never in the test part.
    assert sorted(number for test in tested for number in test) == list(range(15))
    assert tested[0] == numbers(read_recordings(path, test_share=0.2))


@pytest.mark.parametrize(("share", "rounds"), [(0.2, 5), (1 / 3, 3), (0.5, 2), (0.1, 10), (0.3, 3)])
def test_no_recording_is_tested_in_two_rounds(share: float, rounds: int) -> None:
    """If a class has fewer recordings than there are rounds, each round tests one, and some come again."""
    for count in range(2, 40):
        labels = np.zeros(count, dtype=np.int64)
        parts = [
            stratified_split(labels, share, seed=0, fold=fold) for fold in range(1, rounds + 1)
        ]
        for train, test in parts:
            assert np.array_equal(np.sort(np.concatenate((train, test))), np.arange(count))
        sizes = [len(test) for _, test in parts]
        tested = np.concatenate([test for _, test in parts])
        if count < rounds:
            # One for each round, although there are not enough: some come again.
            assert sizes == [1] * rounds
            assert len(np.unique(tested)) == count
        else:
            assert max(sizes) - min(sizes) <= 1
            assert len(np.unique(tested)) == len(tested) == round(share * rounds * count)


def test_a_folder_without_parts_is_divided(tmp_path: Path) -> None:
    write_slip(tmp_path / "slip", each=5)
    train = read_recordings(tmp_path / "slip", split="train", test_share=0.2)
    test = read_recordings(tmp_path / "slip", split="test", test_share=0.2)
    assert len(train) == 8
    assert len(test) == 2
    assert test.class_names == ("stable", "rotate")


@pytest.mark.parametrize("name", [".", "tact.pt"], ids=["folder", "file"])
def test_files_list_the_recordings_of_each_round(name: str, tmp_path: Path) -> None:
    spikes = write_preprocessed(tmp_path)
    path = tmp_path / name
    assert recording_parts(path) == ("train", "test")
    for fold in (None, 1, 4):
        # ``write_preprocessed`` deals its 20 recordings out to five rounds; without a round, the first one is read.
        chosen = np.arange(20) % 5 == (fold or 1) - 1
        train = read_recordings(path, split="train", fold=fold)
        test = read_recordings(path, split="test", fold=fold)
        assert np.array_equal(test.spikes, spikes[chosen])
        assert np.array_equal(train.spikes, spikes[~chosen])
        assert test.labels is not None
        assert test.labels.tolist() == np.sort(np.arange(20) % 2)[chosen].tolist()
        assert test.source == f"tact.pt, test part (round {fold or 1} of 5)"
    assert np.array_equal(read_recordings(path, fold=4).spikes, test.spikes)


def test_a_tensor_without_lists_of_recordings_is_not_divided(tmp_path: Path) -> None:
    spikes = write_preprocessed(tmp_path, rounds=0)
    recordings = read_recordings(tmp_path / "tact.pt")
    assert recordings.labels is None
    assert recordings.source == "tact.pt"
    assert np.array_equal(recordings.spikes, spikes)


def divided(folder: Path) -> Path:
    """Write a set with folders of a train and a test part, and return its path."""
    for part in ("train", "test"):
        (folder / "set" / part).mkdir(parents=True)
        np.save(folder / "set" / part / "sample_1_label_0.npy", np.eye(CHANNELS, 5, dtype=np.uint8))
    return folder / "set"


def unlabelled(folder: Path) -> Path:
    """Write recordings without labels, and return their path."""
    write_recordings(
        folder / "set.npz",
        Recordings(np.ones((2, 3, CHANNELS)), labels=None, step_seconds=0.02, source="set.npz"),
    )
    return folder / "set.npz"


def rounds(folder: Path) -> Path:
    """Write preprocessed recordings with five rounds, and return their folder."""
    write_preprocessed(folder)
    return folder


FIX = "Write the number of a recording and its class on every line."


def listed(text: str) -> Callable[[Path], Path]:
    """Return a function that writes preprocessed recordings, with this text as the list of round 1's test recordings."""

    def write(folder: Path) -> Path:
        write_preprocessed(folder)
        (folder / "test_80_20_1.txt").write_text(text)
        return folder

    return write


@pytest.mark.parametrize(
    ("write", "options", "message"),
    [
        pytest.param(
            divided,
            {"test_share": 0.2},
            "split: 'set' is divided already (into train, test). Leave it out.",
            id="folders",
        ),
        pytest.param(
            divided,
            {"fold": 2},
            "fold: 'set' is divided already (into train, test). Leave it out.",
            id="folders, round",
        ),
        pytest.param(
            rounds,
            {"test_share": 0.2},
            "split: 'tact.pt' is divided already (into rounds). Leave it out.",
            id="files",
        ),
        pytest.param(
            rounds,
            {"fold": 6},
            "fold: 'tact.pt' has no such round (got 6 against 1, 2, 3, 4, 5). Choose one of them.",
            id="round 6",
        ),
        pytest.param(
            rounds,
            {"fold": 0},
            "fold: 'tact.pt' has no such round (got 0 against 1, 2, 3, 4, 5). Choose one of them.",
            id="round 0",
        ),
        pytest.param(
            write_single,
            {"fold": 3, "test_share": 0.5},
            "fold: 'set.npz' has no such round (got 3 against 1, 2). Choose one of them.",
            id="round 3 of a half",
        ),
        pytest.param(
            write_single,
            {"fold": 3},
            "fold: 'set.npz' has no such round (got 3 against none). "
            "Add --split with the share of every class to test on.",
            id="no rounds",
        ),
        pytest.param(
            write_single,
            {"test_share": 1.0},
            "split: it is out of range (got 1.0 against 0.001..0.9). Correct the number.",
            id="all",
        ),
        pytest.param(
            write_single,
            {"test_share": float("nan")},
            "split: it is out of range (got nan against 0.001..0.9). Correct the number.",
            id="NaN",
        ),
        pytest.param(
            unlabelled,
            {"test_share": 0.2},
            "recordings 'set.npz': they have no labels to divide them by. Give labelled recordings.",
            id="no labels",
        ),
        pytest.param(
            listed("1 0\n2\n"),
            {},
            f"file 'test_80_20_1.txt': it does not hold two whole numbers per line. {FIX}",
            id="one number",
        ),
        pytest.param(
            listed("1 x\n"),
            {},
            f"file 'test_80_20_1.txt': it does not hold two whole numbers per line. {FIX}",
            id="a word",
        ),
        pytest.param(
            listed(""),
            {},
            f"file 'test_80_20_1.txt': it does not hold two whole numbers per line. {FIX}",
            id="empty",
        ),
        pytest.param(
            listed("20 0\n"),
            {},
            f"file 'test_80_20_1.txt': recording 20 is not there (of 20). {FIX}",
            id="too high",
        ),
        pytest.param(
            listed("9" * 400 + " 0\n"),
            {},
            f"file 'test_80_20_1.txt': recording {'9' * 20} is not there (of 20). {FIX}",
            id="absurd",
        ),
        pytest.param(
            listed("-1 0\n"),
            {},
            f"file 'test_80_20_1.txt': recording -1 is not there (of 20). {FIX}",
            id="negative",
        ),
        pytest.param(
            listed("0 0\n1 0\n"),
            {},
            f"file 'test_80_20_1.txt': recording 1 is in the round twice (of 20). {FIX}",
            id="in both parts",
        ),
        pytest.param(
            listed(f"0 {10**30}\n"),
            {},
            "recordings 'tact.pt': its labels are not class numbers (1000000000000000000000000000000 of recording 0 against 0..100000). "
            "Give one class number from 0 up per recording.",
            id="absurd class",
        ),
    ],
)
def test_a_division_that_is_not_possible_is_refused(
    write: Callable[[Path], Path], options: dict[str, float], message: str, tmp_path: Path
) -> None:
    path = write(tmp_path)
    with pytest.raises(InputError) as caught:
        read_recordings(path, **options)  # type: ignore[arg-type]
    assert str(caught.value).replace(", test part (round 1 of 5)", "") == message


@given(text=st.text("0123456789 -.\t\nex", max_size=12))
@settings(max_examples=60, deadline=None)
def test_any_list_of_recordings_is_read_or_refused(
    text: str, tmp_path_factory: pytest.TempPathFactory
) -> None:
    folder = tmp_path_factory.mktemp("rounds")
    write_recordings(
        folder / "tact.pt",
        Recordings(np.ones((3, 4, 2 * CHANNELS)), labels=None, step_seconds=None, source="tact.pt"),
    )
    (folder / "train_80_20_1.txt").write_text("2 0\n")
    (folder / "test_80_20_1.txt").write_text(text)
    with contextlib.suppress(InputError):
        recordings = read_recordings(folder)
        assert recordings.labels is not None
        assert 0 < len(recordings) < 3
        labels = [int(line.split()[1]) for line in text.splitlines()]
        assert labels == recordings.labels.tolist()


def test_a_list_without_that_of_the_other_part_is_refused(tmp_path: Path) -> None:
    write_preprocessed(tmp_path)
    (tmp_path / "test_80_20_1.txt").unlink()
    with pytest.raises(InputError) as caught:
        read_recordings(tmp_path, split="train")
    line = "file 'test_80_20_1.txt': it does not exist, but the file of the other part does. Give both."
    assert str(caught.value) == line


def test_training_and_the_events_command_agree_on_the_parts(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    write_recordings(
        "motions.npz", synthetic_touches(20, steps=40, fingertips=2, classes=2, seed=3)
    )
    options = ["--split", "0.2", "--fold", "2"]
    quick = ["--epochs", "1", "--hidden", "4", "--recordings", "9"]
    # 3: after so little training, the network may have learned nothing.
    assert main(["train", "--data", "motions.npz", *options, *quick, "-o", "net.pt"]) in (0, 3)
    printed = capsys.readouterr().out
    assert "motions.npz, train part (split 0.2, round 2): 16 recordings\n" in printed
    assert "motions.npz, test part (split 0.2, round 2): 4 recordings\ntest accuracy " in printed
    checkpoint = read_checkpoint("net.pt")
    assert checkpoint.description.input.sensor.surfaces == 2
    assert checkpoint.training["dataset"] == "motions.npz, train part (split 0.2, round 2)"
    assert checkpoint.training["split"] == 0.2
    assert checkpoint.training["fold"] == 2
    assert checkpoint.training["test_recordings"] == 4
    test = read_recordings("motions.npz", test_share=0.2, fold=2)
    assert checkpoint.recordings is not None
    assert np.array_equal(checkpoint.recordings.spikes, test.spikes)
    assert main(["events", "motions.npz", *options, "--part", "train", "--to", "train.npz"]) == 0
    assert capsys.readouterr().out.startswith(
        "motions.npz, train part (split 0.2, round 2): 16 recordings, 40 steps"
    )
    assert len(read_recordings("train.npz")) == 16


@pytest.mark.slow
def test_checks_play_the_test_part_and_calibrations_the_train_part(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    write_preprocessed(tmp_path / "preprocessed")
    quick = ["--epochs", "1", "--hidden", "4", "--quiet", "--recordings", "0", "-o", "net.pt"]
    assert main(["train", "--data", "preprocessed", "--fold", "3", *quick]) in (0, 3)
    both = ["--events", "preprocessed", "--calibration", "preprocessed", "--fold", "3"]
    assert compile_main(["net.pt", *both, "--json", "-o", "out"]) == 0
    report = json.loads(capsys.readouterr().out)
    assert report["match"]["events_source"] == "tact.pt, test part (round 3 of 5)"
    assert report["strategy_choice"]["calibration_source"] == "tact.pt, train part (round 3 of 5)"
    write_single(tmp_path)
    assert main(["train", "--data", "set.npz", "--split", "0.2", *quick]) in (0, 3)
    assert compile_main(["net.pt", "--quiet", "--strategy", "dendrite", "-o", "out"]) == 0
    played = [
        "run",
        "out",
        "--events",
        "set.npz",
        "--split",
        "0.2",
        "--stop",
        "margin",
        "--calibrate",
        "set.npz",
    ]
    assert main([*played, "--json"]) == 0
    calibrated = json.loads(capsys.readouterr().out)["stop"]["calibrated_on"]
    assert calibrated["source"] == "set.npz, train part (split 0.2, round 1)"
    assert calibrated["recordings"] == 13


def test_training_takes_a_round_that_files_list(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    write_preprocessed(tmp_path / "preprocessed")
    Path("fold.yaml").write_text("{epochs: 1, hidden: 4, fold: 3, step_seconds: 0.001}")
    assert (
        main(
            ["train", "--data", "preprocessed", "--config", "fold.yaml", "--quiet", "-o", "net.pt"]
        )
        == 0
    )
    checkpoint = read_checkpoint("net.pt")
    assert checkpoint.description.input.channels == 2 * CHANNELS
    assert checkpoint.training["test_recordings"] == 4
    assert checkpoint.training["dataset"] == "tact.pt, train part (round 3 of 5)"
