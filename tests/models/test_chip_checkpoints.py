"""Checkpoints of networks trained on a chip's integers: they are read back equal, and every fault is named.

Such a file holds mantissas in place of float weights, and an entry ``chip`` with the registers, decays, thresholds and
synapses of each population. The neurons that it stands for are compared with neurons that are built by hand.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from locsnn_compile.data.orders import location_order
from locsnn_compile.data.sensor import neutouch
from locsnn_compile.errors import InputError
from locsnn_compile.models.checkpoint import Checkpoint
from locsnn_compile.models.checkpoint_reader import read_checkpoint
from locsnn_compile.models.chip_entry import ChipNumbers, ChipPopulation, RegisterWidths, chip_entry
from locsnn_compile.models.description import InputLayout, NetworkDescription
from locsnn_compile.models.networks import build_network
from locsnn_compile.network.chip_neurons import ChipCuba, ChipNeuron, ChipSrm

AGAIN = "Write it again with 'locsnn train'."
ORDER, TAXELS = location_order("loop", neutouch())
DESCRIPTION = NetworkDescription(
    "hybrid",
    InputLayout(neutouch(1), steps=12, step_seconds=0.02),
    classes=3,
    hidden=4,
    location_order=ORDER,
    location_taxels=TAXELS,
    name="small",
)
# The published neuron in the integers of loihi-sim. A potential of 1 is 41984.1 units of the registers, so theta, 10, is
# a threshold mantissa of 41984.1 * 10 / 64 = 6560. The decays of 390 and 2589, in 4096ths, are those of the time constants
# of 10 steps and of 1. A spike takes 205 * 2^6 * 64 units of charge from its own potential.
POPULATION = {"exponent": 1, "weight_bits": 4, "scale": 41984.1, "unit": 0.0125}


def chip_of(own_fields: dict[str, Any], strategy: str = "dendrite") -> ChipNumbers:
    """Numbers of a chip; ``own_fields`` are what differs by strategy.

    ``own`` in it are the synapses of a neuron to itself, each (mantissa, exponent, delay).
    """
    fields = own_fields | {"own": tuple(map(tuple, own_fields["own"]))}
    population = ChipPopulation(threshold=6560, decay=390, **fields, **POPULATION)
    return ChipNumbers(
        "loihi-sim",
        strategy,
        RegisterWidths(),
        dict.fromkeys(DESCRIPTION.weight_shapes, population),
    )


def with_dendrite(size: int) -> ChipSrm:
    """The published neuron with a refractory dendrite, built by hand."""
    return ChipSrm.with_taps(
        size, decay=390, threshold=6560, refractory_decay=2589, mantissa=-205, exponent=6
    )


DENDRITE = {"refractory_decay": 2589, "refractory": 1, "own": [[-205, 6, 0]]}
CHIP = chip_of(DENDRITE)


def save(path: Path, chip: ChipNumbers = CHIP) -> Path:
    """Save an untrained network on a chip's integers."""
    Checkpoint(DESCRIPTION, build_network(DESCRIPTION, chip=chip).mantissas(), chip=chip).save(path)
    return path


def test_mantissas_and_chip_are_read_back_equal(tmp_path: Path) -> None:
    checkpoint = read_checkpoint(save(tmp_path / "small.pt"))
    assert checkpoint.chip is not None
    assert chip_entry(checkpoint.chip) == chip_entry(CHIP)
    network = build_network(DESCRIPTION, chip=CHIP)
    for name, mantissas in network.mantissas().items():
        assert np.array_equal(checkpoint.weights[name], mantissas)
        assert not checkpoint.weights[name].flags.writeable
    # Float weights round to the same mantissas, in single and in double precision.
    network.load_weights(checkpoint.float_weights)
    assert all(
        np.array_equal(network.mantissas()[name], checkpoint.weights[name])
        for name in checkpoint.weights
    )
    network.double()
    assert all(
        np.array_equal(network.mantissas()[name], checkpoint.weights[name])
        for name in checkpoint.weights
    )


def with_taps(size: int) -> ChipSrm:
    """A neuron with 13 different synapses to itself, built by hand."""
    taps = np.arange(13)
    return ChipSrm.with_taps(
        size, decay=390, threshold=6560, delay=2 * taps, mantissa=taps - 100, exponent=taps - 5
    )


def with_reset(size: int) -> ChipCuba:
    """A neuron with the chip's own reset, built by hand."""
    return ChipCuba.of(size, decay_u=390, decay_v=390, threshold=6560, refractory=5)


@pytest.mark.parametrize(
    ("make", "strategy", "own_fields"),
    [
        pytest.param(
            with_dendrite,
            "dendrite",
            DENDRITE,
            id="dendrite",
        ),
        pytest.param(
            with_taps,
            "delay-line",
            {
                "refractory_decay": 0,
                "refractory": 1,
                "own": [[k - 100, k - 5, 2 * k] for k in range(13)],
            },
            id="delay-line",
        ),
        pytest.param(
            with_reset, "reset", {"refractory_decay": 0, "refractory": 5, "own": []}, id="reset"
        ),
    ],
)
def test_neurons_of_every_strategy_are_read_back(
    tmp_path: Path, make: Callable[[int], ChipNeuron], strategy: str, own_fields: dict[str, Any]
) -> None:
    """The file has the integers of one neuron of a population, under fixed keys; reading gives the whole population."""
    path = save(tmp_path / "small.pt", chip_of(own_fields, strategy))
    entry = torch.load(path, weights_only=True)["chip"]
    assert entry["strategy"] == strategy
    assert entry["populations"]["time_hidden"] == {
        "threshold": 6560,
        "decay": 390,
        **own_fields,
        **POPULATION,
    }
    chip = read_checkpoint(path).chip
    assert chip is not None
    for name, shape in DESCRIPTION.weight_shapes.items():
        by_hand = make(shape[0])
        neuron = chip.populations[name].neurons(strategy, shape[0])
        assert type(neuron) is type(by_hand)
        np.testing.assert_equal(vars_of(neuron), vars_of(by_hand))


def vars_of(neuron: Any) -> dict[str, Any]:
    """Every array of a neuron by name, including those of its refractory part."""
    return {
        name: vars(value) if hasattr(value, "__dict__") else value
        for name, value in vars(neuron).items()
    }


def put(*keys: Any, value: Any) -> Callable[[dict[Any, Any]], None]:
    """Return a function that sets an entry of a nested dict; ``keys`` lead to it from outside to inside."""

    def change(values: dict[Any, Any]) -> None:
        for key in keys[:-1]:
            values = values[key]
        values[keys[-1]] = value

    return change


HIDDEN = ("chip", "populations", "time_hidden")
PLACE = "chip.populations.time_hidden"


@pytest.mark.parametrize(
    ("change", "message"),
    [
        pytest.param(
            lambda v: v.pop("chip"), f": the key 'chip' is missing. {AGAIN}", id="no numbers"
        ),
        pytest.param(
            put("version", value=1), ": unknown key 'chip'. Choose one of: ", id="older version"
        ),
        pytest.param(
            put("chip", value={}),
            f": chip: the key 'target' is missing. {AGAIN}",
            id="empty",
        ),
        pytest.param(
            put("chip", "target", value=3),
            ": chip.target: it must be text that is a plain name (got 3). Put it in quotes.",
            id="target",
        ),
        pytest.param(
            put("chip", "strategy", value="fast"),
            ": chip.strategy: 'fast' is not known. Choose one of: delay-line, dendrite, reset.",
            id="strategy",
        ),
        pytest.param(
            put("chip", "registers", value={"charge_bits": 9}),
            f": chip.registers: the key 'current_bits' is missing. {AGAIN}",
            id="registers",
        ),
        pytest.param(
            put("chip", "registers", "current_bits", value=30),
            f": chip.registers.current_bits: it must be a whole number from 9 to 29 (got 30). {AGAIN}",
            id="widths",
        ),
        pytest.param(
            put(*HIDDEN, "decay", value=0),
            f": {PLACE}.decay: it must be a whole number from 1 to 4096 (got 0). {AGAIN}",
            id="decay",
        ),
        pytest.param(
            put(*HIDDEN, "threshold", value=True),
            f": {PLACE}.threshold: it must be a whole number from 0 to 16777215 (got True). {AGAIN}",
            id="no number",
        ),
        pytest.param(
            put(*HIDDEN, "weight_bits", value=7),
            f": {PLACE}.weight_bits: 7 is not known. Choose one of: 1, 2, 3, 4, 5, 6, 8.",
            id="weight bits",
        ),
        pytest.param(
            put(*HIDDEN, "unit", value=float("nan")),
            f": {PLACE}.unit: it must be a number above 0 (got nan). {AGAIN}",
            id="unit",
        ),
        pytest.param(
            put(*HIDDEN, "own", value=[[1, 2]]),
            f": {PLACE}.own: it must be a list of 3 (got 2). {AGAIN}",
            id="own synapses",
        ),
        pytest.param(
            put(*HIDDEN, "own", value=[[1, 2, 65_535]]),
            f": {PLACE}.own: it must be a whole number from 0 to 65534 (got 65535). {AGAIN}",
            id="delay",
        ),
        pytest.param(
            put(*HIDDEN, "own", value=[[1, 2, 3]] * 2),
            f": {PLACE}.own: it does not fit strategy 'dendrite' (2 synapses against 0..1). {AGAIN}",
            id="too many own synapses",
        ),
        pytest.param(
            put("weights", "time_hidden", value=torch.zeros(4, 78)),
            f", population 'time_hidden': its weights are not dense int16 (got torch.float32, strided on cpu). {AGAIN}",
            id="float weights",
        ),
        pytest.param(
            put("weights", "time_hidden", value=torch.full((4, 78), 5, dtype=torch.int16)),
            ", population 'time_hidden': mantissa [0, 0] is not on the grid of 4 bits (got 5, 312 such mantissas). "
            "Train the network again.",
            id="off the grid",
        ),
        pytest.param(
            put("weights", "time_hidden", value=torch.full((4, 78), -256, dtype=torch.int16)),
            ", population 'time_hidden': mantissa [0, 0] is not on the grid of 4 bits (got -256, 312 such mantissas). "
            "Train the network again.",
            id="too large",
        ),
    ],
)
def test_a_fault_in_the_file_is_named(
    tmp_path: Path, change: Callable[[dict[Any, Any]], None], message: str
) -> None:
    path = save(tmp_path / "small.pt")
    values = torch.load(path, weights_only=True)
    change(values)
    torch.save(values, path)
    with pytest.raises(InputError) as caught:
        read_checkpoint(path)
    if message.endswith(": "):  # the list of keys that follows is left out
        assert str(caught.value).startswith(f"checkpoint 'small.pt'{message}")
    else:
        assert str(caught.value) == f"checkpoint 'small.pt'{message}"


def test_only_mantissas_of_the_grid_are_written(tmp_path: Path) -> None:
    mantissas = {name: np.full(shape, 16) for name, shape in DESCRIPTION.weight_shapes.items()}
    mantissas["location_output"] = mantissas["location_output"] + 1
    with pytest.raises(InputError) as caught:
        Checkpoint(DESCRIPTION, mantissas, chip=CHIP).save(tmp_path / "small.pt")
    assert str(caught.value) == (
        "population 'location_output': mantissa [0, 0] is not on the grid of 4 bits (got 17, 12 such mantissas). "
        "Train the network again."
    )
