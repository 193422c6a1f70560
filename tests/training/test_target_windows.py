"""Networks that count in windows, trained on the chip's integers, alone and next to the branches of a hybrid.

Spikes and scores of the compiled program must equal those in torch; planted faults must be seen by that comparison.
"""

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
    """Synthetic recordings of three classes."""
    return synthetic_touches(samples, steps=40, classes=3, seed=1)


def config_of(model: str, **options: object) -> TrainingConfig:
    """A short run of a network, with some options changed."""
    return config_from_mapping(
        {"model": model, "batch_size": 4, "target": "loihi-sim"} | WINDOWS | options
    )


def exported(path: Path, result: TrainingResult, config: TrainingConfig) -> Checkpoint:
    """Write the checkpoint of a run, and return it as read from the file."""
    export_checkpoint(path, result, config, touches(), test=None, carried=0)
    return read_checkpoint(path)


def compared(network: TouchModel, path: Path, target: str = "loihi-sim") -> tuple[int, int]:
    """Return in how many (spikes, scores) the network in torch and the program compiled from a file differ."""
    program = lc.compile(lc.load(path), target=target, diagnosis=False).program
    test = touches(30).spikes
    with torch.no_grad():
        activity = network.double()(torch.from_numpy(test.copy()).double())
        scores = class_scores(network, test)
    branch = network.description.structure.window_branch
    windows = network if isinstance(network, WindowNetwork) else network.get_submodule("windows")
    assert isinstance(windows, WindowNetwork)
    hidden_name = f"{branch}_hidden"
    hidden = windows.hidden(torch.from_numpy(test.copy()).double()).numpy()
    # The output of windows has potentials, which are compared as scores.
    torch_spikes = {
        name: spikes.numpy() for name, spikes in activity.items() if name != f"{branch}_output"
    }
    torch_spikes[hidden_name] = hidden[:, None]
    assert sum(int(spikes.sum()) for spikes in torch_spikes.values()) > 1000
    simulated = hw.simulate(program, test)
    # Hidden neurons of windows spike in step 1 of their phase, when the events have arrived.
    chip_spikes = dict(simulated.spikes)
    chip_spikes[hidden_name] = simulated.spikes[hidden_name][:, 1:2]
    differing_spikes = sum(
        int((chip_spikes[name] != spikes).sum()) for name, spikes in torch_spikes.items()
    )
    assert program.readout is not None
    assert network.chip is not None
    # A score of 1 in torch, in the units in which the chip adds scores: the weight of a spike, or for a network without
    # branches that spike, that of a potential of 1.
    weights = dict(zip(program.readout.populations, program.readout.weights, strict=True))
    scale = network.chip.populations[windows.names[0]].scale
    unit = weights.get("time_output", scale * weights[f"{branch}_output_1"])
    differing_scores = int((np.rint(scores * unit) != np.asarray(simulated.scores)).sum())
    return differing_spikes, differing_scores


@pytest.mark.slow
@pytest.mark.parametrize("bits", [8, 4, 2])
@pytest.mark.parametrize(
    ("model", "strategy"),
    [("window-snn", "dendrite"), ("hybrid-window", "dendrite"), ("hybrid-window", "reset")],
    ids=["windows", "hybrid-window", "hybrid-window, reset"],
)
def test_the_program_spikes_and_scores_like_the_network_in_torch(
    tmp_path: Path, model: str, strategy: str, bits: int
) -> None:
    options = {"weight_bits": bits} | ({"strategy": strategy} if model == "hybrid-window" else {})
    config = config_of(model, **options)
    result = train(touches(), config)
    checkpoint = exported(tmp_path / "tuned.pt", result, config)
    assert compared(result.network, tmp_path / "tuned.pt") == (0, 0)
    from_file = build_network(checkpoint.description, chip=checkpoint.chip)
    from_file.load_weights(checkpoint.float_weights)
    assert compared(from_file, tmp_path / "tuned.pt") == (0, 0)


@pytest.fixture(scope="module")
def narrow(tmp_path_factory: pytest.TempPathFactory) -> str:
    """The file of a chip like loihi-sim with narrow registers."""
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


def test_charges_that_wrap_on_the_chip_wrap_in_training(
    tmp_path: Path, narrow: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With an arithmetic that does not wrap, the comparison fails, so charges do wrap here."""
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
def test_the_comparison_sees_a_changed_weight_a_changed_bias_and_moved_events(
    tmp_path: Path, model: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    config = config_of(model, weight_bits=4)
    path = tmp_path / "tuned.pt"
    result = train(touches(), config)
    checkpoint = exported(path, result, config)
    weight, bias = checkpoint.description.window_names
    # One step of the grid: of 4 bits for a weight, of 8 bits for a bias.
    for name, step in ((weight, 16), (bias, 1)):
        mantissas = checkpoint.weights[name].copy()
        mantissas.flat[0] += step if mantissas.flat[0] < 100 else -step
        replace(checkpoint, weights=checkpoint.weights | {name: mantissas}).save(path)
        differing_spikes, differing_scores = compared(result.network, path)
        assert differing_spikes == 0
        assert differing_scores > 0
    checkpoint.save(path)
    hidden = networks.WindowNetwork.hidden
    monkeypatch.setattr(
        networks.WindowNetwork, "hidden", lambda self, x: hidden(self, x.roll(1, dims=1))
    )
    assert compared(result.network, path)[0] > 0


def test_a_run_on_integers_starts_with_about_the_scores_of_the_float_network() -> None:
    config = config_of("window-snn", target="float", epochs=8)
    in_floats = train(touches(), config).network
    start = Checkpoint(in_floats.description, in_floats.weights(), training={})
    tiny_rate = config_of("window-snn", epochs=1, learning_rate=1e-9)
    network = train(touches(), tiny_rate, start=start).network
    float_scores = class_scores(in_floats, touches(30).spikes)
    scores = class_scores(network, touches(30).spikes)
    assert np.abs(scores - float_scores).max() < 0.05 * np.ptp(float_scores)
    assert network.chip is not None
    largest = float(np.abs(in_floats.weights()["location_output"]).max())
    numbers = network.chip.populations["location_output"]
    # The range is weight_room times the largest weight, 1.25, and a little more because the scale is a whole number.
    assert largest < numbers.grid.high * numbers.unit < 1.3 * largest


@pytest.mark.slow
def test_both_engines_a_session_and_a_committee_agree(tmp_path: Path) -> None:
    members = []
    scores_of_members = []
    for model, bits in (("hybrid-window", 8), ("window-snn", 4)):
        config = config_of(model, weight_bits=bits)
        result = train(touches(), config)
        exported(tmp_path / f"{model}.pt", result, config)
        members.append(lc.load(tmp_path / f"{model}.pt"))
        scores_of_members.append(class_scores(result.network.double(), touches(30).spikes))
    x = touches(30)
    compiled = lc.compile(members[0], events=x, diagnosis=False)
    assert compiled.report["match"]["spike_agreement"] == 1.0
    assert compiled.report["match"]["prediction_agreement"] == 1.0
    program = compiled.program
    fast = hw.simulate(program, x.spikes)
    reference = hw.simulate(program, x.spikes, engine="reference")
    assert np.array_equal(fast.scores, reference.scores)  # type: ignore[arg-type]
    for recording, scores in zip(x.spikes[:4], np.asarray(fast.scores), strict=False):
        assert np.array_equal(hw.Session(program).push(recording).scores[-1], scores)
    committee = hw.simulate(lc.compile(members, diagnosis=False).program, x.spikes)
    # The committee adds the scores of its members, in another unit.
    added = np.ravel(sum(scores_of_members))
    assert np.corrcoef(np.asarray(committee.scores).ravel(), added)[0, 1] > 0.999999


def test_a_file_has_integers_if_and_only_if_its_network_learns_them(tmp_path: Path) -> None:
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


def test_weights_stay_in_the_range_of_their_format_and_pruned_ones_at_0() -> None:
    network = train(
        touches(), config_of("hybrid-window", weight_room=0.02, learning_rate=0.05, pruned=0.5)
    ).network
    mantissas = network.mantissas()
    for name, values in mantissas.items():
        if not name.endswith("bias"):
            assert (values == 0).sum() >= values.size // 2
    latent = network.weight("window_output").detach().abs().max()
    numbers = network.chip.populations["window_output"]  # type: ignore[union-attr]
    assert float(latent) <= numbers.grid.high * numbers.unit * (1 + 1e-6)
    assert int(np.abs(mantissas["window_output"]).max()) == numbers.grid.high


def test_a_network_of_windows_alone_takes_no_strategy(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    options = ["--model", "window-snn", "--target", "loihi-sim", "--strategy", "reset"]
    assert main(["train", "--data", "none.npz", *options, "-o", str(tmp_path / "x.pt")]) == 2
    assert capsys.readouterr().err == (
        "--strategy: it would change nothing: the network has no spike response neurons. Leave it out.\n"
    )
