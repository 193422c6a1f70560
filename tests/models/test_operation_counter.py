"""Operations of torch modules: the published integers, and sums over every product written out."""

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
    layout = InputLayout(neutouch(fingertips), steps=steps, step_seconds=0.02)
    return build_network(NetworkDescription(name, layout, classes=classes, hidden=32))


@pytest.mark.parametrize("name", ["cnn-3d", "gru-mlp"])
@pytest.mark.parametrize(
    ("fingertips", "steps", "classes"),
    [(1, 250, 36), (1, 23, 2), (3, 60, 5), (2, 325, 36), (2, 150, 2)],
)
def test_counting_modules_is_the_formula(
    name: str, fingertips: int, steps: int, classes: int
) -> None:
    counts = count_operations(
        network(name, fingertips, steps, classes), torch.zeros(1, steps, 78 * fingertips)
    )
    assert counts == ann_counts(name, sensor=neutouch(fingertips), steps=steps, classes=classes)


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
def test_products_with_weights(module: nn.Module, shape: tuple[int, ...], macs: int) -> None:
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
def test_recurrent_cells(
    module: type[nn.RNNBase], gates: int, products: int, sums: int, bias: bool
) -> None:
    steps, inputs, hidden = 7, 5, 3
    one = module(inputs, hidden, batch_first=True, bias=bias)
    # All products with weights of one step are the elements of its matrices.
    products_with_weights = steps * sum(prod(p.shape) for p in one.parameters() if p.ndim == 2)
    counts = count_operations(one, torch.zeros(1, steps, inputs))
    assert counts.macs == products_with_weights
    assert counts.multiplications == products_with_weights + steps * products * hidden
    biases = 2 if bias else 0
    assert (
        counts.additions == products_with_weights + steps * (gates * (1 + biases) + sums) * hidden
    )


def test_layers_and_directions_of_a_recurrent_network() -> None:
    both = nn.GRU(5, 3, num_layers=2, bidirectional=True, batch_first=True)
    products_with_weights = 7 * sum(prod(p.shape) for p in both.parameters() if p.ndim == 2)
    assert count_operations(both, torch.zeros(1, 7, 5)).macs == products_with_weights


def test_the_network_stays_as_it_was() -> None:
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
def test_kinds_that_are_not_known(module: nn.Module, where: str, kind: str) -> None:
    with pytest.raises(InputError) as caught:
        count_operations(module, torch.zeros(1, 3))
    assert str(caught.value) == (
        f"module {where}: operations of a {kind} are not known. Use modules of these kinds: {KINDS}."
    )


def test_spiking_networks_are_not_counted_so() -> None:
    spiking = network("tactile-snn-lif", 1, 30, 2)
    with pytest.raises(InputError) as caught:
        count_operations(spiking, torch.zeros(1, 30, 78))
    assert str(caught.value).startswith(
        "module 'time_hidden': operations of a LifLayer are not known."
    )
