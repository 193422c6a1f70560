"""The comparison of ways of training (``try_training.py``): no network is measured on recordings that it learned from.

Networks are small and recordings made up. Training is wrapped, so that tests see which recordings each network learned from.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from locsnn_compile.data.recordings import Recordings
from locsnn_compile.data.synthetic import synthetic_touches

STUDY = Path(__file__).parents[2] / "docs/research/results"


@pytest.fixture(autouse=True)
def study_can_be_imported(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let tests import the programs that lie next to their page."""
    monkeypatch.syspath_prepend(str(STUDY))


@pytest.mark.parametrize("per_class", [12, 13])
def test_every_recording_is_held_out_once_and_classes_are_spread(per_class: int) -> None:
    from ways import FOLDS, folds

    labels = np.repeat(np.arange(5), per_class)
    fold_of_recording = folds(labels, 3)
    counts = np.array(
        [np.bincount(fold_of_recording[labels == label], minlength=FOLDS) for label in range(5)]
    )
    assert counts.sum() == len(labels)
    assert counts.min() == 3
    assert counts.max() <= 4
    assert not np.array_equal(fold_of_recording, folds(labels, 4))
    assert np.array_equal(fold_of_recording, folds(labels, 3))


@pytest.mark.parametrize("dataset", ["containers", "objects"])
def test_every_way_has_options_that_can_be_trained_and_names_ways_that_exist(dataset: str) -> None:
    from ways import Coarse, Committee, Distilled, Setting, settings_of

    known = settings_of(STUDY / "tried_settings.yaml")
    for way in known.values():
        if isinstance(way, Committee):
            assert set(way.members) <= set(known)
        elif isinstance(way, Distilled):
            assert all(isinstance(known[name], Setting) for name in (*way.teachers, way.student))
        elif isinstance(way, Coarse):
            assert isinstance(known[way.setting], Setting)
        elif isinstance(way, Setting) and (dataset, way.config) != ("objects", "hybrid-window"):
            config = way.config_of(dataset, 2)
            assert (config.seed, config.validation_fraction, config.refit) == (2, 0.0, False)


Learned = list[list[int]]


@pytest.fixture
def compare(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> Callable[[str], tuple[list[list[str]], Learned]]:
    """Return a function that compares the ways of a YAML text on 24 synthetic recordings.

    It returns the rows of the table, and for each network that was trained the numbers of the recordings that it learned from.
    """
    import try_training
    import ways

    made, learned = synthetic_touches(24, steps=24, classes=3, seed=1), Learned()
    trained = ways.train

    def read(path: Path, *, split: str) -> Recordings:
        assert (path.name, split) == ("Ev-Containers.zip", "train")
        return made

    def noted(recordings: Recordings, *args: Any, **options: Any) -> Any:
        same = (made.spikes[np.newaxis] == recordings.spikes[:, np.newaxis]).all(axis=(2, 3))
        learned.append(np.flatnonzero(same.any(axis=0)).tolist())
        return trained(recordings, *args, **options)

    monkeypatch.setattr(try_training, "read_recordings", read)
    monkeypatch.setattr(ways, "train", noted)

    def run(text: str) -> tuple[list[list[str]], Learned]:
        (tmp_path / "own.yaml").write_text(text)
        line = ["--work", str(tmp_path), "--settings", str(tmp_path / "own.yaml"), "--repeats", "1"]
        try_training.main([*line, "--table", str(tmp_path / "t.csv")])
        rows = [
            row.split(",") for row in (tmp_path / "t.csv").read_text().replace('"', "").splitlines()
        ]
        return rows, learned

    return run


def test_only_the_train_part_is_read_and_scores_are_made_once(
    compare: Any, capsys: pytest.CaptureFixture[str]
) -> None:
    text = "a: {label: one, options: {epochs: 2}}\nb: {label: both, members: {a: 2.0}}\nc: {label: none, members: {d: 1.0}}\n"
    compare(text)
    rows, learned = compare(text)
    # Four networks, one per fold, although the comparison ran twice; each learned from 18 of 24 recordings.
    assert [len(each) for each in learned] == [18] * 4
    assert rows[0] == [
        "training", "parts", "accuracy", "standard error", "three quarters", "half", "quarter",
        "5 % slow", "5 % fast", "10 % slow", "10 % fast",
    ]  # fmt: skip
    assert [row[:2] for row in rows[1:]] == [
        ["Containers", " first division: one"],
        ["Containers", " first division: both"],
    ]
    assert rows[1][2:] == rows[2][2:]
    assert len(rows[1][3:]) == len(rows[0][2:])
    assert capsys.readouterr().out.count("containers a 0: ") == 1


def test_rows_of_other_ways_stay(compare: Any) -> None:
    one, other = (f"{{label: {label}, options: {{epochs: 2}}}}" for label in ("one", "other"))
    before, _ = compare(f"a: {one}\n")
    after, _ = compare(f"b: {other}\n")
    assert after[:2] == before
    assert after[2][1] == " first division: other"


def test_a_setting_begins_with_the_network_of_another_that_learned_from_the_same_folds(
    compare: Any, tmp_path: Path
) -> None:
    # "b" hardly learns, so it must score as "a", with which it begins.
    still = "options: {epochs: 1, learning_rate: 1.0e-9, weight_decay: 0.0}"
    rows, learned = compare(
        f"a: {{label: one, options: {{epochs: 9}}}}\nb: {{label: two, begin: a, {still}}}\n"
    )
    assert rows[1][2:] == rows[2][2:]
    # The four of "a", then, fold by fold, "a" once more as a file and "b" from it.
    assert [len(each) for each in learned] == [18] * 12
    assert learned[4::2] == learned[5::2] == learned[:4]
    first, second = (np.load(tmp_path / f"containers-{name}-0.npy") for name in "ab")
    assert np.allclose(first, second, atol=1e-6)
    assert np.abs(first).max() > 0.1  # or both would be equal because they learned nothing


def test_teachers_know_neither_what_they_score_nor_what_is_held_out(
    tmp_path: Path, compare: Any
) -> None:
    from ways import folds

    text = "a: {label: one, options: {epochs: 2}}\nb: {label: taught, teachers: [a], student: a}\n"
    _, learned = compare(text)
    labels = synthetic_touches(24, steps=24, classes=3, seed=1).labels
    fold = folds(labels, 0)
    # First the four networks of "a", then six teachers, each before the first student that hears it, and four students.
    folds_learned = [sorted(set(fold[rows])) for rows in learned[4:]]
    students = [known for known in folds_learned if len(known) == 3]
    teachers = [known for known in folds_learned if len(known) == 2]
    assert students == [[1, 2, 3], [0, 2, 3], [0, 1, 3], [0, 1, 2]]
    assert sorted(teachers) == [[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]]
    for first, second in teachers:
        scores = np.load(tmp_path / f"containers-a-0-of-{first}-{second}.npy")
        assert np.array_equal(np.isnan(scores).all(axis=1), np.isin(fold, [first, second]))
        assert np.array_equal(np.isnan(scores).any(axis=1), np.isin(fold, [first, second]))


def test_a_student_of_teachers_alone_follows_them(compare: Any, tmp_path: Path) -> None:
    """If only teachers count and they predict the wrong class, the student is wrong: it does not learn from labels."""
    import distilling
    from ways import Distilled, Division, settings_of

    made = synthetic_touches(24, steps=24, classes=3, seed=1)
    (tmp_path / "own.yaml").write_text("a: {label: one, options: {epochs: 40}}\n")
    division = Division(
        "containers", made, 0, tmp_path, tmp_path, settings_of(tmp_path / "own.yaml")
    )
    rows = np.flatnonzero(division.fold != 0)
    wrong = (division.labels + 1) % 3
    for pair in ("1-2", "1-3", "2-3"):
        np.save(tmp_path / f"containers-a-0-of-{pair}.npy", 20.0 * np.eye(3)[wrong])
    predicted = {
        weight: distilling.distilled(Distilled("", ("a",), "a", weight), division, rows)(
            made.spikes[rows]
        ).argmax(axis=1)
        for weight in (0.0, 1.0)
    }
    assert (predicted[0.0] == division.labels[rows]).mean() > 0.9
    assert (predicted[1.0] == wrong[rows]).mean() > 0.9


def test_a_learning_curve_measures_on_the_fold_that_is_held_out(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import learning_curve
    from ways import Setting

    made, known = (
        synthetic_touches(48, steps=24, classes=3, seed=1),
        {"a": Setting("one", {"epochs": 2})},
    )
    monkeypatch.setattr(learning_curve, "read_recordings", lambda path, *, split: made)
    monkeypatch.setattr(learning_curve, "settings_of", lambda path: known)
    monkeypatch.setattr(learning_curve, "RECIPES", {"containers": ("a", 1)})
    learning_curve.main(
        ["--datasets", "containers", "--work", str(tmp_path), "--table", str(tmp_path / "t.csv")]
    )
    rows = [line.split(",") for line in (tmp_path / "t.csv").read_text().splitlines()]
    assert [row[:4] for row in rows[1:]] == [
        ["Containers", "0.25", "9", "4"],
        ["Containers", "0.5", "18", "4"],
        ["Containers", "0.75", "27", "4"],
        ["Containers", "1", "36", "4"],
    ]
    assert all(float(row[5]) <= float(row[4]) <= float(row[6]) for row in rows[1:])


def test_prototypes_of_classes_that_lie_apart() -> None:
    from nearest import metric, prototypes

    rng = np.random.default_rng(0)
    labels = np.repeat(np.arange(3), 10)
    # What varies within classes is larger than what tells them apart.
    wide = rng.normal(size=(30, 1)) * 20.0
    x = np.concatenate([np.eye(3)[labels], wide], axis=1) + 0.05 * rng.normal(size=(30, 4))
    means, apart = prototypes(x, labels)

    def right(smooth: float | None) -> float:
        turned, offset = metric(means, apart, smooth)
        return float(((x @ turned.T - offset).argmax(axis=1) == labels).mean())

    assert right(0.0001) == 1.0
    assert right(None) < 0.9


@pytest.mark.parametrize(
    ("by", "wanted"), [(0, [0, 3, 9]), (2, [2, 5]), (-2, [1, 7])], ids=["still", "later", "earlier"]
)
def test_copies_move_and_lose_what_leaves(by: int, wanted: list[int]) -> None:
    from nearest import moved

    spikes = np.zeros((1, 10, 2), dtype=np.uint8)
    spikes[0, [0, 3, 9], 1] = 1
    assert np.argwhere(moved(spikes, by)[0]).tolist() == [[step, 1] for step in wanted]


def test_the_chip_plays_the_weights_that_were_trained(tmp_path: Path) -> None:
    """The program of a network trained at two bits scores as the network in training; rounded after training, it does not."""
    from coarse import coarse
    from ways import Coarse, Division, Setting

    from locsnn_compile.training.measure import class_scores

    recordings = synthetic_touches(24, steps=24, classes=3, seed=1)
    on_chip = {"target": "loihi-sim", "weight_bits": 2, "weight_room": 0.5}
    known = {
        "a": Setting("one", {"epochs": 20}),
        "on chip": Setting("one", {"epochs": 20} | on_chip),
    }
    division, rows = Division("containers", recordings, 0, tmp_path, tmp_path, known), np.arange(18)
    _, network = known["on chip"].trained(division, rows)
    expected = class_scores(network, recordings.spikes)
    trained, later = (
        coarse(Coarse("", "a", 2, held, 0.5), division, rows)(recordings.spikes)
        for held in (True, False)
    )
    same, other = (np.corrcoef(found.ravel(), expected.ravel())[0, 1] for found in (trained, later))
    assert same > 0.999999
    assert other < 0.9995
