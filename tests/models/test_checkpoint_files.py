"""Checkpoints of small networks: what is written is read back equal, and weights that do not fit are not written."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from locsnn_compile.errors import InputError
from locsnn_compile.models.checkpoint import Checkpoint
from locsnn_compile.models.checkpoint_reader import read_checkpoint
from locsnn_compile.models.networks import build_network
from tests.support.small_checkpoint import DESCRIPTION, recordings, save


def test_a_checkpoint_is_read_back_equal(tmp_path: Path) -> None:
    checkpoint = read_checkpoint(save(tmp_path / "small.pt"))
    weights = build_network(DESCRIPTION, seed=1).weights()
    assert checkpoint.description == DESCRIPTION
    # In evaluation order.
    assert list(checkpoint.weights) == [
        "time_hidden",
        "time_output",
        "location_hidden",
        "location_output",
    ]
    assert all(np.array_equal(checkpoint.weights[name], weights[name]) for name in weights)
    assert checkpoint.training == {"seed": 1, "dataset": "none"}
    assert checkpoint.recordings is not None
    assert np.array_equal(checkpoint.recordings.spikes, recordings().spikes)
    assert checkpoint.recordings.labels is not None
    assert checkpoint.recordings.labels.tolist() == [0, 1]
    assert (checkpoint.recordings.step_seconds, checkpoint.recordings.source) == (0.02, "small.pt")


def test_an_unknown_width_of_steps_stays_unknown(tmp_path: Path) -> None:
    description = replace(DESCRIPTION, input=replace(DESCRIPTION.input, step_seconds=None))
    weights = build_network(description).weights()
    Checkpoint(description, weights, recordings=recordings()).save(tmp_path / "w.pt")
    checkpoint = read_checkpoint(tmp_path / "w.pt")
    assert checkpoint.recordings is not None
    assert (checkpoint.description.input.step_seconds, checkpoint.recordings.step_seconds) == (
        None,
        None,
    )


@pytest.mark.parametrize(
    ("training", "origin"),
    [
        pytest.param({"test_recordings": 144}, "carried", id="of the test part"),
        pytest.param({"test_recordings": None}, "trained on", id="there was no test part"),
        pytest.param({}, "carried", id="not stated"),
    ],
)
def test_recordings_say_whether_the_network_was_trained_on_them(
    tmp_path: Path, training: dict[str, int | None], origin: str
) -> None:
    weights = build_network(DESCRIPTION).weights()
    Checkpoint(DESCRIPTION, weights, recordings=recordings(), training=training).save(
        tmp_path / "w.pt"
    )
    carried = read_checkpoint(tmp_path / "w.pt").recordings
    assert carried is not None
    assert (carried.origin, carried.subset([1]).origin) == (origin, origin)


def test_weights_are_read_only(tmp_path: Path) -> None:
    checkpoint = read_checkpoint(save(tmp_path / "small.pt"))
    assert not any(weights.flags.writeable for weights in checkpoint.weights.values())


def test_a_checkpoint_may_carry_no_recordings(tmp_path: Path) -> None:
    Checkpoint(DESCRIPTION, build_network(DESCRIPTION).weights()).save(tmp_path / "w.pt")
    assert read_checkpoint(tmp_path / "w.pt").recordings is None


def test_equal_networks_give_equal_bytes(tmp_path: Path) -> None:
    first, second = save(tmp_path / "a.pt"), save(tmp_path / "b.pt")
    assert first.read_bytes() == second.read_bytes()
    assert sorted(file.name for file in tmp_path.iterdir()) == ["a.pt", "b.pt"]


def test_saving_refuses_weights_that_do_not_fit(tmp_path: Path) -> None:
    weights = build_network(DESCRIPTION).weights()
    del weights["time_output"]
    with pytest.raises(InputError) as caught:
        Checkpoint(DESCRIPTION, weights).save(tmp_path / "x.pt")
    assert str(caught.value) == (
        "population 'time_output': its weights do not fit the network (none against (3, 4)). "
        "Save the weights of a network of this description."
    )
    assert list(tmp_path.iterdir()) == []


def test_saving_into_a_folder_that_does_not_exist_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError) as caught:
        Checkpoint(DESCRIPTION, build_network(DESCRIPTION).weights()).save(
            tmp_path / "none" / "x.pt"
        )
    assert str(caught.value) == (
        "checkpoint 'x.pt': its folder does not exist. Make the folder first."
    )
