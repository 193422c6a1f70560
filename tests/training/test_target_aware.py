"""Training on the chip's integers, from scratch and from a float network.

The program that is compiled from the result must spike exactly like the network in torch, on chips with any widths of
registers. Runs continue after an interruption, prune weights, save spikes, and refuse chips and recordings that do not
fit.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
import yaml

import hw_model as hw
from locsnn_compile.data.recordings import Recordings
from locsnn_compile.data.synthetic import synthetic_touches
from locsnn_compile.errors import InputError, TargetError
from locsnn_compile.frontends import load
from locsnn_compile.models.checkpoint import Checkpoint
from locsnn_compile.models.checkpoint_reader import read_checkpoint
from locsnn_compile.models.chip_entry import RegisterWidths
from locsnn_compile.models.networks import build_network
from locsnn_compile.pipeline import lower
from locsnn_compile.settings import TRAINABLE
from locsnn_compile.training.config import TrainingConfig
from locsnn_compile.training.describe import check_fits_start, fine_tuning_config
from locsnn_compile.training.export import export_checkpoint
from locsnn_compile.training.state import EpochRecord
from locsnn_compile.training.target import chip_numbers
from locsnn_compile.training.train import train

CHIP = hw.chip("loihi-sim")
FLOAT = TrainingConfig(
    hidden=8, epochs=6, batch_size=4, validation_fraction=0.25, learning_rate=0.01
)
ON_CHIP = replace(FLOAT, target="loihi-sim", epochs=3, validation_fraction=0.0)


def touches(samples: int = 12) -> Recordings:
    """Synthetic recordings of three classes."""
    return synthetic_touches(samples, steps=60, classes=3, seed=1)


@pytest.fixture(scope="module")
def start(tmp_path_factory: pytest.TempPathFactory) -> Checkpoint:
    """A network trained in floats, to start from."""
    path = tmp_path_factory.mktemp("start") / "start.pt"
    export_checkpoint(
        path, train(touches(), FLOAT, name="start"), FLOAT, touches(), test=None, carried=0
    )
    return read_checkpoint(path)


@pytest.mark.parametrize("strategy", TRAINABLE)
@pytest.mark.parametrize("bits", [8, 4])
def test_the_program_spikes_like_the_network_in_torch(
    tmp_path: Path, start: Checkpoint, strategy: str, bits: int
) -> None:
    check_program_spikes_alike(
        tmp_path, start, replace(ON_CHIP, strategy=strategy, weight_bits=bits), CHIP
    )


def check_program_spikes_alike(
    folder: Path, start: Checkpoint, config: TrainingConfig, chip: hw.Chip
) -> Checkpoint:
    """Train, export and compile a network, compare its spikes with the program's, and return the checkpoint."""
    result = train(touches(), config, name="tuned", start=start)
    path = folder / "tuned.pt"
    export_checkpoint(path, result, config, touches(), touches(), start=start)

    network = load(path)
    program = lower(network, chip, weight_bits=None).program
    test = touches(30).spikes
    with torch.no_grad():
        torch_spikes = result.network(torch.from_numpy(test.copy()).double())
    simulated = hw.simulate(program, test)
    assert sum(int(spikes.sum()) for spikes in torch_spikes.values()) > 1000
    for name, spikes in torch_spikes.items():
        assert np.array_equal(simulated.spikes[name], spikes.numpy()), name
    # The network of the file alone spikes the same, in single precision.
    checkpoint = read_checkpoint(path)
    from_file = build_network(result.network.description, chip=checkpoint.chip)
    from_file.load_weights(checkpoint.float_weights)
    with torch.no_grad():
        spikes_from_file = from_file(torch.from_numpy(test.copy()).float())
    for name, spikes in spikes_from_file.items():
        assert torch.equal(spikes.double(), torch_spikes[name])
    return checkpoint


@pytest.mark.slow
@pytest.mark.parametrize("strategy", TRAINABLE)
def test_training_from_scratch_learns(strategy: str) -> None:
    config = replace(ON_CHIP, strategy=strategy, epochs=30, validation_fraction=0.25)
    result = train(touches(24), replace(config, refit=False))
    assert result.validation_accuracy is not None
    assert result.validation_accuracy >= 0.9


def test_fine_tuning_starts_with_a_lower_loss_than_a_run_from_scratch(start: Checkpoint) -> None:
    config = replace(ON_CHIP, epochs=1)
    tuned = train(touches(), config, start=start)
    from_scratch = train(touches(), config)
    assert tuned.history[0].loss < from_scratch.history[0].loss


def test_a_network_on_the_chip_can_be_trained_further_with_fewer_bits(
    tmp_path: Path, start: Checkpoint
) -> None:
    """At a tiny learning rate, the mantissas are the same but for the rounding to the coarser grid."""
    first = train(touches(), ON_CHIP, start=start)
    export_checkpoint(tmp_path / "eight.pt", first, ON_CHIP, touches(), test=None, carried=0)
    eight = read_checkpoint(tmp_path / "eight.pt")
    config = replace(ON_CHIP, weight_bits=5, epochs=1, learning_rate=1e-9)
    step_of_five_bits = 8
    for name, mantissas in train(touches(), config, start=eight).network.mantissas().items():
        correlation = np.corrcoef(mantissas.ravel(), eight.weights[name].ravel())[0, 1]
        assert correlation > 0.99
        assert not (mantissas % step_of_five_bits).any()


class KilledError(Exception):
    """Stands for a run that is killed."""


def test_a_killed_run_continues_to_the_same_bits(tmp_path: Path, start: Checkpoint) -> None:
    config = replace(ON_CHIP, pruned=0.3, spike_cost=0.01)
    uninterrupted = train(touches(), config, start=start)

    def killer(done: int, expected: int, record: EpochRecord) -> None:
        if done > 1:
            raise KilledError

    state = tmp_path / "run.state"
    with pytest.raises(KilledError):
        train(touches(), config, start=start, state_path=state, save_every=1, progress=killer)
    resumed = train(touches(), config, start=start, state_path=state)
    assert uninterrupted.history == resumed.history
    resumed_mantissas = resumed.network.mantissas()
    for name, mantissas in uninterrupted.network.mantissas().items():
        assert np.array_equal(mantissas, resumed_mantissas[name])
    # Without ``start``, it is another run.
    with pytest.raises(InputError) as caught:
        train(touches(), config, state_path=state)
    assert str(caught.value) == (
        "training state 'run.state': it belongs to a run with other options or other data. "
        "Delete it, or train without --resume."
    )


def test_pruned_weights_stay_pruned(start: Checkpoint) -> None:
    share = 0.4
    network = train(touches(), replace(ON_CHIP, pruned=share), start=start).network
    for name, mantissas in network.mantissas().items():
        magnitudes = np.abs(start.float_weights[name])
        count = int(share * magnitudes.size)
        pruned = magnitudes < np.sort(magnitudes.ravel())[count]
        assert pruned.sum() == count
        assert not mantissas[pruned].any()


def test_a_cost_of_spikes_saves_spikes(start: Checkpoint) -> None:
    x = torch.from_numpy(touches().spikes.copy()).float()
    spikes = []
    for cost in (0.0, 0.3):
        network = train(
            touches(), replace(ON_CHIP, epochs=10, spike_cost=cost), start=start
        ).network
        with torch.no_grad():
            spikes.append(float(network(x)["time_hidden"].sum()))
    assert spikes[1] < 0.8 * spikes[0]


def test_the_format_holds_weights_larger_than_those_of_the_start_by_the_room(
    start: Checkpoint,
) -> None:
    for room in (0.5, 1.25, 4.0):
        numbers = chip_numbers(
            replace(ON_CHIP, weight_room=room), start.description, start.float_weights
        )
        for name, population in numbers.populations.items():
            largest = float(np.abs(start.float_weights[name]).max())
            assert population.grid.high * population.unit >= room * largest


def test_the_network_to_start_from_determines_these_options(start: Checkpoint) -> None:
    config = fine_tuning_config(
        TrainingConfig(hidden=99, theta=3.0, model="tactile-snn"), start.description
    )
    assert (config.hidden, config.theta, config.model, config.order) == (8, 10.0, "hybrid", "loop")
    check_fits_start({"hidden": 8, "epochs": 5}, start.description)
    with pytest.raises(InputError) as caught:
        check_fits_start({"hidden": 16}, start.description)
    assert str(caught.value) == (
        "training option 'hidden': the network to start from has another value (got 16 against 8). "
        "Leave the option out."
    )


@pytest.mark.parametrize(
    ("recordings", "message"),
    [
        pytest.param(
            Recordings(np.zeros((1, 61, 78)), np.zeros(1), None, "x.npy"),
            "recordings 'x.npy': their steps are not those of the network to start from (61 against 60). "
            "Give recordings like those that it was trained on.",
            id="steps",
        ),
        pytest.param(
            Recordings(np.zeros((1, 60, 156)), np.zeros(1), None, "x.npy"),
            "recordings 'x.npy': their channels are not those of the network to start from (156 against 78). "
            "Give recordings like those that it was trained on.",
            id="channels",
        ),
        pytest.param(
            Recordings(np.zeros((1, 60, 78)), np.full(1, 3), None, "x.npy"),
            "recordings 'x.npy': they have more classes than the network to start from (4 against 3). "
            "Give recordings like those that it was trained on.",
            id="classes",
        ),
    ],
)
def test_recordings_that_do_not_fit_the_network_to_start_from_are_refused(
    start: Checkpoint, recordings: Recordings, message: str
) -> None:
    with pytest.raises(InputError) as caught:
        train(recordings, ON_CHIP, start=start)
    assert str(caught.value) == message


def chip_file(folder: Path, **registers: int) -> str:
    """Write the file of a chip like loihi-sim with other registers, and return its name."""
    document = yaml.safe_load(hw.chip("loihi-sim").document) | {"name": "other"}
    document["registers"] |= registers
    path = folder / "other.yaml"
    path.write_text(yaml.safe_dump(document))
    return str(path)


def test_a_chip_with_registers_too_wide_for_training_is_refused(
    tmp_path: Path, start: Checkpoint
) -> None:
    target = chip_file(tmp_path, current_bits=30)
    with pytest.raises(TargetError) as caught:
        train(touches(), replace(ON_CHIP, target=target), start=start)
    assert str(caught.value) == (
        "target 'other': training does not support registers with such current_bits (30 against 9..29). "
        "Train for a chip of narrower registers."
    )


@pytest.mark.parametrize("strategy", ["dendrite", "delay-line"])
def test_strategies_that_join_compartments_are_refused_for_a_core_that_cannot(
    strategy: str,
) -> None:
    with pytest.raises(TargetError) as caught:
        train(touches(), replace(ON_CHIP, target="ice40up5k", strategy=strategy))
    assert str(caught.value) == (
        f"target 'ice40up5k': it joins no compartments, as strategy {strategy} does. Add strategy reset."
    )
    train(touches(), replace(ON_CHIP, target="ice40up5k", strategy="reset", epochs=1))


def test_training_follows_the_widths_of_the_chips_registers(
    tmp_path: Path, start: Checkpoint
) -> None:
    target = chip_file(tmp_path, charge_bits=15, current_bits=17, voltage_bits=16)
    trained = check_program_spikes_alike(
        tmp_path, start, replace(ON_CHIP, target=target), hw.chip(target)
    )
    assert trained.chip is not None
    assert trained.chip.registers == RegisterWidths(
        charge_bits=15, current_bits=17, voltage_bits=16
    )


@pytest.mark.parametrize("strategy", TRAINABLE)
def test_training_for_few_weight_bits_and_narrow_voltages(
    tmp_path: Path, start: Checkpoint, strategy: str
) -> None:
    """Exponents of weights are below 0, so that the few bits are those to which the register is sensitive."""
    target = chip_file(tmp_path, voltage_bits=16, weight_bits_max=4, delay_max=20)
    config = replace(ON_CHIP, target=target, strategy=strategy, epochs=1)
    trained = check_program_spikes_alike(tmp_path, start, config, hw.chip(target))
    assert trained.chip is not None
    assert {numbers.weight_bits for numbers in trained.chip.populations.values()} == {4}
    assert min(numbers.exponent for numbers in trained.chip.populations.values()) < 0


@pytest.mark.parametrize(
    ("options", "registers", "message"),
    [
        (
            {"refractory": 9},
            {"refractory_max": 7},
            "target 'other': the refractory count is longer than the chip holds (9 against refractory_max 7). Shorten it.",
        ),
        (
            {"delays": "0 20"},
            {"delay_max": 10},
            "target 'other': a delay is longer than the chip holds (20 against delay_max 10). Shorten it.",
        ),
    ],
    ids=["refractory", "delays"],
)
def test_delays_and_refractory_steps_beyond_the_limits_of_the_chip_are_refused(
    tmp_path: Path, options: dict[str, Any], registers: dict[str, int], message: str
) -> None:
    target = chip_file(tmp_path, **registers)
    with pytest.raises(TargetError) as caught:
        train(touches(), replace(ON_CHIP, target=target, strategy="reset", **options))
    assert str(caught.value) == message
