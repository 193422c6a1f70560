"""Synapses with delays onto the time branch: in torch, in the compiler's reference, on the chip, and in files."""

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
from locsnn_compile.training.export import export_checkpoint
from locsnn_compile.training.train import train

LAYOUT = InputLayout(neutouch(1), steps=60, step_seconds=0.02)
DELAYS = (0, 7, 30)
RECORDINGS = synthetic_touches(6, steps=60, classes=3, seed=4)


def description(**own: object) -> NetworkDescription:
    """A network along time whose inputs have delays, with some fields replaced."""
    values = {
        "architecture": "tactile-snn",
        "input": LAYOUT,
        "classes": 3,
        "hidden": 5,
        "delays": DELAYS,
    } | own
    return NetworkDescription(**values)  # type: ignore[arg-type]


def hybrid() -> NetworkDescription:
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
    x = torch.rand(2, steps, 3, generator=torch.Generator().manual_seed(seed))
    found = delayed(x, sorted(delays))
    for k, delay in enumerate(sorted(delays)):
        for t in range(steps):
            wanted = x[:, t - delay] if t >= delay else torch.zeros(2, 3)
            assert torch.equal(found[:, t, 3 * k : 3 * k + 3], wanted)


def test_without_delays_nothing_is_copied() -> None:
    x = torch.zeros(1, 2, 3)
    assert delayed(x, (0,)) is x


def test_the_reference_hears_each_delay(tmp_path: Path) -> None:
    network = build_network(hybrid(), seed=3, initial_scale=10.0).double()
    Checkpoint(network.description, network.weights()).save(tmp_path / "net.pt")
    loaded = lc.load(tmp_path / "net.pt")
    assert [(p.source, p.delay) for p in loaded.into("time_hidden")] == [
        ("touch", delay) for delay in DELAYS
    ]
    with torch.no_grad():
        wanted = network(torch.from_numpy(RECORDINGS.spikes.copy()).double())
    found = evaluate(loaded, RECORDINGS.spikes)
    for name, spikes in wanted.items():
        assert np.array_equal(found.spikes[name], spikes.numpy())
    assert wanted["time_output"].sum() > 0
    events = int(RECORDINGS.spikes.sum())
    hidden = int(found.spikes["time_hidden"].sum())
    assert network_additions(loaded, found.spikes)["time"] == events * len(DELAYS) * 5 + hidden * 3


def test_a_checkpoint_keeps_delays(tmp_path: Path) -> None:
    network = build_network(description(), seed=1)
    Checkpoint(network.description, network.weights()).save(tmp_path / "net.pt")
    found = read_checkpoint(tmp_path / "net.pt")
    assert found.description.delays == DELAYS
    assert found.weights["time_hidden"].shape == (5, 3 * 78)


@pytest.mark.slow
@pytest.mark.parametrize("strategy", TRAINABLE)
def test_trained_on_the_chip_the_program_spikes_the_same(strategy: str, tmp_path: Path) -> None:
    config = TrainingConfig(
        hidden=5, delays="0 7 30", epochs=1, target="loihi-sim", strategy=strategy, validation_fraction=0.0,
        event_dropout=0.0, channel_dropout=0.0, initial_scale=10.0,
    )  # fmt: skip
    result = train(RECORDINGS, config)
    export_checkpoint(tmp_path / "net.pt", result, config, RECORDINGS, None, carried=2)
    compiled = lc.compile(lc.load(tmp_path / "net.pt"), events=RECORDINGS, diagnosis=False)
    played = hw.simulate(compiled.program, RECORDINGS.spikes)
    with torch.no_grad():
        own = result.network(torch.from_numpy(RECORDINGS.spikes.copy()).float())
    assert own["time_hidden"].sum() > 0
    for name, spikes in own.items():
        assert np.array_equal(played.spikes[name], spikes.numpy())


def test_a_float_network_compiles(tmp_path: Path) -> None:
    network = build_network(hybrid(), seed=3, initial_scale=10.0)
    Checkpoint(network.description, network.weights()).save(tmp_path / "net.pt")
    report = lc.compile(
        lc.load(tmp_path / "net.pt"), strategy="dendrite", events=RECORDINGS, diagnosis=False
    ).report
    assert report["match"]["spike_agreement"] > 0.8


def test_the_command_trains_with_delays_and_goes_on(
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
def test_delays_that_cannot_be(values: dict[str, object], message: str) -> None:
    with pytest.raises(InputError) as caught:
        description(**values)
    assert str(caught.value) == message


def test_delays_that_are_no_numbers() -> None:
    with pytest.raises(InputError) as caught:
        train(RECORDINGS, TrainingConfig(delays="0 a"))
    assert str(caught.value) == (
        "training option 'delays': it must be whole numbers (got '0 a'). Give, for example, '0 20 40 60'."
    )


def test_another_network_to_start_from_fixes_them(tmp_path: Path) -> None:
    from locsnn_compile.training.describe import fixed_by

    assert fixed_by(description())["delays"] == "0 7 30"
    assert fixed_by(replace(description(), delays=(0,)))["delays"] == "0"
