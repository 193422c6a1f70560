"""Spike response layers in torch: sums of weights as a matrix product, potentials and spikes as one compiled scan.

Both kernels run in their recursive form, k * a^(k - 1) as two first-order filters in a row, with their whole tails:

    psp(t) = gain * sum over s < t of (t - s) a^(t - s - 1) drive(s),   u = psp + refractory terms,   spike = u >= theta

Backward: SLAYER's surrogate (Shrestha and Orchard 2018) with u after the refractory terms, then the same filter
backwards in time. As in SLAYER, no gradient goes through the refractory terms.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from hw_model.compiled import compiled
from locsnn_compile.models.description import NeuronParameters
from locsnn_compile.models.kernels import psp_recursion, refractory_recursion

#: Weights start uniform in +-INITIAL_SCALE / sqrt(inputs). SLAYER's dense layers start at 10; on validation
#: recordings of Ev-Objects 3 did better (accuracy 0.88 against 0.85, two seeds), and still makes threshold 10 fire.
INITIAL_SCALE = 3.0


@compiled
def _respond(
    drive: NDArray[Any], constants: tuple[Any, ...], potential: NDArray[Any], spikes: NDArray[Any]
) -> None:  # pragma: no cover - compiled
    # Zero and one travel as constants of the drive's type: literals would make the loop compute in float64.
    theta, decay, gain, pull_decay, pull_gain, zero, one = constants
    batch, steps, size = drive.shape
    current, response = np.empty(size, drive.dtype), np.empty(size, drive.dtype)
    charge, pull = np.empty(size, drive.dtype), np.empty(size, drive.dtype)
    for b in range(batch):
        current[:] = zero
        response[:] = zero
        charge[:] = zero
        pull[:] = zero
        for t in range(steps):
            for i in range(size):
                response[i] = decay * response[i] + current[i]
                pull[i] = pull_decay * pull[i] + charge[i]
                u = gain * response[i] + pull_gain * pull[i]
                spike = one if u >= theta else zero
                current[i] = decay * current[i] + drive[b, t, i]
                charge[i] = pull_decay * charge[i] + spike
                potential[b, t, i] = u
                spikes[b, t, i] = spike


@compiled
def _respond_back(
    by_potential: NDArray[Any], constants: tuple[Any, ...], by_drive: NDArray[Any]
) -> None:  # pragma: no cover - compiled
    decay, gain, zero = constants
    batch, steps, size = by_potential.shape
    current, response = np.empty(size, by_drive.dtype), np.empty(size, by_drive.dtype)
    for b in range(batch):
        current[:] = zero
        response[:] = zero
        for t in range(steps - 1, -1, -1):
            for i in range(size):
                response[i] = decay * response[i] + current[i]
                current[i] = decay * current[i] + by_potential[b, t, i]
                by_drive[b, t, i] = gain * response[i]


def respond(drive: NDArray[Any], neuron: NeuronParameters) -> tuple[NDArray[Any], NDArray[Any]]:
    """Return (spikes, u), both (batch, steps, n), of the weights that each step's spikes add up to, ``drive``.

    In the drive's own float type. u(t) = psp(t) + gain * r(t), where r sums k * decay^(k - 1) over own past spikes (see
    :func:`refractory_recursion`); a spike (1) where u(t) >= theta.
    """
    drive = np.ascontiguousarray(drive)
    kind = drive.dtype.type
    values = (neuron.theta, *psp_recursion(neuron.tau_sr), *refractory_recursion(neuron), 0, 1)
    potential, spikes = np.empty_like(drive), np.empty_like(drive)
    _respond(drive, tuple(kind(value) for value in values), potential, spikes)
    return spikes, potential


class _Response(torch.autograd.Function):
    """grad_u = grad_spikes * scale_rho / (tau_rho theta) * exp(-|u - theta| / (tau_rho theta)); grad_drive is the
    psp's filter of grad_u, backwards in time.
    """

    @staticmethod
    def forward(ctx: Any, drive: Tensor, neuron: NeuronParameters) -> Tensor:
        spikes, u = respond(drive.detach().numpy(), neuron)
        ctx.neuron, ctx.u = neuron, u
        return torch.from_numpy(spikes)

    @staticmethod
    def backward(ctx: Any, *grads: Tensor) -> tuple[Tensor, None]:
        neuron: NeuronParameters = ctx.neuron
        width = neuron.tau_rho * neuron.theta
        slope = (torch.from_numpy(ctx.u) - neuron.theta).abs_().mul_(-1.0 / width).exp_()
        by_potential = slope.mul_(grads[0]).numpy()
        kind = by_potential.dtype.type
        decay, gain = psp_recursion(neuron.tau_sr)
        by_drive = np.empty_like(by_potential)
        _respond_back(by_potential, (kind(decay), kind(gain * neuron.scale_rho / width), kind(0)), by_drive)
        return torch.from_numpy(by_drive), None


def response(drive: Tensor, neuron: NeuronParameters) -> Tensor:
    """Return the spikes (0 or 1) of a drive (batch, steps, n), differentiable by the surrogate above."""
    spikes: Tensor = _Response.apply(drive, neuron)  # type: ignore[no-untyped-call]
    return spikes


class SRMLayer(nn.Module):
    """A fully connected layer of spike response neurons that recur over the middle axis of its input.

    u_i(t) = sum over own past spikes nu(t - t_f) + sum over j, t_j of w_ij eps(t - t_j); a spike where u_i >=
    theta. Input (batch, steps, in_features), output (batch, steps, out_features); ``weight`` [out, in], no
    bias.
    """

    def __init__(
        self,
        in_features: int,
        out_features: int,
        neuron: NeuronParameters,
        *,
        generator: torch.Generator,
        initial_scale: float = INITIAL_SCALE,
    ) -> None:
        super().__init__()
        self.neuron = neuron
        bound = initial_scale / math.sqrt(in_features)
        weight = torch.empty(out_features, in_features, dtype=torch.float32)
        self.weight = nn.Parameter(weight.uniform_(-bound, bound, generator=generator))

    def forward(self, x: Tensor) -> Tensor:
        """Return the spikes of this layer for spikes ``x``."""
        if x.is_contiguous():
            return response(torch.matmul(x, self.weight.T), self.neuron)
        # One product a recording takes a transposed recording as it lies; a single product would copy it first.
        return response(torch.bmm(x, self.weight.T.expand(len(x), -1, -1)), self.neuron)


class TSRM(SRMLayer):
    """Spike response neurons whose steps are time steps; their inputs are channels."""


class LSRM(SRMLayer):
    """Spike response neurons whose steps are locations; the first layer's inputs are time steps.

    See :func:`transpose_recording` for the input of the first layer of a location branch.
    """


def transpose_recording(x: Tensor, walk: Tensor) -> Tensor:
    """Return (batch, locations, steps) from x (batch, steps, channels): location l is channel ``walk[l]``."""
    return x.transpose(1, 2).index_select(1, walk)
