"""Training runs from beginning to end on a few synthetic touches.

They must learn, repeat and resume to equal bits, choose their epoch by validation, and refuse data and states that do
not fit.

A run has two phases. ``select`` trains on a part of the recordings and chooses an epoch by validation on the rest;
``refit`` then trains afresh on all recordings, for as many epochs as were chosen. A *state* is the file from which a
killed run continues.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from locsnn_compile.data.recordings import Recordings
from locsnn_compile.data.synthetic import synthetic_touches
from locsnn_compile.errors import InputError
from locsnn_compile.training.config import TrainingConfig
from locsnn_compile.training.schedule import choose_epoch, learning_rate
from locsnn_compile.training.state import EpochRecord
from locsnn_compile.training.train import TrainingResult, train

SELECT_EPOCHS = 4
CONFIG = TrainingConfig(
    hidden=8, epochs=SELECT_EPOCHS, batch_size=4, validation_fraction=0.25, learning_rate=0.01
)
CHANNELS = 78  # of a fingertip: 39 taxels with two polarities
LEARNED = 0.9
"""The least validation accuracy that counts as learned: chance is 1/3 for three classes. Chosen by hand."""


def touches(samples: int = 12) -> Recordings:
    """Synthetic recordings of three classes."""
    return synthetic_touches(samples, steps=60, classes=3, seed=1)


class KilledError(Exception):
    """Is raised to end a run early, as if it had been killed."""


def are_equal(first: TrainingResult, second: TrainingResult) -> bool:
    """Whether two runs have the same history and weights, bit by bit."""
    first_weights = first.network.weights()
    second_weights = second.network.weights()
    return first.history == second.history and all(
        np.array_equal(first_weights[name], second_weights[name]) for name in first_weights
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    "values",
    [
        pytest.param({}, id="hybrid, cross-entropy"),
        pytest.param(
            {"model": "tactile-snn", "optimizer": "rmsprop", "weight_decay": 0.0},
            id="time, rmsprop",
        ),
        pytest.param({"model": "location-tactile-snn", "order": "whorl"}, id="location"),
        pytest.param(
            {
                "loss": "spike-count",
                "target_right": 20.0,
                "target_wrong": 1.0,
                "location_weight": 0.5,
            },
            id="hybrid, spike counts",
        ),
    ],
)
def test_training_learns_to_tell_the_classes_apart(values: dict[str, object]) -> None:
    config = replace(CONFIG, epochs=30, event_dropout=0.2, **values)  # type: ignore[arg-type]
    result = train(touches(24), config)
    losses = [row.loss for row in result.history if row.phase == "select"]
    assert losses[-1] < losses[0]
    assert result.validation_accuracy is not None
    assert result.validation_accuracy >= LEARNED


def test_equal_seeds_give_equal_runs_and_different_seeds_do_not() -> None:
    first, again, other = (train(touches(), replace(CONFIG, seed=seed)) for seed in (0, 0, 1))
    assert are_equal(first, again)
    assert not are_equal(first, other)


def other_names(weights: dict[str, torch.Tensor]) -> dict[str, torch.Tensor]:
    """Return the weights under other names."""
    return {f"old_{name}": values for name, values in weights.items()}


def another_shape(weights: dict[str, torch.Tensor]) -> dict[str, torch.Tensor]:
    """Return the weights, of which one has another shape."""
    return weights | {"time_output.weight": torch.zeros(3, 9)}


NAMES = "an earlier version wrote it, with other names of weights. "
SHAPE = "weights 'time_output.weight' have another shape ((3, 9) against (3, 8)). "


@pytest.mark.parametrize("part", ["weights", "chosen_weights", "averages"])
@pytest.mark.parametrize(
    ("change", "what"), [(other_names, NAMES), (another_shape, SHAPE)], ids=["names", "shape"]
)
def test_a_state_with_other_weights_is_refused(
    tmp_path: Path,
    part: str,
    change: Callable[[dict[str, torch.Tensor]], dict[str, torch.Tensor]],
    what: str,
) -> None:
    state = tmp_path / "run.state"
    # Only a run that averages its weights has averages in its state.
    config = replace(CONFIG, weight_average=0.5)
    train(touches(), config, state_path=state)
    values = torch.load(state, weights_only=True)
    # As if the run had been killed in its first phase: it still has to continue from these weights.
    unfinished = values | {"phase": "select"}
    torch.save(unfinished | {part: change(values[part])}, state)
    with pytest.raises(InputError) as caught:
        train(touches(), config, state_path=state)
    assert (
        str(caught.value)
        == f"training state 'run.state': {what}Delete it, or train without --resume."
    )


@pytest.mark.parametrize("stop", [1, 3, 4, 5, 7])
def test_a_killed_run_continues_to_the_same_bits(tmp_path: Path, stop: int) -> None:
    """The last state has ``stop`` epochs: within the four of the first phase, at its end, or within the refit."""
    uninterrupted = train(touches(), CONFIG)
    # With fewer epochs to refit, the largest ``stop`` would come after the end of the run.
    assert uninterrupted.chosen_epoch == 4
    state = tmp_path / "run.state"

    def killer(done: int, expected: int, record: EpochRecord) -> None:
        # An epoch is reported before its state is saved, so the state that stays is of ``stop`` epochs.
        if done == stop + 1:
            raise KilledError

    with pytest.raises(KilledError):
        train(touches(), CONFIG, state_path=state, save_every=1, progress=killer)
    epochs_done: list[int] = []
    resumed = train(
        touches(),
        CONFIG,
        state_path=state,
        progress=lambda done, expected, record: epochs_done.append(done),
    )
    assert epochs_done[0] == stop + 1
    assert are_equal(uninterrupted, resumed)
    # The state of a finished run has nothing left to do.
    assert are_equal(uninterrupted, train(touches(), CONFIG, state_path=state))


@pytest.mark.parametrize(
    ("config", "message"),
    [
        pytest.param(
            replace(CONFIG, epochs=SELECT_EPOCHS + 1),
            "it belongs to a run with other options or other data. Delete it, or train without --resume.",
            id="other options",
        ),
        pytest.param(CONFIG, "it is damaged. Delete it, or train without --resume.", id="damaged"),
    ],
)
def test_a_state_of_another_run_or_damaged_is_refused(
    tmp_path: Path, config: TrainingConfig, message: str
) -> None:
    state = tmp_path / "run.state"
    train(touches(), CONFIG, state_path=state)
    if "damaged" in message:
        state.write_bytes(state.read_bytes()[:500])
    with pytest.raises(InputError) as caught:
        train(touches(), config, state_path=state)
    assert str(caught.value) == f"training state 'run.state': {message}"


def test_the_log_has_a_line_for_every_epoch(tmp_path: Path) -> None:
    result = train(touches(), CONFIG, log_path=tmp_path / "log.csv")
    lines = (tmp_path / "log.csv").read_text().splitlines()
    assert lines[0] == "phase,epoch,learning_rate,loss,validation_loss,validation_accuracy"
    assert [line.split(",")[:2] for line in lines[1:]] == [
        [row.phase, str(row.epoch)] for row in result.history
    ]
    phases = ["select"] * SELECT_EPOCHS + ["refit"] * result.chosen_epoch
    assert [row.phase for row in result.history] == phases


def test_the_learning_rate_of_a_refit_falls_over_its_own_epochs() -> None:
    result = train(touches(), replace(CONFIG, epochs=3))
    refit = [row.learning_rate for row in result.history if row.phase == "refit"]
    assert refit == [
        learning_rate(CONFIG, epoch, result.chosen_epoch)
        for epoch in range(1, result.chosen_epoch + 1)
    ]


def test_without_refit_the_run_ends_after_the_choice_of_the_epoch() -> None:
    result = train(touches(), replace(CONFIG, refit=False))
    assert {row.phase for row in result.history} == {"select"}
    # A quarter of twelve recordings validate.
    chosen = choose_epoch(list(result.history), CONFIG.smoothing_epochs, validated=3)
    assert result.chosen_epoch == chosen


def test_without_validation_the_last_epoch_is_chosen() -> None:
    result = train(touches(), replace(CONFIG, validation_fraction=0.0))
    assert result.chosen_epoch == SELECT_EPOCHS
    assert result.validation_accuracy is None
    assert {row.phase for row in result.history} == {"select"}


@pytest.mark.parametrize(
    ("accuracy", "smoothing", "chosen"),
    [
        pytest.param([0.5, 0.9, 0.5], 1, 2, id="the best"),
        pytest.param([0.5, 0.9, 0.9], 1, 3, id="the later of equals"),
        # One standard error of the best of ten recordings is sqrt(0.9 * 0.1 / 10) = 0.0949.
        pytest.param([0.5, 0.9, 0.81], 1, 3, id="later within one standard error"),
        pytest.param([0.5, 0.9, 0.8], 1, 2, id="not beyond one standard error"),
        pytest.param([0.0, 1.0, 0.0, 0.7, 0.7], 2, 5, id="averages outdo a lucky epoch"),
    ],
)
def test_the_latest_epoch_within_one_standard_error_of_the_best_is_chosen(
    accuracy: list[float], smoothing: int, chosen: int
) -> None:
    def record(phase: str, epoch: int, validation_accuracy: float | None) -> EpochRecord:
        return EpochRecord(
            phase=phase,
            epoch=epoch,
            learning_rate=0.1,
            loss=1.0,
            validation_loss=None,
            validation_accuracy=validation_accuracy,
        )

    history = [record("select", epoch, value) for epoch, value in enumerate(accuracy, start=1)]
    history.append(record("refit", epoch=1, validation_accuracy=None))
    assert choose_epoch(history, smoothing, validated=10) == chosen


def test_the_learning_rate_falls_by_half_a_cosine_or_is_constant() -> None:
    # Before epoch 3, half of the four epochs are done, and half a cosine has fallen to a half.
    cosine = [learning_rate(CONFIG, epoch, 4) for epoch in (1, 3)]
    assert cosine == pytest.approx([0.01, 0.005])
    assert learning_rate(replace(CONFIG, schedule="constant"), epoch=3, epochs=4) == 0.01


@pytest.mark.skipif(not torch.set_flush_denormal(False), reason="this processor has no such mode")
def test_a_run_takes_the_smallest_floats_as_zero_and_leaves_torch_as_it_was() -> None:
    # Below 1.2e-38, the smallest normal float32.
    denormal = torch.full((16,), 1e-40)
    threads_before = torch.get_num_threads()
    sums_during_run = set()
    threads_during_run = set()

    def note_mode(*_: object) -> None:
        # Denormal numbers become 0 when something is computed from them.
        sums_during_run.add(float((denormal * 1.0).sum()))
        threads_during_run.add(torch.get_num_threads())

    train(touches(), CONFIG, progress=note_mode)
    assert sums_during_run == {0.0}
    # One thread: for layers as small as these, more only wait for each other.
    assert threads_during_run == {1}
    assert float((denormal * 1.0).sum()) > 0.0
    assert torch.get_num_threads() == threads_before


def silent_recordings(*, channels: int = CHANNELS, label: int | None = 0) -> Recordings:
    """Return one recording of five steps without events, with a label or without."""
    labels = None if label is None else np.array([label])
    spikes = np.zeros((1, 5, channels))
    return Recordings(spikes, labels, step_seconds=None, source="x.npy")


@pytest.mark.parametrize(
    ("recordings", "values", "message"),
    [
        pytest.param(
            silent_recordings(label=None),
            {},
            "recordings 'x.npy': they have no labels to train on. Give labelled recordings.",
            id="no labels",
        ),
        pytest.param(
            silent_recordings(channels=80),
            {},
            "recordings 'x.npy': their channels are not those of sensor 'neutouch' (80 against 78). Say which sensor it "
            "was: --grid WxH, with --polarities 1 or 2, --channels N, or --layout FILE.",
            id="other sensor",
        ),
        pytest.param(
            silent_recordings(),
            {"order": "radial"},
            "location order: 'radial' is not known. "
            "Choose one of: arch, hilbert, loop, raster, reverse, snake, spiral, tour, whorl.",
            id="unknown order",
        ),
        pytest.param(
            silent_recordings(label=9999),
            {},
            "classes: it must be a whole number from 1 to 4096 (got 10000). Correct it.",
            id="absurd label",
        ),
    ],
)
def test_recordings_and_options_that_cannot_be_used_are_refused(
    recordings: Recordings, values: dict[str, str], message: str
) -> None:
    with pytest.raises(InputError) as caught:
        train(recordings, replace(CONFIG, **values))  # type: ignore[arg-type]
    assert str(caught.value) == message


def test_a_log_that_cannot_be_written_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError) as caught:
        train(touches(), CONFIG, log_path=tmp_path / "none" / "log.csv")
    assert str(caught.value) == (
        "training log 'log.csv': its folder does not exist. Make the folder first."
    )
