"""The spike response layers against brute force: kernel sums written out, spike by spike."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from locsnn_compile.models.description import NeuronParameters
from locsnn_compile.models.kernels import alpha_kernel, psp_matrix, refractory_recursion
from locsnn_compile.models.srm import LSRM, TSRM, scan_spikes, spike, transpose_recording

TAUS = st.floats(0.5, 30.0)


def nu(neuron: NeuronParameters, lag: int) -> float:
    ratio = lag / neuron.tau_ref
    return -neuron.scale_ref * neuron.theta * ratio * math.exp(1 - ratio)


def eps(tau: float, lag: int) -> float:
    return (lag / tau) * math.exp(1 - lag / tau)


def brute_scan(psp: np.ndarray, neuron: NeuronParameters) -> tuple[np.ndarray, np.ndarray]:
    """Sum nu over every own past spike, with no recursion."""
    spikes, u = np.zeros_like(psp), np.zeros_like(psp)
    batch, steps, size = psp.shape
    for b in range(batch):
        for i in range(size):
            fired: list[int] = []
            for t in range(steps):
                u[b, t, i] = psp[b, t, i] + sum(nu(neuron, t - s) for s in fired)
                if u[b, t, i] >= neuron.theta:
                    fired.append(t)
                    spikes[b, t, i] = 1
    return spikes, u


@pytest.mark.parametrize(
    ("tau", "lag", "value"),
    [
        pytest.param(10.0, 0, 0.0, id="zero at its start"),
        pytest.param(10.0, 10, 1.0, id="one at tau"),
        pytest.param(10.0, 1, 0.1 * math.exp(0.9), id="first step"),
        pytest.param(1.0, 3, 3 * math.exp(-2), id="tail"),
    ],
)
def test_alpha_kernel_values(tau: float, lag: int, value: float) -> None:
    assert alpha_kernel(tau, 20)[lag] == pytest.approx(value, rel=1e-15)


@given(tau=TAUS, steps=st.integers(1, 40), seed=st.integers(0, 2**32 - 1))
@settings(max_examples=30, deadline=None)
def test_psp_matrix_is_the_kernel_sum(tau: float, steps: int, seed: int) -> None:
    drive = np.random.default_rng(seed).normal(size=steps)
    brute = [sum(eps(tau, t - s) * drive[s] for s in range(t + 1)) for t in range(steps)]
    np.testing.assert_allclose(psp_matrix(tau, steps) @ drive, brute, rtol=1e-12, atol=1e-12)


@given(tau=TAUS, scale=st.floats(0.0, 5.0))
@settings(max_examples=30, deadline=None)
def test_refractory_recursion_is_the_kernel(tau: float, scale: float) -> None:
    neuron = NeuronParameters(tau_ref=tau, scale_ref=scale)
    decay, gain = refractory_recursion(neuron)
    for lag in range(1, 30):
        assert gain * lag * decay ** (lag - 1) == pytest.approx(nu(neuron, lag), rel=1e-12, abs=1e-300)


@given(tau=TAUS, scale=st.floats(0.0, 4.0), theta=st.floats(0.5, 20.0), seed=st.integers(0, 2**32 - 1))
@settings(max_examples=40, deadline=None)
def test_scan_equals_brute_force(tau: float, scale: float, theta: float, seed: int) -> None:
    neuron = NeuronParameters(theta=theta, tau_ref=tau, scale_ref=scale)
    psp = np.random.default_rng(seed).normal(theta, 2 * theta, size=(2, 25, 3))
    spikes, u = scan_spikes(psp, neuron)
    expected_spikes, expected_u = brute_scan(psp, neuron)
    assert np.array_equal(spikes, expected_spikes)
    np.testing.assert_allclose(u, expected_u, rtol=1e-9, atol=1e-9 * theta)


def test_scan_fires_at_the_threshold_itself() -> None:
    below = np.nextafter(10.0, 0.0)
    spikes, _ = scan_spikes(np.array([[[10.0, below]]]), NeuronParameters())
    assert spikes.tolist() == [[[1.0, 0.0]]]


def test_scan_keeps_single_precision_and_its_argument() -> None:
    psp = np.full((1, 4, 2), 12.0, dtype=np.float32)
    spikes, u = scan_spikes(psp, NeuronParameters())
    assert (spikes.dtype, u.dtype) == (np.float32, np.float32)
    assert (psp == 12.0).all()


@given(
    theta=st.floats(1.0, 20.0), tau_rho=st.floats(0.1, 3.0), scale_rho=st.floats(0.1, 3.0), seed=st.integers(0, 2**31)
)
@settings(max_examples=30, deadline=None)
def test_surrogate_gradient_is_slayers(theta: float, tau_rho: float, scale_rho: float, seed: int) -> None:
    neuron = NeuronParameters(theta=theta, tau_rho=tau_rho, scale_rho=scale_rho)
    generator = torch.Generator().manual_seed(seed)
    psp = (torch.randn(2, 12, 3, generator=generator, dtype=torch.float64) * theta).requires_grad_()
    weight = torch.randn(2, 12, 3, generator=generator, dtype=torch.float64)
    (spike(psp, neuron) * weight).sum().backward()
    _, u = brute_scan(psp.detach().numpy(), neuron)
    width = tau_rho * theta
    expected = scale_rho / width * np.exp(-np.abs(u - theta) / width) * weight.numpy()
    assert psp.grad is not None
    np.testing.assert_allclose(psp.grad.numpy(), expected, rtol=1e-9, atol=1e-12)


def brute_layer(x: np.ndarray, weight: np.ndarray, neuron: NeuronParameters) -> np.ndarray:
    """Every input spike through the kernel, one by one."""
    batch, steps, inputs = x.shape
    psp = np.zeros((batch, steps, len(weight)))
    for b in range(batch):
        for s in range(steps):
            for j in range(inputs):
                if x[b, s, j]:
                    for t in range(s, steps):
                        psp[b, t] += weight[:, j] * eps(neuron.tau_sr, t - s)
    return brute_scan(psp, neuron)[0]


@pytest.mark.parametrize("kind", [TSRM, LSRM])
def test_layer_equals_brute_force(kind: type[TSRM] | type[LSRM]) -> None:
    neuron = NeuronParameters()
    generator = torch.Generator().manual_seed(3)
    layer = kind(6, 4, 20, neuron, generator=generator, initial_scale=10.0).double()
    x = np.random.default_rng(5).random((2, 20, 6)) < 0.3
    spikes = layer(torch.from_numpy(x.astype(np.float64))).detach().numpy()
    expected = brute_layer(x, layer.weight.detach().numpy(), neuron)
    assert expected.sum() > 10
    assert np.array_equal(spikes, expected)


def test_double_uses_the_kernel_in_full_precision() -> None:
    layer = TSRM(3, 2, 15, NeuronParameters(), generator=torch.Generator().manual_seed(0))
    assert layer.psp.dtype == torch.float32
    assert np.array_equal(torch.nn.Sequential(layer).double()[0].psp.numpy(), psp_matrix(10.0, 15))


def test_layer_takes_input_that_is_not_contiguous() -> None:
    layer = LSRM(20, 3, 6, NeuronParameters(), generator=torch.Generator().manual_seed(1))
    x = (torch.rand(2, 20, 6, generator=torch.Generator().manual_seed(2)) < 0.4).float()
    turned = x.transpose(1, 2)
    assert not turned.is_contiguous()
    assert torch.equal(layer(turned), layer(turned.contiguous()))


@given(samples=st.integers(1, 3), steps=st.integers(1, 6), channels=st.integers(1, 8), seed=st.integers(0, 2**31))
@settings(max_examples=25, deadline=None)
def test_transposed_recording_is_the_walk(samples: int, steps: int, channels: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    x, walk = rng.random((samples, steps, channels)), rng.permutation(channels)
    turned = transpose_recording(torch.from_numpy(x), torch.from_numpy(walk)).numpy()
    for b, location, t in np.ndindex(samples, channels, steps):
        assert turned[b, location, t] == x[b, t, walk[location]]
