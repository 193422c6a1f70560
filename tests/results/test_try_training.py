"""The comparison of ways of training: folds that share nothing, settings that load, scores that are made once."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from locsnn_compile.data.recordings import Recordings
from locsnn_compile.data.synthetic import synthetic_touches

HERE = Path(__file__).parent


@pytest.fixture(autouse=True)
def own_folder(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(HERE))


@pytest.mark.parametrize("per_class", [12, 13])
def test_every_recording_is_held_out_once_and_classes_are_spread(per_class: int) -> None:
    from try_training import FOLDS, folds

    labels = np.repeat(np.arange(5), per_class)
    found = folds(labels, 3)
    counts = np.array([np.bincount(found[labels == label], minlength=FOLDS) for label in range(5)])
    assert counts.sum() == len(labels)
    assert counts.min() == 3
    assert counts.max() <= 4
    assert not np.array_equal(found, folds(labels, 4))
    assert np.array_equal(found, folds(labels, 3))


@pytest.mark.parametrize("dataset", ["containers", "objects"])
def test_settings_are_ones_that_train(dataset: str) -> None:
    from try_training import Committee, config_of, settings_of

    known = settings_of(HERE / "tried_settings.yaml")
    for setting in known.values():
        if isinstance(setting, Committee):
            assert set(setting.members) <= set(known)
        elif (dataset, setting.config) != ("objects", "hybrid-window"):
            config = config_of(setting, dataset, 2)
            assert (config.seed, config.validation_fraction, config.refit) == (2, 0.0, False)


def test_only_the_train_part_is_read_and_scores_are_made_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    import try_training

    made, asked, runs = synthetic_touches(24, steps=24, classes=3, seed=1), [], []

    def read(path: Path, *, split: str) -> Recordings:
        asked.append((path.name, split))
        return made

    def counted(recordings: Recordings, *args: Any, **options: Any) -> Any:
        runs.append(len(recordings))
        return trained(recordings, *args, **options)

    trained = try_training.train
    monkeypatch.setattr(try_training, "read_recordings", read)
    monkeypatch.setattr(try_training, "train", counted)
    (tmp_path / "own.yaml").write_text(
        "a: {label: one, options: {epochs: 2}}\nb: {label: both, members: {a: 2.0}}\nc: {label: none, members: {d: 1.0}}\n"
    )
    line = ["--work", str(tmp_path), "--settings", str(tmp_path / "own.yaml"), "--repeats", "1"]
    for _ in range(2):
        try_training.main([*line, "--table", str(tmp_path / "t.csv")])
    assert asked == [("Ev-Containers.zip", "train")] * 2
    assert runs == [18] * 4
    rows = (tmp_path / "t.csv").read_text().splitlines()
    assert rows[0] == "training,parts,accuracy,standard error,three quarters,half,quarter"
    assert [row.split(",")[0] for row in rows[1:]] == ["one", "both"]
    assert rows[1].split(",")[1:] == rows[2].split(",")[1:]
    assert capsys.readouterr().out.count("containers a 0: ") == 1
