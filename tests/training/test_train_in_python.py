"""The Python function ``lc.train``: its checkpoint equals that of the command, and what it takes and refuses."""

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
    """The result of a quick run on recordings in memory."""
    return lc.train(DATA, QUICK, name="small")


def test_the_checkpoint_equals_that_of_the_command(
    checkpoint: lc.Checkpoint, tmp_path: Path
) -> None:
    data = tmp_path / "touches.npz"
    write_recordings(data, DATA)
    options = ["--epochs", "1", "--hidden", "4", "--defaults", "fixed", "--quiet"]
    by_command = tmp_path / "small.pt"
    # A single epoch teaches nothing here, which exits with 3.
    assert main(["train", "--data", str(data), *options, "-o", str(by_command)]) == 3
    from_file = lc.train(data, QUICK, name="small")
    from_file.save(tmp_path / "from-file.pt")
    assert (tmp_path / "from-file.pt").read_bytes() == by_command.read_bytes()
    for name, weights in checkpoint.weights.items():
        assert np.array_equal(weights, from_file.weights[name])


def test_the_checkpoint_is_saved_loaded_and_compiled(
    checkpoint: lc.Checkpoint, tmp_path: Path
) -> None:
    checkpoint.save(tmp_path / "small.pt")
    network = lc.load(tmp_path / "small.pt")
    assert network.sha256 == lc.load(checkpoint).sha256 == checkpoint.sha256
    first, *further = (
        lc.compile(model, diagnosis=False).files()["program.npz"]
        for model in (network, checkpoint, lc.load(checkpoint))
    )
    assert further == [first, first]


def test_arrays_with_labels_train_the_same_network(checkpoint: lc.Checkpoint) -> None:
    assert DATA.labels is not None
    config = lc.TrainingConfig(**QUICK, step_seconds=DATA.step_seconds)
    from_arrays = lc.train(DATA.spikes, config, labels=DATA.labels.tolist(), carried=2)
    for name, weights in checkpoint.weights.items():
        assert np.array_equal(weights, from_arrays.weights[name])
    assert from_arrays.recordings is not None
    assert len(from_arrays.recordings) == 2


def test_a_test_part_is_measured_and_progress_is_called_after_every_epoch() -> None:
    epochs_done: list[int] = []
    result = lc.train(
        DATA,
        QUICK | {"refit": False},
        test=DATA.subset([0, 1, 2]),
        progress=lambda done, *_: epochs_done.append(done),
    )
    assert (result.training["test_recordings"], epochs_done) == (3, [1])


def test_recordings_in_memory_are_cut_to_the_option_steps() -> None:
    result = lc.train(DATA, QUICK | {"steps": 25}, test=DATA.subset([0, 1]))
    assert result.description.input.steps == 25
    assert result.recordings is not None
    assert np.array_equal(result.recordings.spikes, DATA.spikes[: len(result.recordings), :25])
    assert result.training["test_recordings"] == 2


def test_a_run_that_learned_nothing_logs_a_warning(caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.WARNING, logger="locsnn"):
        lc.train(DATA, QUICK)
    remark = "No output neuron spikes in any of the 9 recordings it was trained on: every prediction is a tie. Give --learning-rate 0.1."
    assert caplog.messages == [remark]


def test_the_representation_of_a_checkpoint_is_one_line(checkpoint: lc.Checkpoint) -> None:
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
def test_arguments_that_cannot_be_used_are_refused(call, message) -> None:  # type: ignore[no-untyped-def]
    with pytest.raises(lc.InputError) as caught:
        call()
    assert str(caught.value) == message
