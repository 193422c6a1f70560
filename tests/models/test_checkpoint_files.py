"""Checkpoints: what is written comes back, and only what fits is written."""

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


def test_what_is_written_comes_back(tmp_path: Path) -> None:
    found = read_checkpoint(save(tmp_path / "small.pt"))
    weights = build_network(DESCRIPTION, seed=1).weights()
    assert found.description == DESCRIPTION
    assert list(found.weights) == [
        "time_hidden",
        "time_output",
        "location_hidden",
        "location_output",
    ]
    assert all(np.array_equal(found.weights[name], weights[name]) for name in weights)
    assert found.training == {"seed": 1, "dataset": "none"}
    assert found.recordings is not None
    assert np.array_equal(found.recordings.spikes, recordings().spikes)
    assert found.recordings.labels is not None
    assert found.recordings.labels.tolist() == [0, 1]
    assert (found.recordings.step_seconds, found.recordings.source) == (0.02, "small.pt")


def test_a_step_that_nobody_said_comes_back_as_not_known(tmp_path: Path) -> None:
    description = replace(DESCRIPTION, input=replace(DESCRIPTION.input, step_seconds=None))
    weights = build_network(description).weights()
    Checkpoint(description, weights, recordings=recordings()).save(tmp_path / "w.pt")
    found = read_checkpoint(tmp_path / "w.pt")
    assert found.recordings is not None
    assert (found.description.input.step_seconds, found.recordings.step_seconds) == (None, None)


@pytest.mark.parametrize(
    ("training", "origin"),
    [
        pytest.param({"test_recordings": 144}, "carried", id="of the test part"),
        pytest.param({"test_recordings": None}, "trained on", id="there was no test part"),
        pytest.param({}, "carried", id="nobody says"),
    ],
)
def test_recordings_say_whether_the_network_was_trained_on_them(
    tmp_path: Path, training: dict[str, int | None], origin: str
) -> None:
    weights = build_network(DESCRIPTION).weights()
    Checkpoint(DESCRIPTION, weights, recordings=recordings(), training=training).save(
        tmp_path / "w.pt"
    )
    found = read_checkpoint(tmp_path / "w.pt").recordings
    assert found is not None
    assert (found.origin, found.subset([1]).origin) == (origin, origin)


def test_arrays_are_read_only(tmp_path: Path) -> None:
    found = read_checkpoint(save(tmp_path / "small.pt"))
    assert not any(weights.flags.writeable for weights in found.weights.values())


def test_weights_alone(tmp_path: Path) -> None:
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


def test_saving_into_no_folder(tmp_path: Path) -> None:
    with pytest.raises(InputError) as caught:
        Checkpoint(DESCRIPTION, build_network(DESCRIPTION).weights()).save(
            tmp_path / "none" / "x.pt"
        )
    assert str(caught.value) == (
        "checkpoint 'x.pt': its folder does not exist. Make the folder first."
    )
