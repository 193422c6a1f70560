"""Location neurons with a threshold, time constants and delays of their own, unlike those of the time branch.

The spikes of torch are compared with sums of kernels by hand, the float reference and the chip with torch. Files keep
the constants, options set them, and impossible ones are refused.
"""

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

STEPS = 60
LAYOUT = InputLayout(neutouch(1), steps=STEPS, step_seconds=0.02)
CHANNELS = LAYOUT.channels  # 78: 39 taxels with two polarities, the locations of the branch
RECORDINGS = synthetic_touches(6, steps=STEPS, classes=3, seed=4)
OWN = NeuronParameters(theta=4.0, tau_sr=3.0, tau_ref=2.0)
DELAYS = (0, 5, 33)
LOUD = 10.0
"""An ``initial_scale`` of random weights at which untrained neurons spike."""


def description(**changed_fields: object) -> NetworkDescription:
    """A hybrid whose location branch has constants and delays of its own, with some fields changed."""
    values = {
        "architecture": "hybrid", "input": LAYOUT, "classes": 3, "hidden": 5, "location_order": "loop",
        "location_taxels": tuple(range(1, 40)), "location_neuron": OWN, "location_delays": DELAYS,
    }  # fmt: skip
    return NetworkDescription(**values | changed_fields)  # type: ignore[arg-type]


LIF = description(
    architecture="hybrid-lif", location_neuron=LifParameters(decay=0.5, threshold=1.5)
)


def alpha(k: np.ndarray, tau: float) -> np.ndarray:
    """The kernel of a spike k locations ago."""
    return k / tau * np.exp(1 - k / tau)


def hidden_by_hand(weights: np.ndarray, spikes: np.ndarray) -> np.ndarray:
    """Return the spikes (locations, hidden) of ``location_hidden``, as sums of kernels over delayed events."""
    # The order "loop" visits channels as they are numbered, so locations are channels. Each delay adds a
    # copy of the events (locations, steps), moved by so many locations.
    copies = [
        np.vstack([np.zeros((delay, STEPS)), spikes.T[: CHANNELS - delay]]) for delay in DELAYS
    ]
    events = np.hstack(copies)
    k = np.arange(float(CHANNELS))
    of_event = alpha(k, OWN.tau_sr)
    of_own_spike = OWN.scale_ref * OWN.theta * alpha(k, OWN.tau_ref)
    psp = np.array(
        [sum(of_event[i - j] * events[j] for j in range(i + 1)) for i in range(CHANNELS)]
    )
    u = psp @ weights.T
    hidden_spikes = np.zeros((CHANNELS, len(weights)))
    for i in range(CHANNELS):
        hidden_spikes[i] = u[i] >= OWN.theta
        u[i:] -= of_own_spike[: CHANNELS - i, None] * hidden_spikes[i]
    return hidden_spikes


def test_a_location_branch_has_its_own_constants_and_delays() -> None:
    network = build_network(description(), seed=3, initial_scale=LOUD).double()
    with torch.no_grad():
        activity = network(torch.from_numpy(RECORDINGS.spikes.copy()).double())
    hidden_spikes = activity["location_hidden"].numpy()
    weights = network.weights()["location_hidden"].astype(np.float64)
    assert weights.shape == (5, STEPS * len(DELAYS))
    assert hidden_spikes.sum() > 50
    for sample, spikes in enumerate(RECORDINGS.spikes):
        assert np.array_equal(hidden_spikes[sample], hidden_by_hand(weights, spikes.astype(float)))


@pytest.mark.parametrize("described", [description(), LIF], ids=["LSRM", "LLIF"])
def test_a_file_keeps_the_constants_and_the_reference_spikes_like_torch(
    described: NetworkDescription, tmp_path: Path
) -> None:
    network = build_network(described, seed=3, initial_scale=LOUD).double()
    Checkpoint(network.description, network.weights()).save(tmp_path / "net.pt")
    assert read_checkpoint(tmp_path / "net.pt").description == described
    loaded = lc.load(tmp_path / "net.pt")
    assert [(p.source, p.delay) for p in loaded.into("location_hidden")] == [
        ("touch_transposed", d) for d in DELAYS
    ]
    assert [p.delay for p in loaded.into("time_hidden")] == [0]
    with torch.no_grad():
        torch_spikes = network(torch.from_numpy(RECORDINGS.spikes.copy()).double())
    reference = evaluate(loaded, RECORDINGS.spikes)
    for name, spikes in torch_spikes.items():
        assert np.array_equal(reference.spikes[name], spikes.numpy()), name
    assert torch_spikes["location_output"].sum() > 0


@pytest.mark.slow
@pytest.mark.parametrize("described", [description(), LIF], ids=["LSRM", "LLIF"])
def test_both_engines_spike_alike(described: NetworkDescription, tmp_path: Path) -> None:
    network = build_network(described, seed=3, initial_scale=LOUD)
    Checkpoint(described, network.weights()).save(tmp_path / "net.pt")
    # LIF neurons are compartments as they are, and take no strategy. For spike response neurons, "auto" would try several.
    strategy = "auto" if described is LIF else "dendrite"
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


def test_a_session_has_the_counts_of_a_simulation_of_the_recording_so_far(tmp_path: Path) -> None:
    network = build_network(description(), seed=3, initial_scale=LOUD)
    Checkpoint(network.description, network.weights()).save(tmp_path / "net.pt")
    program = lc.compile(
        lc.load(tmp_path / "net.pt"), strategy="dendrite", events=RECORDINGS, diagnosis=False
    ).program
    recording = RECORDINGS.spikes[0]
    streamed = hw.Session(program).push(recording)
    for step in (20, STEPS - 1):
        so_far = np.where(np.arange(STEPS)[:, None] <= step, recording, 0)
        simulated = hw.simulate(program, so_far[None])
        counts = simulated.spikes["location_output"][0].sum(axis=0)
        assert np.array_equal(streamed.spikes["location_output"][step], counts)


@pytest.mark.parametrize("strategy", TRAINABLE)
def test_a_network_trained_on_the_chip_spikes_like_its_program(
    strategy: str, tmp_path: Path
) -> None:
    config = TrainingConfig(
        hidden=5, location_theta=4.0, location_tau_sr=3.0, location_tau_ref=2.0, location_delays="0 5 33", epochs=1,
        target="loihi-sim", strategy=strategy, validation_fraction=0.0, event_dropout=0.0, channel_dropout=0.0,
        initial_scale=LOUD,
    )  # fmt: skip
    result = train(RECORDINGS, config)
    assert result.network.description.location_neuron == OWN
    export_checkpoint(tmp_path / "net.pt", result, config, RECORDINGS, test=None, carried=2)
    compiled = lc.compile(lc.load(tmp_path / "net.pt"), events=RECORDINGS, diagnosis=False)
    played = hw.simulate(compiled.program, RECORDINGS.spikes)
    with torch.no_grad():
        torch_spikes = result.network(torch.from_numpy(RECORDINGS.spikes.copy()).float())
    assert torch_spikes["location_hidden"].sum() > 0
    for name, spikes in torch_spikes.items():
        assert np.array_equal(played.spikes[name], spikes.numpy()), name


@pytest.mark.parametrize(
    ("options", "location_neuron"),
    [
        pytest.param({}, None, id="no option"),
        pytest.param(
            {"theta": 8.0, "location_tau_sr": 3.0},
            NeuronParameters(theta=8.0, tau_sr=3.0),
            id="a time constant",
        ),
        pytest.param({"location_theta": 3.0}, NeuronParameters(theta=3.0), id="threshold"),
        pytest.param({"location_decay": 0.0}, None, id="of another kind"),
        pytest.param(
            {"model": "hybrid-lif", "location_decay": 0.0},
            LifParameters(decay=0.0),
            id="LIF, a decay of 0",
        ),
    ],
)
def test_options_set_the_constants_of_location_neurons(
    options: dict[str, object], location_neuron: object
) -> None:
    described = describe(RECORDINGS, TrainingConfig(**options), 3)  # type: ignore[arg-type]
    assert described.location_neuron == location_neuron


def test_the_command_trains_with_such_options_and_starts_from_such_a_network(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    write_recordings(tmp_path / "touches.npz", RECORDINGS)
    Path("own.yaml").write_text("{epochs: 1, hidden: 4, location_theta: 4, location_delays: 0 5}")
    data = ["train", "--data", "touches.npz", "--quiet"]
    assert main([*data, "--config", "own.yaml", "-o", "net.pt"]) == 0
    assert main([*data, "--from", "net.pt", "--epochs", "1", "-o", "more.pt"]) == 0
    read_back = read_checkpoint("more.pt").description
    assert read_back.location_neuron == NeuronParameters(theta=4.0)
    assert read_back.location_delays == (0, 5)
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
def test_impossible_constants_and_delays_are_refused(
    values: dict[str, object], message: str
) -> None:
    with pytest.raises(InputError) as caught:
        description(**values)
    assert str(caught.value) == message


def test_a_delay_that_is_too_long_for_the_chip_is_refused() -> None:
    with pytest.raises(lc.TargetError) as caught:
        train(RECORDINGS, TrainingConfig(location_delays="0 63", target="loihi-sim", epochs=1))
    assert str(caught.value) == (
        "target 'loihi-sim': a delay is longer than the chip holds (63 against delay_max 62). Shorten it."
    )


def test_a_checkpoint_without_such_constants_has_no_entries_for_them(tmp_path: Path) -> None:
    """All its neurons then have the defaults of spike response neurons; training from it fixes no location constant."""
    plain = description(location_neuron=None, location_delays=(0,))
    Checkpoint(plain, build_network(plain).weights()).save(tmp_path / "net.pt")
    data = (tmp_path / "net.pt").read_bytes()
    assert b"location_neuron" not in data
    assert b"location_delays" not in data
    assert fixed_by(plain)["location_theta"] is None
    assert {p.neuron for p in lc.load(tmp_path / "net.pt").populations} == {
        SrmAlpha(theta=10.0, tau_sr=10.0, tau_ref=1.0, scale_ref=2.0)
    }


def test_the_constants_of_a_location_branch_are_those_of_its_output_neurons() -> None:
    plain = description(location_neuron=None)
    assert replace(plain, location_neuron=OWN).srm("location_output") == OWN
