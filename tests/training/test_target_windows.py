"""Windows trained on the chip's integers: alone and next to a hybrid, against the program; and a planted fault."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
import yaml

import hw_model as hw
import locsnn_compile as lc
from hw_model.arithmetic.on_integers import WithoutWraps
from locsnn_compile.cli.main import main
from locsnn_compile.data.recordings import Recordings
from locsnn_compile.data.synthetic import synthetic_touches
from locsnn_compile.errors import InputError
from locsnn_compile.models import networks
from locsnn_compile.models.checkpoint import Checkpoint
from locsnn_compile.models.checkpoint_reader import read_checkpoint
from locsnn_compile.models.networks import WindowNetwork, build_network
from locsnn_compile.models.touch_model import TouchModel
from locsnn_compile.training.config import TrainingConfig, config_from_mapping
from locsnn_compile.training.export import export_checkpoint
from locsnn_compile.training.measure import class_scores
from locsnn_compile.training.train import TrainingResult, train

WINDOWS = {
    "window_steps": 8,
    "window_levels": "1 3",
    "hidden": 6,
    "epochs": 3,
    "validation_fraction": 0.0,
}


def touches(samples: int = 12) -> Recordings:
    return synthetic_touches(samples, steps=40, classes=3, seed=1)


def config_of(model: str, **options: object) -> TrainingConfig:
    return config_from_mapping(
        {"model": model, "batch_size": 4, "target": "loihi-sim"} | WINDOWS | options
    )


def exported(path: Path, result: TrainingResult, config: TrainingConfig) -> Checkpoint:
    export_checkpoint(path, result, config, touches(), None, carried=0)
    return read_checkpoint(path)


def compared(network: TouchModel, path: Path, target: str = "loihi-sim") -> tuple[int, int]:
    """Return how many spikes, and how many scores, of the network and of the program of a file differ."""
    program, test = (
        lc.compile(lc.load(path), target=target, diagnosis=False).program,
        touches(30).spikes,
    )
    with torch.no_grad():
        activity = network.double()(torch.from_numpy(test.copy()).double())
        scores = class_scores(network, test)
    branch = network.description.structure.window_branch
    windows = network if isinstance(network, WindowNetwork) else network.get_submodule("windows")
    assert isinstance(windows, WindowNetwork)
    own = {name: spikes.numpy() for name, spikes in activity.items() if name != f"{branch}_output"}
    own[f"{branch}_hidden"] = windows.hidden(torch.from_numpy(test.copy()).double()).numpy()[
        :, None
    ]
    played = hw.simulate(program, test)
    assert sum(int(spikes.sum()) for spikes in own.values()) > 1000
    heard = dict(played.spikes) | {f"{branch}_hidden": played.spikes[f"{branch}_hidden"][:, 1:2]}
    spikes = sum(int((heard[name] != spikes).sum()) for name, spikes in own.items())
    assert program.readout is not None
    # What a spike counts; of windows alone, what a potential of 1 in float does.
    assert network.chip is not None
    terms = dict(zip(program.readout.populations, program.readout.weights, strict=True))
    scale = network.chip.populations[windows.names[0]].scale
    unit = terms.get("time_output", scale * terms[f"{branch}_output_1"])
    return spikes, int((np.rint(scores * unit) != np.asarray(played.scores)).sum())


@pytest.mark.slow
@pytest.mark.parametrize("bits", [8, 4, 2])
@pytest.mark.parametrize(
    ("model", "strategy"),
    [("window-snn", "dendrite"), ("hybrid-window", "dendrite"), ("hybrid-window", "reset")],
    ids=["windows", "hybrid-window", "hybrid-window, reset"],
)
def test_the_program_scores_as_the_network_did(
    tmp_path: Path, model: str, strategy: str, bits: int
) -> None:
    options = {"weight_bits": bits} | ({"strategy": strategy} if model == "hybrid-window" else {})
    config = config_of(model, **options)
    result = train(touches(), config)
    found = exported(tmp_path / "tuned.pt", result, config)
    assert compared(result.network, tmp_path / "tuned.pt") == (0, 0)
    again = build_network(found.description, chip=found.chip)
    again.load_weights(found.float_weights)
    assert compared(again, tmp_path / "tuned.pt") == (0, 0)


@pytest.fixture(scope="module")
def narrow(tmp_path_factory: pytest.TempPathFactory) -> str:
    """A chip like loihi-sim with narrow registers."""
    document = yaml.safe_load(hw.chip("loihi-sim").document) | {"name": "narrow"}
    document["registers"] |= {
        "charge_bits": 13,
        "current_bits": 14,
        "voltage_bits": 16,
        "weight_bits_max": 4,
    }
    path = tmp_path_factory.mktemp("chip") / "narrow.yaml"
    path.write_text(yaml.safe_dump(document))
    return str(path)


def test_charges_that_wrap_wrap_in_training(
    tmp_path: Path, narrow: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    config = config_of("window-snn", target=narrow, weight_room=0.05, learning_rate=0.05)
    result = train(touches(), config)
    exported(tmp_path / "tuned.pt", result, config)
    assert compared(result.network, tmp_path / "tuned.pt", narrow) == (0, 0)
    chip = result.network.chip
    assert chip is not None
    assert [numbers.weight_bits for numbers in chip.populations.values()] == [4, 8]
    monkeypatch.setattr("locsnn_compile.models.chip_layers.OnIntegers", WithoutWraps)
    assert compared(result.network, tmp_path / "tuned.pt", narrow) != (0, 0)


@pytest.mark.slow
@pytest.mark.parametrize("model", ["window-snn", "hybrid-window"])
def test_planted_faults_are_seen(
    tmp_path: Path, model: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    config, path = config_of(model, weight_bits=4), tmp_path / "tuned.pt"
    result = train(touches(), config)
    found = exported(path, result, config)
    weight, bias = found.description.window_names
    for name, step in ((weight, 16), (bias, 1)):
        mantissas = found.weights[name].copy()
        mantissas.flat[0] += step if mantissas.flat[0] < 100 else -step
        replace(found, weights=found.weights | {name: mantissas}).save(path)
        spikes, scores = compared(result.network, path)
        assert spikes == 0
        assert scores > 0
    found.save(path)
    whole = networks.WindowNetwork.hidden
    monkeypatch.setattr(
        networks.WindowNetwork, "hidden", lambda self, x: whole(self, x.roll(1, dims=1))
    )
    assert compared(result.network, path)[0] > 0


def test_going_on_from_float_begins_where_it_was() -> None:
    config = config_of("window-snn", target="float", epochs=8)
    before = train(touches(), config).network
    start = Checkpoint(before.description, before.weights(), training={})
    tuned = config_of("window-snn", epochs=1, learning_rate=1e-9)
    network = train(touches(), tuned, start=start).network
    wanted, got = (class_scores(one, touches(30).spikes) for one in (before, network))
    assert np.abs(got - wanted).max() < 0.05 * np.ptp(wanted)
    assert network.chip is not None
    largest = float(np.abs(before.weights()["location_output"]).max())
    numbers = network.chip.populations["location_output"]
    assert largest < numbers.grid.high * numbers.unit < 1.3 * largest


@pytest.mark.slow
def test_both_engines_a_session_and_a_committee_agree(tmp_path: Path) -> None:
    loaded, alone = [], []
    for model, bits in (("hybrid-window", 8), ("window-snn", 4)):
        config = config_of(model, weight_bits=bits)
        exported(tmp_path / f"{model}.pt", result := train(touches(), config), config)
        loaded.append(lc.load(tmp_path / f"{model}.pt"))
        alone.append(class_scores(result.network.double(), touches(30).spikes))
    x = touches(30)
    compiled = lc.compile(loaded[0], events=x, diagnosis=False)
    assert compiled.report["match"]["spike_agreement"] == 1.0
    assert compiled.report["match"]["prediction_agreement"] == 1.0
    program = compiled.program
    whole, plain = (
        hw.simulate(program, x.spikes),
        hw.simulate(program, x.spikes, engine="reference"),
    )
    assert np.array_equal(whole.scores, plain.scores)  # type: ignore[arg-type]
    for one, scores in zip(x.spikes[:4], np.asarray(whole.scores), strict=False):
        assert np.array_equal(hw.Session(program).push(one).scores[-1], scores)
    both = hw.simulate(lc.compile(loaded, diagnosis=False).program, x.spikes)
    found, wanted = np.asarray(both.scores), sum(alone)
    assert np.corrcoef(found.ravel(), np.ravel(wanted))[0, 1] > 0.999999


def test_only_networks_that_learn_integers_have_them_in_their_file(tmp_path: Path) -> None:
    config = config_of("window-snn")
    exported(tmp_path / "tuned.pt", train(touches(), config), config)
    values = torch.load(tmp_path / "tuned.pt", weights_only=True)
    assert values["version"] == 3
    small = config_from_mapping(
        {"model": "hybrid-lif", "hidden": 4, "epochs": 1, "validation_fraction": 0.0}
    )
    exported(tmp_path / "lif.pt", train(touches(), small), small)
    torch.save(
        torch.load(tmp_path / "lif.pt", weights_only=True) | {"chip": values["chip"]},
        tmp_path / "lif.pt",
    )
    with pytest.raises(InputError) as caught:
        read_checkpoint(tmp_path / "lif.pt")
    assert str(caught.value) == (
        "checkpoint 'lif.pt': no 'hybrid-lif' is trained on a chip's integers. Write it again with 'locsnn train'."
    )
    del values["chip"]
    torch.save(values, tmp_path / "tuned.pt")
    with pytest.raises(InputError) as caught:
        read_checkpoint(tmp_path / "tuned.pt")
    assert str(caught.value) == (
        "checkpoint 'tuned.pt', population 'location_output': its weights are not dense float32 "
        "(got torch.int16, strided on cpu). Write it again with 'locsnn train'."
    )


def test_training_from_scratch_learns() -> None:
    config = config_of(
        "window-snn", epochs=20, weight_bits=4, validation_fraction=0.25, refit=False
    )
    result = train(touches(24), config)
    assert result.validation_accuracy is not None
    assert result.validation_accuracy >= 0.9


def test_weights_stay_in_their_range_and_pruned_ones_0() -> None:
    network = train(
        touches(), config_of("hybrid-window", weight_room=0.02, learning_rate=0.05, pruned=0.5)
    ).network
    found = network.mantissas()
    assert all(
        (held == 0).sum() >= held.size // 2
        for name, held in found.items()
        if not name.endswith("bias")
    )
    latent = network.weight("window_output").detach().abs().max()
    numbers = network.chip.populations["window_output"]  # type: ignore[union-attr]
    assert float(latent) <= numbers.grid.high * numbers.unit * (1 + 1e-6)
    assert int(np.abs(found["window_output"]).max()) == numbers.grid.high


def test_a_strategy_of_windows_alone_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    given = ["--model", "window-snn", "--target", "loihi-sim", "--strategy", "reset"]
    assert main(["train", "--data", "none.npz", *given, "-o", str(tmp_path / "x.pt")]) == 2
    assert capsys.readouterr().err == (
        "--strategy: it would change nothing: the network has no spike response neurons. Leave it out.\n"
    )
