"""Operations of torch modules, against the closed formulas of the published networks and against sums by hand."""

from __future__ import annotations

from math import prod

import pytest
import torch
from torch import nn

from locsnn_compile.baselines.operations import ann_counts
from locsnn_compile.data.sensor import neutouch
from locsnn_compile.errors import InputError
from locsnn_compile.models.description import InputLayout, NetworkDescription
from locsnn_compile.models.networks import build_network
from locsnn_compile.models.operation_counter import count_operations


def network(name: str, fingertips: int, steps: int, classes: int) -> nn.Module:
    """An untrained network with 32 hidden units."""
    layout = InputLayout(neutouch(fingertips), steps=steps, step_seconds=0.02)
    return build_network(NetworkDescription(name, layout, classes=classes, hidden=32))


@pytest.mark.parametrize("name", ["cnn-3d", "gru-mlp"])
@pytest.mark.parametrize(
    ("fingertips", "steps", "classes"),
    [
        pytest.param(1, 250, 36, id="Ev-Objects"),
        pytest.param(1, 23, 2, id="the fewest steps of cnn-3d"),
        pytest.param(3, 60, 5, id="three fingertips"),
        pytest.param(2, 325, 36, id="VT_SNN's objects"),
        pytest.param(2, 150, 2, id="VT_SNN's slips"),
    ],
)
def test_counting_module_by_module_gives_the_formula(
    name: str, fingertips: int, steps: int, classes: int
) -> None:
    sensor = neutouch(fingertips)
    example = torch.zeros(1, steps, sensor.channels)
    counts = count_operations(network(name, fingertips, steps, classes), example)
    assert counts == ann_counts(name, sensor=sensor, steps=steps, classes=classes)


@pytest.mark.parametrize(
    ("module", "shape", "macs"),
    [
        pytest.param(nn.Linear(5, 3), (1, 5), 15, id="linear"),
        pytest.param(nn.Linear(5, 3, bias=False), (1, 4, 5), 60, id="linear at every step"),
        pytest.param(
            nn.Conv1d(4, 6, 3, groups=2), (1, 4, 10), 8 * 6 * 2 * 3, id="grouped convolution"
        ),
        pytest.param(
            nn.Conv2d(2, 3, (3, 5), stride=2, padding=1), (1, 2, 9, 11), 5 * 5 * 3 * 2 * 15, id="2d"
        ),
        pytest.param(
            nn.Sequential(nn.Linear(5, 3), nn.ReLU(), nn.Linear(3, 2)), (1, 5), 21, id="layers"
        ),
        pytest.param(
            nn.Sequential(nn.Flatten(), nn.Dropout(), nn.MaxPool1d(2)),
            (1, 4, 5),
            0,
            id="no product",
        ),
    ],
)
def test_every_product_with_a_weight_is_counted(
    module: nn.Module, shape: tuple[int, ...], macs: int
) -> None:
    counts = count_operations(module, torch.zeros(shape))
    assert (counts.macs, counts.multiplications, counts.additions) == (macs, macs, macs)


def test_a_layer_called_twice_counts_twice() -> None:
    layer = nn.Linear(4, 4)
    assert count_operations(nn.Sequential(layer, nn.ReLU(), layer), torch.zeros(1, 4)).macs == 32


@pytest.mark.parametrize(
    ("module", "gates", "products", "sums"),
    [(nn.RNN, 1, 0, 0), (nn.GRU, 3, 3, 1), (nn.LSTM, 4, 3, 1)],
    ids=["rnn", "gru", "lstm"],
)
@pytest.mark.parametrize("bias", [True, False], ids=["biases", "no biases"])
def test_recurrent_cells_count_gates_products_and_sums(
    module: type[nn.RNNBase], gates: int, products: int, sums: int, bias: bool
) -> None:
    steps, inputs, hidden = 7, 5, 3
    cell = module(inputs, hidden, batch_first=True, bias=bias)
    # In one step, every element of the weight matrices is multiplied once.
    products_with_weights = steps * sum(prod(p.shape) for p in cell.parameters() if p.ndim == 2)
    counts = count_operations(cell, torch.zeros(1, steps, inputs))
    assert counts.macs == products_with_weights
    assert counts.multiplications == products_with_weights + steps * products * hidden
    biases = 2 if bias else 0
    assert (
        counts.additions == products_with_weights + steps * (gates * (1 + biases) + sums) * hidden
    )


def test_all_layers_and_directions_of_a_recurrent_network_are_counted() -> None:
    steps, inputs, hidden = 7, 5, 3
    gru = nn.GRU(inputs, hidden, num_layers=2, bidirectional=True, batch_first=True)
    products_with_weights = steps * sum(prod(p.shape) for p in gru.parameters() if p.ndim == 2)
    assert count_operations(gru, torch.zeros(1, steps, inputs)).macs == products_with_weights


def test_counting_leaves_the_network_as_it_was() -> None:
    module = nn.Sequential(nn.Linear(5, 3), nn.Dropout())
    count_operations(module, torch.zeros(1, 5))
    assert module.training
    assert not module[0]._forward_hooks


class Scaled(nn.Module):
    """A module with a weight of its own around another module."""

    def __init__(self) -> None:
        super().__init__()
        self.scale = nn.Parameter(torch.ones(1))
        self.inner = nn.Linear(2, 2)


KINDS = (
    "Linear, Conv1d, Conv2d, Conv3d, RNN, GRU, LSTM, ReLU, Sigmoid, Tanh, Identity, Flatten, Unflatten, Dropout, "
    "Dropout1d, Dropout2d, Dropout3d, MaxPool1d, MaxPool2d, MaxPool3d"
)


@pytest.mark.parametrize(
    ("module", "where", "kind"),
    [
        pytest.param(nn.BatchNorm1d(3), "'BatchNorm1d'", "BatchNorm1d", id="alone"),
        pytest.param(nn.Sequential(nn.ReLU(), nn.Softmax(dim=1)), "'1'", "Softmax", id="inside"),
        pytest.param(nn.LSTM(5, 3, proj_size=2), "'LSTM'", "LSTM", id="projected state"),
        pytest.param(nn.Sequential(Scaled()), "'0'", "Scaled", id="weights beside modules"),
    ],
)
def test_unknown_kinds_of_modules_are_refused(module: nn.Module, where: str, kind: str) -> None:
    with pytest.raises(InputError) as caught:
        count_operations(module, torch.zeros(1, 3))
    assert str(caught.value) == (
        f"module {where}: operations of a {kind} are not known. Use modules of these kinds: {KINDS}."
    )


def test_spiking_networks_are_refused() -> None:
    spiking = network("tactile-snn-lif", fingertips=1, steps=30, classes=2)
    with pytest.raises(InputError) as caught:
        count_operations(spiking, torch.zeros(1, 30, neutouch(1).channels))
    assert str(caught.value).startswith(
        "module 'time_hidden': operations of a LifLayer are not known."
    )
