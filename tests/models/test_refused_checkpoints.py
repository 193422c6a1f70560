"""Files that are not checkpoints, and checkpoints with a fault, are refused in one line, and no code in them runs."""

from __future__ import annotations

import contextlib
import os
import pickle
import warnings
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from locsnn_compile.data.sensor import LOCATION_ORDERS
from locsnn_compile.errors import InputError
from locsnn_compile.models.checkpoint_reader import read_checkpoint
from locsnn_compile.models.networks import build_network
from tests.support.small_checkpoint import AGAIN, DESCRIPTION, save


class Hostile:
    """Unpickling this would run a command."""

    def __reduce__(self) -> tuple[Callable[..., Any], tuple[str]]:
        return os.system, ("touch ran",)


def edit(change: Callable[[dict[str, Any]], object]) -> Callable[[Path], None]:
    """Return a function that saves a good checkpoint, changed by ``change``, at a path."""

    def make(path: Path) -> None:
        values = torch.load(save(path), weights_only=True)
        change(values)
        torch.save(values, path)

    return make


def put(*keys: str, value: Any) -> Callable[[Path], None]:
    """Return a function that saves a checkpoint with one entry set; ``keys`` lead to it from outside to inside."""

    def change(values: dict[str, Any]) -> None:
        for key in keys[:-1]:
            values = values[key]
        values[keys[-1]] = value

    return edit(change)


def drop(*keys: str) -> Callable[[Path], None]:
    """Return a function that saves a checkpoint without one entry."""

    def change(values: dict[str, Any]) -> None:
        for key in keys[:-1]:
            values = values[key]
        del values[keys[-1]]

    return edit(change)


def swap_sizes(sensor: object) -> Callable[[Path], None]:
    """Return a function that saves a checkpoint with a sensor in place of NeuTouch's sizes."""

    def change(values: dict[str, Any]) -> None:
        values["input"] = {"steps": 9, "step_seconds": 0.02, "sensor": sensor}

    return edit(change)


def bad_weight(value: float) -> Callable[[Path], None]:
    """Return a function that saves a checkpoint with this value among its weights."""

    def change(values: dict[str, Any]) -> None:
        values["weights"]["location_hidden"][2, 5] = value

    return edit(change)


def truncate(path: Path) -> None:
    """Save a checkpoint without its end."""
    path.write_bytes(save(path).read_bytes()[:-900])


def flip(path: Path) -> None:
    """Save a checkpoint with one bit of a weight flipped: only the checksum of the archive shows it."""
    data = bytearray(save(path).read_bytes())
    weights = build_network(DESCRIPTION, seed=1).weights()["time_output"].tobytes()
    last_byte_of_second_weight = data.rindex(weights) + 7
    data[last_byte_of_second_weight] ^= 1
    path.write_bytes(data)


TAXELS = list(LOCATION_ORDERS["loop"])
# Each row: an id, the function that makes the file at a path, and the message behind the name of the file.
BAD: list[tuple[str, Callable[[Path], object], str]] = [
    (
        "missing",
        lambda path: None,
        "it cannot be read (No such file or directory). Check the path.",
    ),
    ("a folder", Path.mkdir, "it cannot be read (Is a directory). Check the path."),
    ("empty", Path.touch, f"it is damaged, truncated or not a torch file. {AGAIN}"),
    ("truncated", truncate, f"it is damaged, truncated or not a torch file. {AGAIN}"),
    ("overwritten inside", flip, f"it is damaged, truncated or not a torch file. {AGAIN}"),
    (
        "text",
        lambda path: path.write_text("hello"),
        f"it is damaged, truncated or not a torch file. {AGAIN}",
    ),
    (
        "plain pickle",
        lambda path: path.write_bytes(pickle.dumps({"format": "locsnn-checkpoint"})),
        "it is a pickle that torch.save did not write, and nothing in it was run. Save tensors with torch.save.",
    ),
    (
        "hostile pickle",
        lambda path: torch.save({"format": "locsnn-checkpoint", "name": Hostile()}, path),
        "it contains objects that would run code when read, so it was not read (posix.system). "
        "Save tensors and plain values only.",
    ),
    (
        "whole module",
        lambda path: torch.save(torch.nn.Linear(2, 2), path),
        "it contains objects that would run code when read, so it was not read (torch.nn.modules.linear.Linear). "
        "Save tensors and plain values only.",
    ),
    (
        "a tensor",
        lambda path: torch.save(torch.zeros(2), path),
        f"it is not a checkpoint of this project (a Tensor). {AGAIN}",
    ),
    (
        "a state dict",
        lambda path: torch.save({"fc1.weight": torch.zeros(2)}, path),
        f"it contains tensors, but does not name their network. {AGAIN}",
    ),
    (
        "a dict of nothing",
        lambda path: torch.save({}, path),
        f"it is not a checkpoint of this project (a dict without a format). {AGAIN}",
    ),
    (
        "other format",
        put("format", value="other"),
        f"it is not a checkpoint of this project (format 'other'). {AGAIN}",
    ),
    (
        "a committee",
        put("format", value="locsnn-committee"),
        "it is a committee, not a single network. Give the networks that it was made of.",
    ),
    (
        "newer version",
        put("version", value=4),
        "it was written by a newer version (version 4 against 3). Update locsnn-compile.",
    ),
    (
        "version that is a list",
        put("version", value=[]),
        f"version: it must be a whole number (got list). {AGAIN}",
    ),
    (
        "version of 0",
        put("version", value=0),
        f"its version does not exist (version 0 against 3). {AGAIN}",
    ),
    (
        "version of text",
        put("version", value="1"),
        f"version: it must be a whole number (got '1'). {AGAIN}",
    ),
    (
        "weights of text",
        put("weights", "time_hidden", value="none"),
        f"weights.time_hidden: it must be a tensor (got 'none'). {AGAIN}",
    ),
    (
        "taxels of text",
        put("location_order", "taxels", value="loop"),
        f"location_order.taxels: it must be a list (got 'loop'). {AGAIN}",
    ),
    ("missing entry", drop("hidden"), f"the key 'hidden' is missing. {AGAIN}"),
    (
        "missing neuron entry",
        drop("neuron", "theta"),
        f"neuron: the key 'theta' is missing. {AGAIN}",
    ),
    ("unknown entry", put("hiden", value=3), "unknown key 'hiden'. Did you mean 'hidden'?"),
    (
        "wrong type",
        put("neuron", "tau_sr", value="10"),
        f"neuron.tau_sr: it must be a number above 0 (got '10'). {AGAIN}",
    ),
    (
        "a sensor and sizes of another",
        put("input", "sensor", value={"name": "x", "taxels": 39, "polarities": 2}),
        "input: unknown key 'fingertips'. Choose one of: sensor, step_seconds, steps.",
    ),
    (
        "a sensor of text",
        swap_sizes("glove"),
        f"input.sensor: it must be a mapping of names (got 'glove'). {AGAIN}",
    ),
    (
        "truth value",
        put("classes", value=True),
        f"classes: it must be a whole number (got True). {AGAIN}",
    ),
    (
        "name with a path",
        put("name", value="../x"),
        f"name: it must be text that is a name (got '../x'). {AGAIN}",
    ),
    (
        "training holds a tensor",
        put("training", "x", value=torch.zeros(1)),
        f"entry 'training.x' is not a plain value (got Tensor). {AGAIN}",
    ),
]
# Faults that the checks of the description or of the weights find: the place in the message is theirs.
BAD_INSIDE: list[tuple[str, Callable[[Path], object], str]] = [
    (
        "unknown architecture",
        put("architecture", value="hybird"),
        "architecture: 'hybird' is not known. Did you mean 'hybrid'?",
    ),
    (
        "tau of 0",
        put("neuron", "tau_sr", value=0.0),
        "neuron.tau_sr: it must be a number above 0 (got 0.0). Write it again with 'locsnn train'.",
    ),
    (
        "negative theta",
        put("neuron", "theta", value=-10.0),
        "neuron.theta: it must be a number above 0 (got -10.0). Write it again with 'locsnn train'.",
    ),
    (
        "absurd hidden size",
        put("hidden", value=10**9),
        "hidden: it must be a whole number from 1 to 4096 (got 1000000000). Correct it.",
    ),
    (
        "absurd steps",
        put("input", "steps", value=10**12),
        "input 'steps': it must be a whole number from 1 to 1000000 (got 1000000000000). Correct it.",
    ),
    (
        "sizes of no sensor",
        put("input", "taxels", value=0),
        "sensor 'channels': its taxels are out of range (got 0 against 1..32768). Correct the layout of the sensor.",
    ),
    (
        "a sensor that contradicts itself",
        swap_sizes({"name": "grid", "taxels": 7, "columns": 2}),
        "sensor 'grid': its last row is not full (7 taxels). Correct the layout of the sensor.",
    ),
    (
        "repeated taxel",
        put("location_order", "taxels", value=[1, 2, 2, *TAXELS[3:]]),
        "location order: taxel 2 is repeated at entry 3. Give every taxel from 1 to 39 exactly once.",
    ),
    (
        "missing taxel",
        put("location_order", "taxels", value=TAXELS[:-1]),
        "location order: taxel 39 is missing (38 of 39 taxels given). Give every taxel from 1 to 39 exactly once.",
    ),
    (
        "taxel out of range",
        put("location_order", "taxels", value=[0, *TAXELS[1:]]),
        "location order: entry 1 is not a taxel of the sensor (got 0 against 1..39). "
        "Give every taxel from 1 to 39 exactly once.",
    ),
    (
        "no order",
        put("location_order", value=None),
        "architecture 'hybrid': its location branch needs a location order. "
        "Give its name, such as loop or snake, or a list of taxel numbers.",
    ),
    (
        "NaN weight",
        bad_weight(float("nan")),
        "population 'location_hidden': weight [2, 5] is not finite (got nan, 1 such weights). Train the network again.",
    ),
    (
        "infinite weight",
        bad_weight(float("inf")),
        "population 'location_hidden': weight [2, 5] is not finite (got inf, 1 such weights). Train the network again.",
    ),
    (
        "wrong weight shape",
        put("weights", "time_hidden", value=torch.zeros(4, 77)),
        f"population 'time_hidden': its weights have another shape (out, in) ((4, 77) against (4, 78)). {AGAIN}",
    ),
    (
        "wrong weight type",
        put("weights", "time_hidden", value=torch.zeros(4, 78, dtype=torch.float64)),
        f"population 'time_hidden': its weights are not dense float32 (got torch.float64, strided on cpu). {AGAIN}",
    ),
    (
        "sparse weights",
        put("weights", "time_hidden", value=torch.zeros(4, 78).to_sparse()),
        f"population 'time_hidden': its weights are not dense float32 (got torch.float32, sparse_coo on cpu). {AGAIN}",
    ),
    (
        "weights without values",
        put("weights", "time_hidden", value=torch.zeros(4, 78, device="meta")),
        f"population 'time_hidden': its weights are not dense float32 (got torch.float32, strided on meta). {AGAIN}",
    ),
    (
        "recordings that claim to be huge",
        put(
            "recordings",
            "spikes",
            value=torch.zeros(1, 1, 1, dtype=torch.uint8).expand(10**9, 9, 78),
        ),
        "recordings: its recordings of 1000000000 x 9 x 78 are too large (702000000000 values against 200000000). "
        "Give at most 284900 at a time and average the figures of the parts, or give wider bins.",
    ),
    (
        "recordings of another shape",
        put("recordings", "spikes", value=torch.zeros(2, 8, 78, dtype=torch.uint8)),
        f"recordings: their steps and channels are not those of the input ((8, 78) against (9, 78)). {AGAIN}",
    ),
    (
        "recordings of floats",
        put("recordings", "spikes", value=torch.zeros(2, 9, 78)),
        f"recordings: spikes must be dense uint8 and labels int64 (got torch.float32 and torch.int64). {AGAIN}",
    ),
]


@pytest.mark.parametrize(("make", "message"), [pytest.param(m, t, id=i) for i, m, t in BAD])
def test_a_file_that_is_not_a_checkpoint_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, make: Callable[[Path], object], message: str
) -> None:
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "small.pt"
    make(path)
    with pytest.raises(InputError) as caught, warnings.catch_warnings(record=True) as leaked:
        read_checkpoint(path)
    assert str(caught.value) == f"checkpoint 'small.pt': {message}"
    assert not leaked
    assert not (tmp_path / "ran").exists()


@pytest.mark.parametrize(("make", "message"), [pytest.param(m, t, id=i) for i, m, t in BAD_INSIDE])
def test_a_fault_inside_a_checkpoint_is_named(
    tmp_path: Path, make: Callable[[Path], object], message: str
) -> None:
    path = tmp_path / "small.pt"
    make(path)
    with pytest.raises(InputError) as caught:
        read_checkpoint(path)
    joint = ": " if message.startswith("neuron.") else ", "
    assert str(caught.value) == f"checkpoint 'small.pt'{joint}{message}"


def test_a_file_that_unpacks_to_far_more_than_its_size_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "small.pt"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("archive/data.pkl", b"\0" * 5_000_000)
    with pytest.raises(InputError) as caught:
        read_checkpoint(path)
    assert str(caught.value) == (
        "checkpoint 'small.pt': it unpacks to far more than its size "
        f"(5000000 bytes from {path.stat().st_size}). {AGAIN}"
    )


def test_an_unknown_name_of_weights_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "small.pt"
    put("weights", "time_hiden", value=torch.zeros(1))(path)
    with pytest.raises(InputError) as caught:
        read_checkpoint(path)
    assert str(caught.value) == (
        "checkpoint 'small.pt': weights: unknown key 'time_hiden'. Did you mean 'time_hidden'?"
    )


@pytest.mark.parametrize("step", range(40))
def test_random_damage_raises_nothing_but_an_input_error(tmp_path: Path, step: int) -> None:
    """Every other file is cut at random, and the others have 20 random bytes changed."""
    data = bytearray(save(tmp_path / "whole.pt").read_bytes())
    rng = np.random.default_rng(step)
    if step % 2:
        data = data[: int(rng.integers(len(data)))]
    else:
        for position in rng.integers(len(data), size=20):
            data[position] ^= int(rng.integers(1, 256))
    (tmp_path / "bad.pt").write_bytes(data)
    with warnings.catch_warnings(), contextlib.suppress(InputError):
        warnings.simplefilter("error")
        read_checkpoint(tmp_path / "bad.pt")
