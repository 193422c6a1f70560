"""Leaky integrate-and-fire layers against sums without a recursion, and their gradient against torch's autograd."""

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
    """Return (spikes, u) without a recursion: u sums the drives since the last spike, each times a power of the decay."""
    spikes, u = np.zeros_like(drive), np.zeros_like(drive)
    batch, steps, size = drive.shape
    for b, i in np.ndindex(batch, size):
        last = -1
        for t in range(steps):
            u[b, t, i] = sum(
                drive[b, s, i] * neuron.decay ** (t - 1 - s) for s in range(max(last, 0), t)
            )
            if u[b, t, i] > neuron.threshold:
                spikes[b, t, i] = 1
                last = t
    return spikes, u


@given(decay=st.floats(0.0, 1.0), threshold=st.floats(0.1, 3.0), seed=SEEDS)
@settings(max_examples=40, deadline=None)
def test_scan_equals_brute_force(decay: float, threshold: float, seed: int) -> None:
    neuron = LifParameters(decay, threshold)
    drive = np.random.default_rng(seed).normal(0.3, threshold, size=(2, 25, 3))
    spikes, u = scan_spikes(drive, neuron)
    expected_spikes, expected_u = brute_scan(drive, neuron)
    assert np.array_equal(spikes, expected_spikes)
    np.testing.assert_allclose(u, expected_u, rtol=1e-9, atol=1e-9)  # other powers of the decay


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
    """A spike whose derivative is a rectangle, as Wu et al. 2018 define it."""

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
    """Return the spikes, computed step by step in torch, so that autograd finds the gradient of the recursion."""
    u = torch.zeros_like(drive[:, 0])
    o = torch.zeros_like(u)
    spikes = []
    for t in range(drive.shape[1]):
        arrived = drive[:, t - 1] if t else torch.zeros_like(u)
        u = neuron.decay * u * (1 - o) + arrived
        o = Rectangle.apply(u, neuron.threshold, neuron.window)  # type: ignore[no-untyped-call]
        spikes.append(o)
    return torch.stack(spikes, dim=1)


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
    # Equal but for rounding in float64.
    np.testing.assert_allclose(ours.grad.numpy(), theirs.grad.numpy(), rtol=1e-9, atol=1e-12)


@pytest.mark.slow
@given(inputs=st.integers(1, 12), size=st.integers(1, 20), share=st.floats(0.0, 1.0), seed=SEEDS)
@settings(max_examples=40, deadline=None)
def test_adding_active_inputs_equals_a_matrix_product(
    inputs: int, size: int, share: float, seed: int
) -> None:
    samples, steps = 2, 9
    rng = np.random.default_rng(seed)
    neuron = LifParameters()
    is_active = rng.random((samples, inputs, steps)) < share
    counts = rng.integers(1, 3, size=(samples, inputs, steps)).astype(float)
    x = torch.from_numpy(is_active * counts)
    weight = torch.from_numpy(rng.normal(size=(size, inputs)))
    # The loss is a random linear function of the spikes.
    loss_weights = torch.from_numpy(rng.normal(size=(samples, steps, size)))

    def spikes_and_gradients(adds_active: bool) -> tuple[torch.Tensor, ...]:
        # As in a network, input and weights are views whose entries do not lie side by side.
        own_x, own_weight = x.clone().requires_grad_(), weight.clone().requires_grad_()
        rows, columns = own_x.transpose(1, 2), own_weight.T
        if adds_active:
            spikes = spike_of_spikes(rows, columns, neuron)
        else:
            spikes = spike(rows @ columns, neuron)
        (spikes * loss_weights).sum().backward()
        assert own_x.grad is not None
        assert own_weight.grad is not None
        return spikes, own_x.grad, own_weight.grad

    ours, expected = spikes_and_gradients(adds_active=True), spikes_and_gradients(adds_active=False)
    # Equal but for the order of the sums in float64.
    for our_values, expected_values in zip(ours, expected, strict=True):
        np.testing.assert_allclose(
            our_values.detach().numpy(), expected_values.detach().numpy(), rtol=1e-9, atol=1e-11
        )


def test_a_layer_large_enough_to_add_active_inputs_spikes_like_the_product() -> None:
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
def test_constants_out_of_range_are_refused(values: dict[str, float], message: str) -> None:
    with pytest.raises(InputError) as caught:
        LifParameters(**values)
    assert str(caught.value) == message
