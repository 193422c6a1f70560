"""GRU-MLP and CNN-3D against their equations written out in numpy, and the frames on which a fingertip's taxels lie."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from scipy.optimize import linear_sum_assignment

from locsnn_compile.data.sensor import (
    FRAME_OF_TAXELS,
    TAXEL_COORDINATES_MM,
    SensorLayout,
    frame_cells,
    neutouch,
)
from locsnn_compile.errors import InputError
from locsnn_compile.models.ann import Cnn3d
from locsnn_compile.models.description import InputLayout, NetworkDescription
from locsnn_compile.models.networks import build_network

FINGERTIP_CHANNELS = 78  # 39 taxels with two polarities
HIDDEN = 7


def description(architecture: str, fingertips: int = 1, steps: int = 30) -> NetworkDescription:
    """An artificial network of an architecture, on fingertips."""
    layout = InputLayout(neutouch(fingertips), steps=steps, step_seconds=0.02)
    return NetworkDescription(architecture, layout, classes=5, hidden=HIDDEN)


def recording(fingertips: int = 1, samples: int = 3, steps: int = 30) -> torch.Tensor:
    """Random recordings (samples, steps, channels), as floats of 0 and 1."""
    generator = torch.Generator().manual_seed(11)
    channels = FINGERTIP_CHANNELS * fingertips
    return (torch.rand(samples, steps, channels, generator=generator) < 0.15).float()


def sigmoid(x: np.ndarray) -> np.ndarray:
    return 1 / (1 + np.exp(-x))


@pytest.mark.parametrize("fingertips", [1, 2])
def test_gru_mlp_computes_its_equations(fingertips: int) -> None:
    """With r, z and n the gates of torch's GRU: h = (1 - z) n + z h, n = tanh(n_in + r n_h)."""
    network = build_network(description("gru-mlp", fingertips), seed=3).double()
    x = recording(fingertips).double()
    p = {name: value.detach().numpy() for name, value in network.named_parameters()}
    h = np.zeros((len(x), HIDDEN))
    for t in range(x.shape[1]):
        r_in, z_in, n_in = np.split(
            x[:, t].numpy() @ p["gru.weight_ih_l0"].T + p["gru.bias_ih_l0"], 3, axis=1
        )
        r_h, z_h, n_h = np.split(h @ p["gru.weight_hh_l0"].T + p["gru.bias_hh_l0"], 3, axis=1)
        z, n = sigmoid(z_in + z_h), np.tanh(n_in + sigmoid(r_in + r_h) * n_h)
        h = (1 - z) * n + z * h
    np.testing.assert_allclose(
        network.counts(x).detach().numpy(), h @ p["readout.weight"].T + p["readout.bias"]
    )


def convolved(
    x: np.ndarray, weight: np.ndarray, bias: np.ndarray, stride: tuple[int, ...]
) -> np.ndarray:
    """Return ReLU of a convolution of x (channels, steps, rows, columns), output by output."""
    kernel = weight.shape[2:]
    size = [(n - k) // s + 1 for n, k, s in zip(x.shape[1:], kernel, stride, strict=True)]
    output = np.zeros((len(weight), *size))
    for at in np.ndindex(*size):
        window = tuple(slice(i * s, i * s + k) for i, s, k in zip(at, stride, kernel, strict=True))
        output[(slice(None), *at)] = np.tensordot(weight, x[(slice(None), *window)], axes=4) + bias
    return np.maximum(output, 0)


def test_cnn_3d_computes_its_equations() -> None:
    network = build_network(description("cnn-3d", 2), seed=3).double()
    x = recording(2, samples=1).double()
    p = {name: value.detach().numpy() for name, value in network.named_parameters()}
    features = []
    for fingertip in range(2):
        frames = np.zeros((2, 30, 9, 7))  # polarities, steps, rows and columns of the frame
        for row, column in np.ndindex(9, 7):
            taxel = FRAME_OF_TAXELS[row][column]
            if taxel:
                first = FINGERTIP_CHANNELS * fingertip + 2 * (taxel - 1)
                frames[:, :, row, column] = x[0, :, first : first + 2].numpy().T
        first_layer = convolved(frames, p["conv_1.weight"], p["conv_1.bias"], (4, 1, 1))
        features.append(
            convolved(first_layer, p["conv_2.weight"], p["conv_2.bias"], (3, 1, 1)).ravel()
        )
    expected = p["readout.weight"] @ np.concatenate(features) + p["readout.bias"]
    np.testing.assert_allclose(network.counts(x).detach().numpy()[0], expected)


def test_a_seed_gives_the_same_weights_and_does_not_touch_torchs_generator() -> None:
    torch.manual_seed(5)
    before = torch.get_rng_state()
    first, again, other = (
        build_network(description("cnn-3d"), seed=seed).weights() for seed in (1, 1, 2)
    )
    assert torch.equal(torch.get_rng_state(), before)
    assert all(np.array_equal(first[name], again[name]) for name in first)
    assert not np.array_equal(first["conv_1.weight"], other["conv_1.weight"])


@pytest.mark.parametrize("architecture", ["gru-mlp", "cnn-3d"])
def test_parameters_have_the_described_names_and_shapes(architecture: str) -> None:
    network = build_network(description(architecture, 2))
    assert {
        name: tuple(p.shape) for name, p in network.named_parameters()
    } == network.description.weight_shapes
    assert network.hidden_spikes(network(recording(2))) == []


def test_the_cells_of_taxels_have_the_least_sum_of_squared_distances() -> None:
    """Against scipy's solution of the assignment; the frame spans the taxels' positions in millimetres."""
    rows, columns = np.linspace(-8.9, 8.9, 9), np.linspace(-6, 6, 7)
    cells = np.array([(x, y) for y in rows for x in columns])
    distance = ((np.array(TAXEL_COORDINATES_MM)[:, None] - cells) ** 2).sum(axis=2)
    least = distance[linear_sum_assignment(distance)].sum()
    assert distance[np.arange(39), frame_cells(neutouch())].sum() == pytest.approx(least, rel=1e-12)
    assert len(set(frame_cells(neutouch()).tolist())) == 39


def test_recordings_that_are_too_short_for_the_convolutions_are_refused() -> None:
    with pytest.raises(InputError) as caught:
        Cnn3d(description("cnn-3d", steps=22))
    assert str(caught.value) == (
        "network 'cnn-3d': the recording is too short for its two convolutions (22 steps against at least 23). "
        "Use longer recordings."
    )


def test_a_sensor_without_a_grid_has_no_frames() -> None:
    layout = InputLayout(SensorLayout("12 channels", taxels=12), steps=30, step_seconds=0.02)
    with pytest.raises(InputError) as caught:
        NetworkDescription("cnn-3d", layout, classes=5)
    assert str(caught.value) == (
        "network 'cnn-3d': its frames need a grid of at least 5 x 5 taxels (sensor '12 channels'). "
        "Give --grid WxH of the sensor, or use another network."
    )
