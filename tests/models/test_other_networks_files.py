"""Checkpoints of version 3: integrate-and-fire, graph, window and artificial networks.

They are read back equal, and every fault in a file is named.
"""

from __future__ import annotations

import copy
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from locsnn_compile.data.sensor import LOCATION_ORDERS, neutouch
from locsnn_compile.data.taxel_graph import taxel_graph
from locsnn_compile.data.tensors import Tensor
from locsnn_compile.data.torch_file import load_plain
from locsnn_compile.errors import InputError
from locsnn_compile.models.architectures import ARCHITECTURES
from locsnn_compile.models.checkpoint import Checkpoint
from locsnn_compile.models.checkpoint_reader import parse_checkpoint, read_checkpoint
from locsnn_compile.models.description import InputLayout, LifParameters, NetworkDescription
from locsnn_compile.models.graph_and_windows import GraphParameters
from locsnn_compile.models.networks import build_network

AGAIN = "Write it again with 'locsnn train'."
OTHERS = [name for name, a in ARCHITECTURES.items() if a.neurons not in ("srm", "xylo")]


def description(name: str) -> NetworkDescription:
    """A small network of an architecture, with every entry that its file may hold."""
    structure = ARCHITECTURES[name]
    fields: dict[str, Any] = {}
    if "location" in structure.branches:
        fields["location_order"] = "arch"
        fields["location_taxels"] = LOCATION_ORDERS["arch"]
    if structure.neurons == "lif":
        fields["neuron"] = LifParameters(decay=0.3, threshold=0.6, window=0.4)
    if structure.graph:
        edges = taxel_graph("tree", neutouch(), neighbours=3, nearer_mm=2.0)
        fields["graph"] = GraphParameters("tree", edges, hops=2, features=3, step_features=2)
    return NetworkDescription(
        name,
        InputLayout(neutouch(1), steps=24, step_seconds=0.02),
        classes=3,
        hidden=4,
        name="small",
        **fields,
    )


def save(path: Path, name: str) -> Path:
    """Save an untrained network of an architecture."""
    Checkpoint(description(name), build_network(description(name), seed=1).weights()).save(path)
    return path


@pytest.mark.parametrize("name", OTHERS)
def test_a_checkpoint_is_read_back_equal(name: str, tmp_path: Path) -> None:
    checkpoint = read_checkpoint(save(tmp_path / "small.pt", name))
    weights = build_network(description(name), seed=1).weights()
    assert checkpoint.description == description(name)
    assert list(checkpoint.weights) == list(weights)
    assert all(np.array_equal(checkpoint.weights[key], weights[key]) for key in weights)
    assert save(tmp_path / "again.pt", name).read_bytes() == (tmp_path / "small.pt").read_bytes()


def put(*keys: Any, value: Any) -> Callable[[dict[str, Any]], None]:
    """Return a function that sets an entry of a nested dict; ``keys`` lead to it from outside to inside."""

    def change(values: dict[str, Any]) -> None:
        for key in keys[:-1]:
            values = values[key]
        values[keys[-1]] = value

    return change


def drop(*keys: str) -> Callable[[dict[str, Any]], None]:
    """Return a function that removes an entry of a nested dict."""

    def change(values: dict[str, Any]) -> None:
        for key in keys[:-1]:
            values = values[key]
        del values[keys[-1]]

    return change


GRAPH_FAULTS = [
    pytest.param(
        put("graph", value=None),
        ", architecture 'hybrid-graph': its graph is of another kind (NoneType against GraphParameters). "
        "Correct the description.",
        id="no graph",
    ),
    pytest.param(
        drop("graph", "hops"), f": graph: the key 'hops' is missing. {AGAIN}", id="no hops"
    ),
    pytest.param(
        put("graph", "hops", value=True),
        f": graph.hops: it must be a whole number from 1 to 16 (got True). {AGAIN}",
        id="truth",
    ),
    pytest.param(
        put("graph", "name", value="../x"),
        f": graph.name: it must be text that is a name (got '../x'). {AGAIN}",
        id="path",
    ),
    pytest.param(
        put("graph", "taxel_edges", 0, value=[1, 2, 3]),
        f": graph.taxel_edges: it must be a list of 2 (got 3). {AGAIN}",
        id="three ends",
    ),
    pytest.param(
        put("graph", "taxel_edges", 0, value=["1", 2]),
        ": graph.taxel_edges: it must be a whole number (got '1'). Write it again with 'locsnn train'.",
        id="an end of text",
    ),
    pytest.param(
        put("graph", "features", value=1000),
        ", neurons of time_graph: it must be a whole number from 1 to 4096 (got 39000). Correct it.",
        id="too many neurons",
    ),
    pytest.param(
        put("neuron", "decay", value=float("nan")),
        ": neuron.decay: it must be a number from 0 to 1 (got nan). Write it again with 'locsnn train'.",
        id="decay NaN",
    ),
    pytest.param(
        put("neuron", "theta", value=1.0),
        ": neuron: unknown key 'theta'. Choose one of: decay, threshold, window.",
        id="theta",
    ),
    pytest.param(
        put("weights", "time_graph", value=Tensor("torch.float32", (3, 5))),
        f", population 'time_graph': its weights have another shape (out, in) ((3, 5) against (3, 6)). {AGAIN}",
        id="weights of another graph",
    ),
]


@pytest.fixture(scope="module")
def graph_values(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """The plain values of the file of a ``hybrid-graph``."""
    path = save(tmp_path_factory.mktemp("graph") / "small.pt", "hybrid-graph")
    values: dict[str, Any] = load_plain(path.read_bytes(), "x", fix="")  # type: ignore[assignment]
    return values


@pytest.mark.parametrize(("change", "message"), GRAPH_FAULTS)
def test_faults_of_graphs_are_named(
    graph_values: dict[str, Any], change: Callable[[dict[str, Any]], None], message: str
) -> None:
    values = copy.deepcopy(graph_values)
    change(values)
    with pytest.raises(InputError) as caught:
        parse_checkpoint(values, "checkpoint 'small.pt'", "small.pt", "0" * 64)
    assert str(caught.value) == f"checkpoint 'small.pt'{message}"


LEVELS = ", windows 'levels': they must be numbers of events, each larger than the one before (got {} against 1..6). Give, for example, 1 2."
WINDOW_FAULTS = [
    pytest.param(
        "levels",
        ["a"],
        f": neuron.levels: it must be a whole number (got 'a'). {AGAIN}",
        id="a level of text",
    ),
    pytest.param("levels", [], LEVELS.format("[]"), id="no level"),
    pytest.param("levels", [2, 1], LEVELS.format("[2, 1]"), id="levels that fall"),
    pytest.param(
        "levels",
        [1, True],
        f": neuron.levels: it must be a whole number (got True). {AGAIN}",
        id="a level of truth",
    ),
    pytest.param(
        "levels", 2, f": neuron.levels: it must be a list (got 2). {AGAIN}", id="a number"
    ),
    pytest.param(
        "stride",
        0,
        ": neuron.stride: it must be a whole number of at least 1 (got 0). Write it again with 'locsnn train'.",
        id="no stride",
    ),
    pytest.param(
        "steps",
        10**18,
        ", recordings: one window is longer than they are (1000000000000000000 steps against 24). "
        "Use shorter windows (window_steps).",
        id="endless windows",
    ),
    pytest.param(
        "stride",
        10**18,
        ", population 'location_output': its weights have another shape (out, in) ((3, 1092) against (3, 156)). "
        f"{AGAIN}",
        id="one window",
    ),
]


@pytest.mark.parametrize(("key", "value", "message"), WINDOW_FAULTS)
def test_faults_of_windows_are_named(key: str, value: Any, message: str, tmp_path: Path) -> None:
    values: dict[str, Any] = load_plain(
        save(tmp_path / "small.pt", "window-snn").read_bytes(), "x", fix=""
    )  # type: ignore[assignment]
    values["neuron"][key] = value
    with pytest.raises(InputError) as caught:
        parse_checkpoint(values, "checkpoint 'small.pt'", "small.pt", "0" * 64)
    assert str(caught.value) == f"checkpoint 'small.pt'{message}"


def test_a_weight_that_is_not_finite_is_named_by_its_place(tmp_path: Path) -> None:
    weights = build_network(description("cnn-3d")).weights()
    weights["conv_1.weight"][1, 0, 2, 0, 1] = np.inf
    with pytest.raises(InputError) as caught:
        Checkpoint(description("cnn-3d"), weights).save(tmp_path / "bad.pt")
    assert str(caught.value) == (
        "population 'conv_1.weight': weight [1, 0, 2, 0, 1] is not finite (got inf, 1 such weights). "
        "Train the network again."
    )
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("version", "name"), [(3, "tactile-snn"), (1, "gru-mlp")], ids=["new", "old"]
)
def test_a_version_that_does_not_hold_such_networks(
    version: int, name: str, tmp_path: Path
) -> None:
    values: dict[str, Any] = load_plain(save(tmp_path / "small.pt", name).read_bytes(), "x", fix="")  # type: ignore[assignment]
    values["version"] = version
    if version == 3:
        values |= {"graph": None, "neuron": {}}
    else:
        del values["graph"]
        values["neuron"] = dict.fromkeys(
            ("theta", "tau_sr", "tau_ref", "scale_ref", "tau_rho", "scale_rho"), 1.0
        )
    with pytest.raises(InputError) as caught:
        parse_checkpoint(values, "checkpoint 'small.pt'", "small.pt", "0" * 64)
    expected = {
        3: f"checkpoint 'small.pt': version 3 does not hold such networks. {AGAIN}",
        1: "checkpoint 'small.pt', architecture 'gru-mlp': its neuron is of another kind "
        "(NeuronParameters against NoneType). Correct the description.",
    }
    assert str(caught.value) == expected[version]
