"""``lc.train``: the same checkpoint as from the command, as an object."""

from __future__ import annotations

import logging
from pathlib import Path

import numpy as np
import pytest

import locsnn_compile as lc
from locsnn_compile.cli.main import main
from locsnn_compile.data.synthetic import synthetic_touches
from locsnn_compile.data.write import write_recordings

QUICK = {"epochs": 1, "hidden": 4, "defaults": "fixed"}
DATA = synthetic_touches(9, steps=40, classes=3, seed=1)


@pytest.fixture(scope="module")
def checkpoint() -> lc.Checkpoint:
    return lc.train(DATA, QUICK, name="small")


def test_it_is_what_the_command_writes(checkpoint: lc.Checkpoint, tmp_path: Path) -> None:
    write_recordings(tmp_path / "touches.npz", DATA)
    asked = [
        "--epochs",
        "1",
        "--hidden",
        "4",
        "--defaults",
        "fixed",
        "--quiet",
        "-o",
        str(tmp_path / "small.pt"),
    ]
    assert main(["train", "--data", str(tmp_path / "touches.npz"), *asked]) == 3
    again = lc.train(tmp_path / "touches.npz", QUICK, name="small")
    again.save(tmp_path / "again.pt")
    assert (tmp_path / "again.pt").read_bytes() == (tmp_path / "small.pt").read_bytes()
    for name, weights in checkpoint.weights.items():
        assert np.array_equal(weights, again.weights[name])


def test_it_is_saved_loaded_and_compiled(checkpoint: lc.Checkpoint, tmp_path: Path) -> None:
    checkpoint.save(tmp_path / "small.pt")
    network = lc.load(tmp_path / "small.pt")
    assert network.sha256 == lc.load(checkpoint).sha256 == checkpoint.sha256
    files = [
        lc.compile(one, diagnosis=False).files()
        for one in (network, checkpoint, lc.load(checkpoint))
    ]
    assert files[0]["program.npz"] == files[1]["program.npz"] == files[2]["program.npz"]


def test_arrays_with_labels(checkpoint: lc.Checkpoint) -> None:
    assert DATA.labels is not None
    config = lc.TrainingConfig(**QUICK, step_seconds=DATA.step_seconds)
    found = lc.train(DATA.spikes, config, labels=DATA.labels.tolist(), carried=2)
    for name, weights in checkpoint.weights.items():
        assert np.array_equal(weights, found.weights[name])
    assert found.recordings is not None
    assert len(found.recordings) == 2


def test_a_test_part_is_measured_and_epochs_are_told() -> None:
    told: list[int] = []
    found = lc.train(
        DATA,
        QUICK | {"refit": False},
        test=DATA.subset([0, 1, 2]),
        progress=lambda done, *_: told.append(done),
    )
    assert (found.training["test_recordings"], told) == (3, [1])


def test_recordings_in_memory_get_the_steps_asked_for() -> None:
    found = lc.train(DATA, QUICK | {"steps": 25}, test=DATA.subset([0, 1]))
    assert found.description.input.steps == 25
    assert found.recordings is not None
    assert np.array_equal(found.recordings.spikes, DATA.spikes[: len(found.recordings), :25])
    assert found.training["test_recordings"] == 2


def test_a_run_that_learned_nothing_says_so(caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.WARNING, logger="locsnn"):
        lc.train(DATA, QUICK)
    said = "No output neuron spikes in any of the 9 recordings it was trained on: every prediction is a tie. Give --learning-rate 0.1."
    assert caplog.messages == [said]


def test_a_line_says_what_it_is(checkpoint: lc.Checkpoint) -> None:
    assert len(repr(checkpoint)) <= 450
    assert repr(checkpoint).startswith(
        "Checkpoint(description=<NetworkDescription 'small'>, weights=<4 entries>, "
    )


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: lc.train(DATA, {"epoch": 3}), "training options: unknown key 'epoch'. Did you mean 'epochs'?"),
        (lambda: lc.train(DATA.spikes), "recordings 'array': they have no labels to train on. Give labelled recordings."),
        (lambda: lc.train(DATA, 3), "train, config: it must be a TrainingConfig, Mapping, str or Path (got int 3). Correct it."),
        (lambda: lc.train(DATA, "no.yaml"), "config 'no.yaml': it cannot be read (No such file or directory). Check the path."),
        (lambda: lc.load(lc.train(DATA, QUICK), dt=1e-3), "model 'model': dt was given, but a checkpoint contains this itself. Leave dt out."),
        (lambda: lc.train(DATA, {"split": 0.2}), "training option 'split': recordings 'synthetic touches' are in memory, as they are (got 0.2). Leave it out, or give a file."),
        (lambda: lc.train(DATA, {"axes": "samples,steps,channels"}), "training option 'axes': recordings 'synthetic touches' are in memory, as they are (got samples,steps,channels). Leave it out, or give a file."),
        (lambda: lc.train(DATA, {"event_threshold": 2}), "training option 'event_threshold': recordings 'synthetic touches' are in memory, as they are (got 2). Leave it out, or give a file."),
        (lambda: lc.train(DATA, {"merge_polarities": True}), "training option 'merge_polarities': recordings 'synthetic touches' are in memory, as they are (got True). Leave it out, or give a file."),
        (lambda: lc.train(DATA, {"only_polarity": 0}), "training option 'only_polarity': recordings 'synthetic touches' are in memory, as they are (got 0). Leave it out, or give a file."),
        (lambda: lc.train(DATA, {"step_seconds": 0.5}), "training option 'step_seconds': the recordings have another (got 0.5 against 0.02). Leave it out, or give a file."),
    ],
    ids=["an unknown option", "no labels", "a number", "no file", "an option of another format", "a part", "axes", "a threshold", "merged polarities", "one polarity", "another width"],
)  # fmt: skip
def test_what_is_refused(call, message) -> None:  # type: ignore[no-untyped-def]
    with pytest.raises(lc.InputError) as found:
        call()
    assert str(found.value) == message
