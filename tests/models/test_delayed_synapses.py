"""Synapses with delays from the recording onto the time branch.

Torch, the compiler's float reference and the chip must spike the same; files keep the delays; and impossible delays are
refused.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

import hw_model as hw
import locsnn_compile as lc
from locsnn_compile.baselines.operations import network_additions
from locsnn_compile.cli.main import main
from locsnn_compile.data import write_recordings
from locsnn_compile.data.sensor import neutouch
from locsnn_compile.data.synthetic import synthetic_touches
from locsnn_compile.errors import InputError
from locsnn_compile.models.checkpoint import Checkpoint
from locsnn_compile.models.checkpoint_reader import read_checkpoint
from locsnn_compile.models.description import InputLayout, NetworkDescription
from locsnn_compile.models.networks import build_network, delayed
from locsnn_compile.reference.evaluate import evaluate
from locsnn_compile.settings import TRAINABLE
from locsnn_compile.training.config import TrainingConfig
from locsnn_compile.training.describe import fixed_by
from locsnn_compile.training.export import export_checkpoint
from locsnn_compile.training.train import train

LAYOUT = InputLayout(neutouch(1), steps=60, step_seconds=0.02)
DELAYS = (0, 7, 30)
HIDDEN = 5
CLASSES = 3
RECORDINGS = synthetic_touches(6, steps=60, classes=CLASSES, seed=4)


def description(**changed_fields: object) -> NetworkDescription:
    """A network over time whose inputs have delays, with some fields changed."""
    values = {
        "architecture": "tactile-snn",
        "input": LAYOUT,
        "classes": CLASSES,
        "hidden": HIDDEN,
        "delays": DELAYS,
    } | changed_fields
    return NetworkDescription(**values)  # type: ignore[arg-type]


def hybrid() -> NetworkDescription:
    """The same with a location branch."""
    return description(
        architecture="hybrid", location_order="loop", location_taxels=tuple(range(1, 40))
    )


@given(
    steps=st.integers(1, 8),
    delays=st.sets(st.integers(0, 12), min_size=1),
    seed=st.integers(0, 2**31),
)
@settings(max_examples=40, deadline=None)
def test_every_delay_moves_all_channels(steps: int, delays: set[int], seed: int) -> None:
    samples, channels = 2, 3
    x = torch.rand(samples, steps, channels, generator=torch.Generator().manual_seed(seed))
    result = delayed(x, sorted(delays))
    for k, delay in enumerate(sorted(delays)):
        copy = result[:, :, channels * k : channels * (k + 1)]
        for t in range(steps):
            expected = x[:, t - delay] if t >= delay else torch.zeros(samples, channels)
            assert torch.equal(copy[:, t], expected)


def test_without_delays_nothing_is_copied() -> None:
    x = torch.zeros(1, 2, 3)
    assert delayed(x, (0,)) is x


def test_the_reference_spikes_like_torch_with_a_projection_for_each_delay(tmp_path: Path) -> None:
    network = build_network(hybrid(), seed=3, initial_scale=10.0).double()
    Checkpoint(network.description, network.weights()).save(tmp_path / "net.pt")
    loaded = lc.load(tmp_path / "net.pt")
    assert [(p.source, p.delay) for p in loaded.into("time_hidden")] == [
        ("touch", delay) for delay in DELAYS
    ]
    with torch.no_grad():
        torch_spikes = network(torch.from_numpy(RECORDINGS.spikes.copy()).double())
    reference = evaluate(loaded, RECORDINGS.spikes)
    for name, spikes in torch_spikes.items():
        assert np.array_equal(reference.spikes[name], spikes.numpy())
    assert torch_spikes["time_output"].sum() > 0
    # An event is added once per delay and hidden neuron, a hidden spike once per output.
    events = int(RECORDINGS.spikes.sum())
    hidden_spikes = int(reference.spikes["time_hidden"].sum())
    additions = events * len(DELAYS) * HIDDEN + hidden_spikes * CLASSES
    assert network_additions(loaded, reference.spikes)["time"] == additions


def test_a_checkpoint_keeps_delays(tmp_path: Path) -> None:
    network = build_network(description(), seed=1)
    Checkpoint(network.description, network.weights()).save(tmp_path / "net.pt")
    checkpoint = read_checkpoint(tmp_path / "net.pt")
    assert checkpoint.description.delays == DELAYS
    assert checkpoint.weights["time_hidden"].shape == (HIDDEN, len(DELAYS) * LAYOUT.channels)


@pytest.mark.slow
@pytest.mark.parametrize("strategy", TRAINABLE)
def test_a_network_trained_on_the_chip_spikes_like_its_program(
    strategy: str, tmp_path: Path
) -> None:
    config = TrainingConfig(
        hidden=5, delays="0 7 30", epochs=1, target="loihi-sim", strategy=strategy, validation_fraction=0.0,
        event_dropout=0.0, channel_dropout=0.0, initial_scale=10.0,
    )  # fmt: skip
    result = train(RECORDINGS, config)
    export_checkpoint(tmp_path / "net.pt", result, config, RECORDINGS, test=None, carried=2)
    compiled = lc.compile(lc.load(tmp_path / "net.pt"), events=RECORDINGS, diagnosis=False)
    played = hw.simulate(compiled.program, RECORDINGS.spikes)
    with torch.no_grad():
        torch_spikes = result.network(torch.from_numpy(RECORDINGS.spikes.copy()).float())
    assert torch_spikes["time_hidden"].sum() > 0
    for name, spikes in torch_spikes.items():
        assert np.array_equal(played.spikes[name], spikes.numpy())


def test_a_float_network_compiles(tmp_path: Path) -> None:
    network = build_network(hybrid(), seed=3, initial_scale=10.0)
    Checkpoint(network.description, network.weights()).save(tmp_path / "net.pt")
    report = lc.compile(
        lc.load(tmp_path / "net.pt"), strategy="dendrite", events=RECORDINGS, diagnosis=False
    ).report
    assert report["match"]["spike_agreement"] > 0.8


def test_the_command_trains_with_delays_and_starts_from_such_a_network(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    write_recordings(tmp_path / "touches.npz", RECORDINGS)
    data = ["train", "--data", "touches.npz", "--epochs", "1", "--quiet"]
    assert main([*data, "--delays", "0 7", "--hidden", "4", "-o", "net.pt"]) == 0
    assert main([*data, "--from", "net.pt", "-o", "more.pt"]) == 0
    assert read_checkpoint("more.pt").description.delays == (0, 7)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        pytest.param(
            {"delays": (0, 65_535)},
            "delays: they must be whole numbers of steps, each larger than the one before (got [0, 65535] against 0..65534). "
            "Give, for example, 0 20 40 60.",
            id="longer than any chip holds",
        ),
        pytest.param(
            {"delays": (3, 3)},
            "delays: they must be whole numbers of steps, each larger than the one before (got [3, 3] against 0..65534). "
            "Give, for example, 0 20 40 60.",
            id="twice the same",
        ),
        pytest.param(
            {"delays": ()},
            "delays: they must be whole numbers of steps, each larger than the one before (got [] against 0..65534). "
            "Give, for example, 0 20 40 60.",
            id="none",
        ),
        pytest.param(
            {
                "architecture": "location-tactile-snn",
                "location_order": "loop",
                "location_taxels": tuple(range(1, 40)),
            },
            "architecture 'location-tactile-snn': it has no fully connected layer over time steps, so it takes no delays. "
            "Leave the delays out.",
            id="no time branch",
        ),
    ],
)
def test_impossible_delays_are_refused(values: dict[str, object], message: str) -> None:
    with pytest.raises(InputError) as caught:
        description(**values)
    assert str(caught.value) == message


def test_delays_that_are_not_numbers_are_refused() -> None:
    with pytest.raises(InputError) as caught:
        train(RECORDINGS, TrainingConfig(delays="0 a"))
    assert str(caught.value) == (
        "training option 'delays': it must be whole numbers (got '0 a'). Give, for example, '0 20 40 60'."
    )


def test_the_network_to_start_from_determines_the_delays() -> None:
    assert fixed_by(description())["delays"] == "0 7 30"
    assert fixed_by(replace(description(), delays=(0,)))["delays"] == "0"
