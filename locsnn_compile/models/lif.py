"""Leaky integrate-and-fire layers in torch: sums of weights as a matrix product, the steps as one compiled scan.

What step t - 1 sends arrives at step t, as on the chip and as ``eps(0) = 0`` has it for spike response neurons:

    u(t) = decay * u(t - 1) * (1 - o(t - 1)) + sum over j of w_ij x_j(t - 1),      o(t) = 1 where u(t) > threshold

The published form takes ``x_j(t)`` and so runs one step earlier a layer; nothing else differs. Backward: the exact
gradient of this recursion with a rectangle for the derivative of a spike by u, 1 where |u - threshold| < window and
else 0 (Wu et al. 2018, as in TactileSGNet).
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from hw_model.compiled import compiled
from locsnn_compile.models.description import LifParameters
from locsnn_compile.models.spike_product import spike_product

_WORTH_LISTING = 1 << 14
"""Weights of a layer from which on adding those of active inputs takes less time than a matrix product."""


@compiled
def _scan(
    drive: NDArray[Any], constants: tuple[Any, ...], potential: NDArray[Any], spikes: NDArray[Any]
) -> None:  # pragma: no cover - compiled
    keep, threshold, zero, one = constants
    batch, steps, size = drive.shape
    voltage, silence = np.empty(size, drive.dtype), np.zeros(size, drive.dtype)
    for b in range(batch):
        voltage[:] = zero
        for t in range(steps):
            arrived = drive[b, t - 1] if t else silence
            for i in range(size):
                u = keep * voltage[i] + arrived[i]
                fired = u > threshold
                potential[b, t, i] = u
                spikes[b, t, i] = one if fired else zero
                voltage[i] = zero if fired else u


@compiled
def _scan_back(
    gradient: NDArray[Any],
    potential: NDArray[Any],
    constants: tuple[Any, ...],
    found: NDArray[Any],
) -> None:  # pragma: no cover - compiled
    keep, threshold, window, zero = constants
    batch, steps, size = gradient.shape
    by_u = np.empty(size, gradient.dtype)
    for b in range(batch):
        by_u[:] = zero
        for t in range(steps - 1, -1, -1):
            for i in range(size):
                found[b, t, i] = by_u[i]
                u, later = potential[b, t, i], keep * by_u[i]
                by_spike = gradient[b, t, i] - u * later
                carried = zero if u > threshold else later
                by_u[i] = carried + (by_spike if abs(u - threshold) < window else zero)


def scan_spikes(drive: NDArray[Any], neuron: LifParameters) -> tuple[NDArray[Any], NDArray[Any]]:
    """Return (spikes, u), both (batch, steps, n), of the weights that each step's inputs add up to, ``drive``.

    In the drive's own float type; u is taken before the reset.
    """
    drive = np.ascontiguousarray(drive)
    kind = drive.dtype.type
    potential, spikes = np.empty_like(drive), np.empty_like(drive)
    _scan(drive, (kind(neuron.keep), kind(neuron.threshold), kind(0), kind(1)), potential, spikes)
    return spikes, potential


class _Spike(torch.autograd.Function):
    """With g the gradient by o(t), and D(t) that by u(t), all of its effects taken in:

    D(t) = (g(t) - decay * u(t) * D(t + 1)) * rectangle(u(t)) + decay * (1 - o(t)) * D(t + 1)
    and the gradient by what step t sends is D(t + 1).
    """

    @staticmethod
    def forward(ctx: Any, drive: Tensor, neuron: LifParameters) -> Tensor:
        spikes, u = scan_spikes(drive.detach().numpy(), neuron)
        ctx.neuron, ctx.u = neuron, u
        return torch.from_numpy(spikes)

    @staticmethod
    def backward(ctx: Any, *grads: Tensor) -> tuple[Tensor, None]:
        neuron: LifParameters = ctx.neuron
        gradient = np.ascontiguousarray(grads[0].numpy())
        kind = gradient.dtype.type
        found = np.empty_like(gradient)
        constants = (kind(neuron.keep), kind(neuron.threshold), kind(neuron.window), kind(0))
        _scan_back(gradient, ctx.u, constants, found)
        return torch.from_numpy(found), None


def spike(drive: Tensor, neuron: LifParameters) -> Tensor:
    """Return the spikes (0 or 1) of a drive (batch, steps, n), differentiable as above."""
    spikes: Tensor = _Spike.apply(drive, neuron)  # type: ignore[no-untyped-call]
    return spikes


class LifLayer(nn.Module):
    """A fully connected layer of these neurons, recurring over the middle axis of its input.

    Input (batch, steps, in_features), output (batch, steps, out_features); ``weight`` [out, in], no bias. Weights start
    uniform within +-``initial_scale`` / sqrt(inputs).
    """

    def __init__(
        self,
        in_features: int,
        out_features: int,
        neuron: LifParameters,
        *,
        generator: torch.Generator,
        initial_scale: float,
    ) -> None:
        super().__init__()
        self.neuron = neuron
        self.weight = uniform_weight((out_features, in_features), in_features, initial_scale, generator)

    def forward(self, x: Tensor) -> Tensor:
        """Return the spikes of this layer for spikes ``x``."""
        weight = self.weight.T
        drive = spike_product(x, weight) if self.weight.numel() >= _WORTH_LISTING else torch.matmul(x, weight)
        return spike(drive, self.neuron)


class TLIF(LifLayer):
    """Leaky integrate-and-fire neurons whose steps are time steps; their inputs are channels."""


class LLIF(LifLayer):
    """Leaky integrate-and-fire neurons whose steps are locations; the first layer's inputs are time steps."""


def uniform_weight(
    shape: tuple[int, ...], inputs: int, initial_scale: float, generator: torch.Generator
) -> nn.Parameter:
    """Return weights that are uniform within +-``initial_scale`` / sqrt(inputs), float32."""
    bound = initial_scale / math.sqrt(inputs)
    return nn.Parameter(torch.empty(*shape, dtype=torch.float32).uniform_(-bound, bound, generator=generator))
