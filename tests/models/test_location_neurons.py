"""Location neurons with a threshold, time constants and delays of their own: in torch, in the reference, on the chip."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

import hw_model as hw
import locsnn_compile as lc
from locsnn_compile.cli.main import main
from locsnn_compile.data import write_recordings
from locsnn_compile.data.sensor import neutouch
from locsnn_compile.data.synthetic import synthetic_touches
from locsnn_compile.errors import InputError
from locsnn_compile.models.checkpoint import Checkpoint
from locsnn_compile.models.checkpoint_reader import read_checkpoint
from locsnn_compile.models.description import (
    InputLayout,
    LifParameters,
    NetworkDescription,
    NeuronParameters,
)
from locsnn_compile.models.networks import build_network
from locsnn_compile.network.neurons import SrmAlpha
from locsnn_compile.reference.evaluate import evaluate
from locsnn_compile.settings import TRAINABLE
from locsnn_compile.training.config import TrainingConfig
from locsnn_compile.training.describe import describe, fixed_by
from locsnn_compile.training.export import export_checkpoint
from locsnn_compile.training.train import train

LAYOUT = InputLayout(neutouch(1), steps=60, step_seconds=0.02)
RECORDINGS = synthetic_touches(6, steps=60, classes=3, seed=4)
OWN = NeuronParameters(theta=4.0, tau_sr=3.0, tau_ref=2.0)
DELAYS = (0, 5, 33)


def description(**own: object) -> NetworkDescription:
    """A hybrid whose location branch has constants and delays of its own, with some fields replaced."""
    values = {
        "architecture": "hybrid", "input": LAYOUT, "classes": 3, "hidden": 5, "location_order": "loop",
        "location_taxels": tuple(range(1, 40)), "location_neuron": OWN, "location_delays": DELAYS,
    }  # fmt: skip
    return NetworkDescription(**values | own)  # type: ignore[arg-type]


LIF = description(
    architecture="hybrid-lif", location_neuron=LifParameters(decay=0.5, threshold=1.5)
)


def alpha(k: np.ndarray, tau: float) -> np.ndarray:
    return k / tau * np.exp(1 - k / tau)


def hidden_by_hand(weights: np.ndarray, spikes: np.ndarray) -> np.ndarray:
    """Return the spikes (locations, hidden) of ``location_hidden``, as sums of kernels over delayed events."""
    events = np.zeros((78, 0))
    for delay in DELAYS:  # the loop walks channels as they are numbered
        events = np.hstack([events, np.vstack([np.zeros((delay, 60)), spikes.T[: 78 - delay]])])
    k = np.arange(78.0)
    psp = np.array(
        [sum(alpha(k, OWN.tau_sr)[i - j] * events[j] for j in range(i + 1)) for i in range(78)]
    )
    u, found = psp @ weights.T, np.zeros((78, len(weights)))
    for i in range(78):
        found[i] = u[i] >= OWN.theta
        u[i:] -= OWN.scale_ref * OWN.theta * alpha(k, OWN.tau_ref)[: 78 - i, None] * found[i]
    return found


def test_a_location_branch_has_its_own_constants_and_delays() -> None:
    network = build_network(description(), seed=3, initial_scale=10.0).double()
    with torch.no_grad():
        found = network(torch.from_numpy(RECORDINGS.spikes.copy()).double())[
            "location_hidden"
        ].numpy()
    weights = network.weights()["location_hidden"].astype(np.float64)
    assert weights.shape == (5, 60 * len(DELAYS))
    assert found.sum() > 50
    for sample, spikes in enumerate(RECORDINGS.spikes):
        assert np.array_equal(found[sample], hidden_by_hand(weights, spikes.astype(float)))


@pytest.mark.parametrize("own", [description(), LIF], ids=["LSRM", "LLIF"])
def test_file_reference_and_torch_are_equal(own: NetworkDescription, tmp_path: Path) -> None:
    network = build_network(own, seed=3, initial_scale=10.0).double()
    Checkpoint(network.description, network.weights()).save(tmp_path / "net.pt")
    assert read_checkpoint(tmp_path / "net.pt").description == own
    loaded = lc.load(tmp_path / "net.pt")
    assert [(p.source, p.delay) for p in loaded.into("location_hidden")] == [
        ("touch_transposed", d) for d in DELAYS
    ]
    assert [p.delay for p in loaded.into("time_hidden")] == [0]
    with torch.no_grad():
        wanted = network(torch.from_numpy(RECORDINGS.spikes.copy()).double())
    found = evaluate(loaded, RECORDINGS.spikes)
    for name, spikes in wanted.items():
        assert np.array_equal(found.spikes[name], spikes.numpy()), name
    assert wanted["location_output"].sum() > 0


@pytest.mark.slow
@pytest.mark.parametrize("own", [description(), LIF], ids=["LSRM", "LLIF"])
def test_both_engines_play_it_alike(own: NetworkDescription, tmp_path: Path) -> None:
    network = build_network(own, seed=3, initial_scale=10.0)
    Checkpoint(own, network.weights()).save(tmp_path / "net.pt")
    strategy = "auto" if own is LIF else "dendrite"
    compiled = lc.compile(
        lc.load(tmp_path / "net.pt"), strategy=strategy, events=RECORDINGS, diagnosis=False
    )
    assert compiled.report["match"]["spike_agreement"] > 0.8
    slow, fast = (
        hw.simulate(compiled.program, RECORDINGS.spikes, engine=engine)
        for engine in ("reference", "fast")
    )
    for name, spikes in slow.spikes.items():
        assert np.array_equal(fast.spikes[name], spikes), name


def test_a_session_says_what_a_simulation_says(tmp_path: Path) -> None:
    own = description()
    Checkpoint(own, build_network(own, seed=3, initial_scale=10.0).weights()).save(
        tmp_path / "net.pt"
    )
    program = lc.compile(
        lc.load(tmp_path / "net.pt"), strategy="dendrite", events=RECORDINGS, diagnosis=False
    ).program
    recording = RECORDINGS.spikes[0]
    found = hw.Session(program).push(recording)
    for step in (20, 59):
        so_far = np.where(np.arange(60)[:, None] <= step, recording, 0)
        wanted = hw.simulate(program, so_far[None]).spikes["location_output"][0].sum(axis=0)
        assert np.array_equal(found.spikes["location_output"][step], wanted)


@pytest.mark.parametrize("strategy", TRAINABLE)
def test_trained_on_the_chip_the_program_spikes_the_same(strategy: str, tmp_path: Path) -> None:
    config = TrainingConfig(
        hidden=5, location_theta=4.0, location_tau_sr=3.0, location_tau_ref=2.0, location_delays="0 5 33", epochs=1,
        target="loihi-sim", strategy=strategy, validation_fraction=0.0, event_dropout=0.0, channel_dropout=0.0,
        initial_scale=10.0,
    )  # fmt: skip
    result = train(RECORDINGS, config)
    assert result.network.description.location_neuron == OWN
    export_checkpoint(tmp_path / "net.pt", result, config, RECORDINGS, None, carried=2)
    compiled = lc.compile(lc.load(tmp_path / "net.pt"), events=RECORDINGS, diagnosis=False)
    played = hw.simulate(compiled.program, RECORDINGS.spikes)
    with torch.no_grad():
        own = result.network(torch.from_numpy(RECORDINGS.spikes.copy()).float())
    assert own["location_hidden"].sum() > 0
    for name, spikes in own.items():
        assert np.array_equal(played.spikes[name], spikes.numpy()), name


@pytest.mark.parametrize(
    ("options", "wanted"),
    [
        pytest.param({}, None, id="none"),
        pytest.param(
            {"theta": 8.0, "location_tau_sr": 3.0},
            NeuronParameters(theta=8.0, tau_sr=3.0),
            id="one",
        ),
        pytest.param({"location_theta": 3.0}, NeuronParameters(theta=3.0), id="threshold"),
        pytest.param({"location_decay": 0.0}, None, id="of another kind"),
        pytest.param(
            {"model": "hybrid-lif", "location_decay": 0.0},
            LifParameters(decay=0.0),
            id="LIF, nought",
        ),
    ],
)
def test_options_make_the_neuron(options: dict[str, object], wanted: object) -> None:
    assert describe(RECORDINGS, TrainingConfig(**options), 3).location_neuron == wanted  # type: ignore[arg-type]


def test_the_command_trains_with_them_and_goes_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    write_recordings(tmp_path / "touches.npz", RECORDINGS)
    Path("own.yaml").write_text("{epochs: 1, hidden: 4, location_theta: 4, location_delays: 0 5}")
    data = ["train", "--data", "touches.npz", "--quiet"]
    assert main([*data, "--config", "own.yaml", "-o", "net.pt"]) == 0
    assert main([*data, "--from", "net.pt", "--epochs", "1", "-o", "more.pt"]) == 0
    found = read_checkpoint("more.pt").description
    assert (found.location_neuron, found.location_delays) == (NeuronParameters(theta=4.0), (0, 5))
    Path("own.yaml").write_text("{epochs: 1, location_theta: 5}")
    assert main([*data, "--from", "net.pt", "--config", "own.yaml", "-o", "more.pt"]) == 2
    assert capsys.readouterr().err == (
        "training option 'location_theta': the network to start from has another value (got 5 against 4.0). "
        "Leave the option out.\n"
    )
    Path("own.yaml").write_text("{model: tactile-snn, location_theta: 5}")
    assert main([*data, "--config", "own.yaml", "-o", "more.pt"]) == 2
    assert capsys.readouterr().err == (
        "config 'own.yaml', location_theta: it would change nothing: the network has no location branch. "
        "Leave it out.\n"
    )


@pytest.mark.parametrize(
    ("values", "message"),
    [
        pytest.param(
            {"location_delays": (5, 0)},
            "location_delays: they must be whole numbers of steps, each larger than the one before "
            "(got [5, 0] against 0..65534). Give, for example, 0 20 40 60.",
            id="delays that fall",
        ),
        pytest.param(
            {
                "architecture": "tactile-snn",
                "location_order": None,
                "location_taxels": None,
                "location_neuron": None,
            },
            "architecture 'tactile-snn': it has no fully connected layer over locations, so it takes no delays. "
            "Leave the delays out.",
            id="delays without a branch",
        ),
        pytest.param(
            {"architecture": "window-snn", "location_neuron": None},
            "architecture 'window-snn': it has no fully connected layer over locations, so it takes no delays. "
            "Leave the delays out.",
            id="delays of windows",
        ),
        pytest.param(
            {
                "architecture": "tactile-snn",
                "location_order": None,
                "location_taxels": None,
                "location_delays": (0,),
            },
            "architecture 'tactile-snn': its location neuron is of another kind (NeuronParameters against NoneType). "
            "Correct the description.",
            id="a neuron without a branch",
        ),
        pytest.param(
            {"location_neuron": LifParameters()},
            "architecture 'hybrid': its location neuron is of another kind (LifParameters against NeuronParameters). "
            "Correct the description.",
            id="a neuron of another kind",
        ),
    ],
)
def test_what_cannot_be(values: dict[str, object], message: str) -> None:
    with pytest.raises(InputError) as caught:
        description(**values)
    assert str(caught.value) == message


def test_a_delay_that_the_chip_does_not_hold() -> None:
    with pytest.raises(lc.TargetError) as caught:
        train(RECORDINGS, TrainingConfig(location_delays="0 63", target="loihi-sim", epochs=1))
    assert str(caught.value) == (
        "target 'loihi-sim': a delay is longer than the chip holds (63 against delay_max 62). Shorten it."
    )


def test_a_checkpoint_without_them_is_as_before(tmp_path: Path) -> None:
    plain = description(location_neuron=None, location_delays=(0,))
    Checkpoint(plain, build_network(plain).weights()).save(tmp_path / "net.pt")
    data = (tmp_path / "net.pt").read_bytes()
    assert b"location_neuron" not in data
    assert b"location_delays" not in data
    assert fixed_by(plain)["location_theta"] is None
    assert {p.neuron for p in lc.load(tmp_path / "net.pt").populations} == {
        SrmAlpha(theta=10.0, tau_sr=10.0, tau_ref=1.0, scale_ref=2.0)
    }
    assert replace(plain, location_neuron=OWN).srm("location_output") == OWN
