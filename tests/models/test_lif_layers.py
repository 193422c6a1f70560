"""Leaky integrate-and-fire layers against the recursion written out, and its gradient against torch's own."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from locsnn_compile.errors import InputError
from locsnn_compile.models.description import LifParameters
from locsnn_compile.models.lif import LifLayer, scan_spikes, spike, spike_of_spikes
from tests.support.drawn_layers import drawn

SEEDS = st.integers(0, 2**31)


def brute_scan(drive: np.ndarray, neuron: LifParameters) -> tuple[np.ndarray, np.ndarray]:
    """Sum what has arrived since the last own spike, each part with its own power of the decay: no recursion."""
    spikes, u = np.zeros_like(drive), np.zeros_like(drive)
    batch, steps, size = drive.shape
    for b, i in np.ndindex(batch, size):
        last = -1
        for t in range(steps):
            u[b, t, i] = sum(
                drive[b, s, i] * neuron.decay ** (t - 1 - s) for s in range(max(last, 0), t)
            )
            if u[b, t, i] > neuron.threshold:
                spikes[b, t, i], last = 1, t
    return spikes, u


@given(decay=st.floats(0.0, 1.0), threshold=st.floats(0.1, 3.0), seed=SEEDS)
@settings(max_examples=40, deadline=None)
def test_scan_equals_brute_force(decay: float, threshold: float, seed: int) -> None:
    neuron = LifParameters(decay, threshold)
    drive = np.random.default_rng(seed).normal(0.3, threshold, size=(2, 25, 3))
    spikes, u = scan_spikes(drive, neuron)
    expected_spikes, expected_u = brute_scan(drive, neuron)
    assert np.array_equal(spikes, expected_spikes)
    np.testing.assert_allclose(u, expected_u, rtol=1e-9, atol=1e-9)


def test_scan_fires_above_the_threshold_only() -> None:
    above = np.nextafter(0.5, 1.0)
    spikes, _ = scan_spikes(np.array([[[0.5, above], [0.0, 0.0]]]), LifParameters())
    assert spikes.tolist() == [[[0.0, 0.0], [0.0, 1.0]]]


def test_scan_keeps_single_precision_and_its_argument() -> None:
    drive = np.full((1, 4, 2), 0.4, dtype=np.float32)
    spikes, u = scan_spikes(drive, LifParameters())
    assert (spikes.dtype, u.dtype) == (np.float32, np.float32)
    assert (drive == np.float32(0.4)).all()


class Rectangle(torch.autograd.Function):
    """A spike whose derivative is a rectangle, as its authors write it."""

    @staticmethod
    def forward(ctx: object, u: torch.Tensor, threshold: float, window: float) -> torch.Tensor:
        ctx.save_for_backward(u)  # type: ignore[attr-defined]
        ctx.shape_of = (threshold, window)  # type: ignore[attr-defined]
        return (u > threshold).to(u.dtype)

    @staticmethod
    def backward(ctx: object, *grads: torch.Tensor) -> tuple[torch.Tensor, None, None]:
        (u,) = ctx.saved_tensors  # type: ignore[attr-defined]
        threshold, window = ctx.shape_of  # type: ignore[attr-defined]
        return grads[0] * ((u - threshold).abs() < window), None, None


def by_autograd(drive: torch.Tensor, neuron: LifParameters) -> torch.Tensor:
    """Return the spikes, step by step in torch, so that torch itself finds the gradient of the recursion."""
    u = o = torch.zeros_like(drive[:, 0])
    found = []
    for t in range(drive.shape[1]):
        arrived = drive[:, t - 1] if t else torch.zeros_like(u)
        u = neuron.decay * u * (1 - o) + arrived
        o = Rectangle.apply(u, neuron.threshold, neuron.window)  # type: ignore[no-untyped-call]
        found.append(o)
    return torch.stack(found, dim=1)


@pytest.mark.slow
@given(
    decay=st.floats(0.0, 1.0), threshold=st.floats(0.1, 3.0), window=st.floats(0.1, 3.0), seed=SEEDS
)
@settings(max_examples=40, deadline=None)
def test_gradient_is_that_of_the_recursion(
    decay: float, threshold: float, window: float, seed: int
) -> None:
    neuron = LifParameters(decay, threshold, window)
    generator = torch.Generator().manual_seed(seed)
    drive = torch.randn(2, 20, 3, generator=generator, dtype=torch.float64) * threshold + 0.3
    weight = torch.randn(2, 20, 3, generator=generator, dtype=torch.float64)
    ours, theirs = drive.clone().requires_grad_(), drive.clone().requires_grad_()
    fired, expected = spike(ours, neuron), by_autograd(theirs, neuron)
    assert torch.equal(fired, expected)
    (fired * weight).sum().backward()
    (expected * weight).sum().backward()
    assert ours.grad is not None
    assert theirs.grad is not None
    assert bool((theirs.grad[:, -1] == 0).all())
    np.testing.assert_allclose(ours.grad.numpy(), theirs.grad.numpy(), rtol=1e-9, atol=1e-12)


@pytest.mark.slow
@given(inputs=st.integers(1, 12), size=st.integers(1, 20), share=st.floats(0.0, 1.0), seed=SEEDS)
@settings(max_examples=40, deadline=None)
def test_adding_active_inputs_equals_a_matrix_product(
    inputs: int, size: int, share: float, seed: int
) -> None:
    rng, neuron = np.random.default_rng(seed), LifParameters()
    x = torch.from_numpy(
        (rng.random((2, inputs, 9)) < share) * rng.integers(1, 3, size=(2, inputs, 9)).astype(float)
    )
    weight, sent = (
        torch.from_numpy(rng.normal(size=(size, inputs))),
        torch.from_numpy(rng.normal(size=(2, 9, size))),
    )
    found = []
    for of_spikes in (True, False):
        # As they come in a network: both are views whose entries do not lie side by side.
        heard, by_input = x.clone().requires_grad_(), weight.clone().requires_grad_()
        rows, columns = heard.transpose(1, 2), by_input.T
        fired = (
            spike_of_spikes(rows, columns, neuron) if of_spikes else spike(rows @ columns, neuron)
        )
        (fired * sent).sum().backward()
        found.append((fired, heard.grad, by_input.grad))
    for ours, expected in zip(*found, strict=True):
        assert ours is not None
        assert expected is not None
        np.testing.assert_allclose(
            ours.detach().numpy(), expected.detach().numpy(), rtol=1e-9, atol=1e-11
        )


def test_a_large_layer_adds_active_inputs() -> None:
    layer = drawn(LifLayer(300, 64, LifParameters()), 3, 2.0).double()
    x = torch.from_numpy((np.random.default_rng(5).random((2, 12, 300)) < 0.1).astype(np.float64))
    spikes = layer(x)
    assert spikes.sum() > 10
    assert torch.equal(spikes, spike(x @ layer.weight.T, layer.neuron))


def test_layer_equals_brute_force() -> None:
    neuron = LifParameters()
    layer = drawn(LifLayer(6, 4, neuron), 3, 2.0).double()
    x = (np.random.default_rng(5).random((2, 20, 6)) < 0.3).astype(np.float64)
    spikes = layer(torch.from_numpy(x)).detach().numpy()
    expected = brute_scan(x @ layer.weight.detach().numpy().T, neuron)[0]
    assert expected.sum() > 10
    assert np.array_equal(spikes, expected)


def test_initial_weights_fill_their_bound() -> None:
    layer = drawn(LifLayer(100, 50, LifParameters()), 1, 2.0)
    largest = float(layer.weight.detach().abs().max())
    assert 0.95 * 2.0 / math.sqrt(100) < largest <= 2.0 / math.sqrt(100)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        pytest.param(
            {"decay": 1.5},
            "neuron 'decay': it must be a number from 0 to 1 (got 1.5). Correct it.",
            id="decay above 1",
        ),
        pytest.param(
            {"threshold": 0.0},
            "neuron 'threshold': it must be a number above 0 (got 0.0). Correct it.",
            id="threshold of 0",
        ),
        pytest.param(
            {"window": float("nan")},
            "neuron 'window': it must be a number above 0 (got nan). Correct it.",
            id="window NaN",
        ),
    ],
)
def test_parameters_that_do_not_hold(values: dict[str, float], message: str) -> None:
    with pytest.raises(InputError) as caught:
        LifParameters(**values)
    assert str(caught.value) == message
