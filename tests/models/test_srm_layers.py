"""Spike response layers against sums of kernels, spike by spike, and their gradient against torch's autograd."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from locsnn_compile.models.description import NeuronParameters
from locsnn_compile.models.srm import SRMLayer, respond, transpose_recording
from locsnn_compile.network.neurons import alpha_recursion
from tests.support.drawn_layers import drawn

TAUS = st.floats(0.5, 30.0)
LAST_LAG = 30
"""Kernels are compared up to this lag, in steps."""


def nu(neuron: NeuronParameters, lag: int) -> float:
    """The refractory kernel: the response to an own spike ``lag`` steps ago."""
    ratio = lag / neuron.tau_ref
    return -neuron.scale_ref * neuron.theta * ratio * math.exp(1 - ratio)


def eps(tau: float, lag: int) -> float:
    """The response to an input spike ``lag`` steps ago."""
    return (lag / tau) * math.exp(1 - lag / tau)


def brute_response(drive: np.ndarray, neuron: NeuronParameters) -> tuple[np.ndarray, np.ndarray]:
    """Return (spikes, u) without a recursion: eps summed over earlier drives, and nu over earlier own spikes."""
    spikes, u = np.zeros_like(drive), np.zeros_like(drive)
    batch, steps, size = drive.shape
    for b in range(batch):
        for i in range(size):
            fired: list[int] = []
            for t in range(steps):
                u[b, t, i] = sum(eps(neuron.tau_sr, t - s) * drive[b, s, i] for s in range(t))
                u[b, t, i] += sum(nu(neuron, t - s) for s in fired)
                if u[b, t, i] >= neuron.theta:
                    fired.append(t)
                    spikes[b, t, i] = 1
    return spikes, u


@given(tau=TAUS)
@settings(max_examples=30, deadline=None)
def test_the_recursion_of_the_response_is_its_kernel(tau: float) -> None:
    decay, gain = alpha_recursion(tau)
    # The kernel has its maximum, 1, at a lag of tau.
    assert gain * tau * decay ** (tau - 1) == pytest.approx(1.0, rel=1e-12)
    for lag in range(1, LAST_LAG):
        assert gain * lag * decay ** (lag - 1) == pytest.approx(eps(tau, lag), rel=1e-12)


@given(tau=TAUS, scale=st.floats(0.0, 5.0))
@settings(max_examples=30, deadline=None)
def test_the_refractory_recursion_is_its_kernel(tau: float, scale: float) -> None:
    neuron = NeuronParameters(tau_ref=tau, scale_ref=scale)
    decay, gain = alpha_recursion(neuron.tau_ref, -neuron.scale_ref * neuron.theta)
    for lag in range(1, LAST_LAG):
        assert gain * lag * decay ** (lag - 1) == pytest.approx(
            nu(neuron, lag), rel=1e-12, abs=1e-300
        )


@given(
    tau=TAUS,
    tau_ref=TAUS,
    scale=st.floats(0.0, 4.0),
    theta=st.floats(0.5, 20.0),
    seed=st.integers(0, 2**32 - 1),
)
@settings(max_examples=40, deadline=None)
def test_response_equals_brute_force(
    tau: float, tau_ref: float, scale: float, theta: float, seed: int
) -> None:
    neuron = NeuronParameters(theta=theta, tau_sr=tau, tau_ref=tau_ref, scale_ref=scale)
    drive = np.random.default_rng(seed).normal(theta / 4, theta, size=(2, 25, 3))
    spikes, u = respond(drive.copy(), neuron)
    expected_spikes, expected_u = brute_response(drive, neuron)
    assert np.array_equal(spikes, expected_spikes)
    np.testing.assert_allclose(u, expected_u, rtol=1e-9, atol=1e-9 * theta)


def test_neurons_fire_at_the_threshold_itself() -> None:
    neuron = NeuronParameters(tau_sr=1.0, scale_ref=0.0)
    _, gain = alpha_recursion(1.0)
    exact = neuron.theta / gain
    assert gain * exact == neuron.theta
    drive = np.array([[[exact, np.nextafter(exact, 0.0)], [0.0, 0.0]]])
    assert respond(drive, neuron)[0].tolist() == [[[0.0, 0.0], [1.0, 0.0]]]


def test_response_keeps_single_precision() -> None:
    drive = np.full((1, 4, 2), 12.0, dtype=np.float32)
    spikes, u = respond(drive, NeuronParameters())
    assert (spikes.dtype, u.dtype) == (np.float32, np.float32)


class Surrogate(torch.autograd.Function):
    """A step forward; scale_rho / (tau_rho theta) * exp(-|u - theta| / (tau_rho theta)) backward."""

    @staticmethod
    def forward(ctx: Any, u: torch.Tensor, neuron: NeuronParameters) -> torch.Tensor:
        ctx.save_for_backward(u)
        ctx.neuron = neuron
        return (u >= neuron.theta).to(u.dtype)

    @staticmethod
    def backward(ctx: Any, *grads: torch.Tensor) -> tuple[torch.Tensor, None]:
        (u,), neuron = ctx.saved_tensors, ctx.neuron
        width = neuron.tau_rho * neuron.theta
        return grads[0] * neuron.scale_rho / width * torch.exp(
            -(u - neuron.theta).abs() / width
        ), None


def stepped(drive: torch.Tensor, neuron: NeuronParameters) -> torch.Tensor:
    """Return the spikes of the recursive form in plain torch, so that autograd finds all gradients but the surrogate's.

    As in SLAYER, no gradient passes through the refractory terms: these get detached spikes.
    """
    a, b = math.exp(-1 / neuron.tau_sr), math.exp(-1 / neuron.tau_ref)
    gain = math.e * a / neuron.tau_sr
    pull_gain = -neuron.scale_ref * neuron.theta * math.e * b / neuron.tau_ref
    current, potential, charge, pull = (torch.zeros_like(drive[:, 0]) for _ in range(4))
    spikes = []
    for t in range(drive.shape[1]):
        potential = a * potential + current
        pull = b * pull + charge
        fired = Surrogate.apply(gain * potential + pull_gain * pull, neuron)
        current = a * current + drive[:, t]
        charge = b * charge + fired.detach()
        spikes.append(fired)
    return torch.stack(spikes, dim=1)


@given(
    tau=TAUS, theta=st.floats(1.0, 20.0), tau_rho=st.floats(0.1, 3.0), scale_rho=st.floats(0.1, 3.0),
    seed=st.integers(0, 2**31),
)  # fmt: skip
@settings(max_examples=30, deadline=None)
def test_gradient_is_that_of_the_recursion_by_autograd(
    tau: float, theta: float, tau_rho: float, scale_rho: float, seed: int
) -> None:
    neuron = NeuronParameters(theta=theta, tau_sr=tau, tau_rho=tau_rho, scale_rho=scale_rho)
    generator = torch.Generator().manual_seed(seed)
    ours = (
        torch.randn(2, 20, 3, generator=generator, dtype=torch.float64) * theta
    ).requires_grad_()
    theirs = ours.detach().clone().requires_grad_()
    weight = torch.randn(2, 20, 3, generator=generator, dtype=torch.float64)
    layer = SRMLayer(3, 3, neuron).double()
    layer.weight.data.copy_(torch.eye(3))
    (layer(ours) * weight).sum().backward()
    (stepped(theirs, neuron) * weight).sum().backward()
    assert ours.grad is not None
    assert theirs.grad is not None
    assert theirs.grad.abs().max() > 0
    np.testing.assert_allclose(ours.grad.numpy(), theirs.grad.numpy(), rtol=1e-9, atol=1e-12)


def test_gradients_of_two_layers_are_those_of_the_recursion_by_autograd() -> None:
    neuron = NeuronParameters()
    generator = torch.Generator().manual_seed(11)
    layers = [
        drawn(SRMLayer(*shape, neuron), generator, 40.0).double() for shape in ((5, 6), (6, 4))
    ]
    x = (torch.rand(3, 30, 5, generator=generator) < 0.3).double()
    # The loss is a random linear function of the spikes.
    loss_weights = torch.randn(3, 30, 4, generator=generator, dtype=torch.float64)
    spikes = layers[1](layers[0](x))
    (spikes * loss_weights).sum().backward()
    weights = [layer.weight.detach().clone().requires_grad_() for layer in layers]
    expected = stepped(stepped(x @ weights[0].T, neuron) @ weights[1].T, neuron)
    (expected * loss_weights).sum().backward()
    assert 10 < spikes.sum() == expected.sum()
    for layer, weight in zip(layers, weights, strict=True):
        assert layer.weight.grad is not None
        assert weight.grad is not None
        np.testing.assert_allclose(
            layer.weight.grad.numpy(), weight.grad.numpy(), rtol=1e-9, atol=1e-12
        )


def test_the_gradient_of_spike_counts_of_a_transposed_recording() -> None:
    """The input is a view that is not contiguous, and the gradient is the same in all steps: both have a path of their own."""
    neuron = NeuronParameters()
    generator = torch.Generator().manual_seed(5)
    layer = drawn(SRMLayer(7, 4, neuron), generator, 40.0).double()
    x = (torch.rand(3, 7, 30, generator=generator) < 0.3).double().transpose(1, 2)
    loss_weights = torch.randn(3, 4, generator=generator, dtype=torch.float64)
    counts = layer(x).sum(dim=1)
    (counts * loss_weights).sum().backward()
    weight = layer.weight.detach().clone().requires_grad_()
    (stepped(x @ weight.T, neuron).sum(dim=1) * loss_weights).sum().backward()
    assert counts.sum() > 10
    assert layer.weight.grad is not None
    assert weight.grad is not None
    np.testing.assert_allclose(
        layer.weight.grad.numpy(), weight.grad.numpy(), rtol=1e-9, atol=1e-12
    )


def brute_layer(x: np.ndarray, weight: np.ndarray, neuron: NeuronParameters) -> np.ndarray:
    """Return the spikes of a layer, given input spikes x (batch, steps, inputs), by :func:`brute_response`."""
    drive = np.zeros((*x.shape[:2], len(weight)))
    for b, s, j in np.argwhere(x):
        drive[b, s] += weight[:, j]
    return brute_response(drive, neuron)[0]


def test_layer_equals_brute_force() -> None:
    neuron = NeuronParameters()
    generator = torch.Generator().manual_seed(3)
    layer = drawn(SRMLayer(6, 4, neuron), generator, 10.0).double()
    x = np.random.default_rng(5).random((2, 20, 6)) < 0.3
    spikes = layer(torch.from_numpy(x.astype(np.float64))).detach().numpy()
    expected = brute_layer(x, layer.weight.detach().numpy(), neuron)
    assert expected.sum() > 10
    assert np.array_equal(spikes, expected)


def test_layer_takes_input_that_is_not_contiguous() -> None:
    layer = drawn(SRMLayer(20, 3, NeuronParameters()), 1)
    x = (torch.rand(2, 20, 6, generator=torch.Generator().manual_seed(2)) < 0.4).float()
    transposed = x.transpose(1, 2)
    assert not transposed.is_contiguous()
    assert torch.equal(layer(transposed), layer(transposed.contiguous()))


@given(
    samples=st.integers(1, 3),
    steps=st.integers(1, 6),
    channels=st.integers(1, 8),
    seed=st.integers(0, 2**31),
)
@settings(max_examples=25, deadline=None)
def test_location_l_of_a_transposed_recording_is_channel_l_of_the_walk(
    samples: int, steps: int, channels: int, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    x = rng.random((samples, steps, channels))
    walk = rng.permutation(channels)
    transposed = transpose_recording(torch.from_numpy(x), torch.from_numpy(walk)).numpy()
    for b, location, t in np.ndindex(samples, channels, steps):
        assert transposed[b, location, t] == x[b, t, walk[location]]
