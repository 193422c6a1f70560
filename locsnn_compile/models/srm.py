"""Spike response layers in torch: the psp as a matrix product, the spikes as one compiled scan.

Forward: psp = M (x W^T) with M from :func:`psp_matrix`; then, step by step, u = psp + refractory terms and a
spike where u >= theta. Backward: SLAYER's surrogate (Shrestha and Orchard 2018), with u after the refractory
terms.
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
from locsnn_compile.models.kernels import psp_matrix, refractory_recursion

#: Weights start uniform in +-INITIAL_SCALE / sqrt(inputs). SLAYER's dense layers start at 10; on validation
#: recordings of Ev-Objects 3 did better (accuracy 0.88 against 0.85, two seeds), and still makes threshold 10 fire.
INITIAL_SCALE = 3.0


@compiled
def _scan(
    potential: NDArray[Any],
    spikes: NDArray[Any],
    charge: NDArray[Any],
    pull: NDArray[Any],
    constants: tuple[Any, ...],
) -> None:  # pragma: no cover - compiled
    theta, decay, gain, zero, one = constants
    batch, steps, size = potential.shape
    for b in range(batch):
        charge[:] = zero
        pull[:] = zero
        for t in range(steps):
            for i in range(size):
                pull[i] = decay * pull[i] + charge[i]
                u = potential[b, t, i] + gain * pull[i]
                spike = one if u >= theta else zero
                charge[i] = decay * charge[i] + spike
                potential[b, t, i] = u
                spikes[b, t, i] = spike


def scan_spikes(psp: NDArray[Any], neuron: NeuronParameters) -> tuple[NDArray[Any], NDArray[Any]]:
    """Return (spikes, u) of postsynaptic potentials ``psp`` (batch, steps, n), in its own float type.

    Per neuron, with r = sum over own past spikes of k * decay^(k - 1) kept in two state variables
    (see :func:`refractory_recursion`): u(t) = psp(t) + gain * r(t); a spike (1) where u(t) >= theta.
    """
    u = np.array(psp, order="C", copy=True)
    spikes = np.empty_like(u)
    decay, gain = refractory_recursion(neuron)
    # Zero and one travel as constants of u's type: literals would make the compiled loop compute in float64.
    constants = (
        u.dtype.type(neuron.theta),
        u.dtype.type(decay),
        u.dtype.type(gain),
        u.dtype.type(0),
        u.dtype.type(1),
    )
    state = np.empty((2, u.shape[2]), dtype=u.dtype)
    _scan(u, spikes, state[0], state[1], constants)
    return spikes, u


class _Spike(torch.autograd.Function):
    """grad_psp = grad_spikes * scale_rho / (tau_rho theta) * exp(-|u - theta| / (tau_rho theta))."""

    @staticmethod
    def forward(ctx: Any, psp: Tensor, neuron: NeuronParameters) -> Tensor:
        spikes, u = scan_spikes(psp.detach().numpy(), neuron)
        ctx.save_for_backward(torch.from_numpy(u))
        ctx.neuron = neuron
        return torch.from_numpy(spikes)

    @staticmethod
    def backward(ctx: Any, *grads: Tensor) -> tuple[Tensor, None]:
        neuron: NeuronParameters = ctx.neuron
        (u,) = ctx.saved_tensors
        width = neuron.tau_rho * neuron.theta
        slope = (u - neuron.theta).abs_().mul_(-1.0 / width).exp_().mul_(neuron.scale_rho / width)
        return slope.mul_(grads[0]), None


def spike(psp: Tensor, neuron: NeuronParameters) -> Tensor:
    """Return the spikes (0 or 1) of psp (batch, steps, n), differentiable by the surrogate above."""
    spikes: Tensor = _Spike.apply(psp, neuron)  # type: ignore[no-untyped-call]
    return spikes


class SRMLayer(nn.Module):
    """A fully connected layer of spike response neurons that recur over the middle axis of its input.

    u_i(t) = sum over own past spikes nu(t - t_f) + sum over j, t_j of w_ij eps(t - t_j); a spike where u_i >=
    theta. Input (batch, steps, in_features), output (batch, steps, out_features); ``weight`` [out, in], no
    bias.
    """

    psp: Tensor

    def __init__(
        self,
        in_features: int,
        out_features: int,
        steps: int,
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
        self._psp = psp_matrix(neuron.tau_sr, steps)
        self.register_buffer("psp", torch.from_numpy(self._psp).to(torch.float32), persistent=False)

    def _apply(self, fn: Any, recurse: bool = True) -> SRMLayer:
        super()._apply(fn, recurse)  # type: ignore[no-untyped-call]
        # From the double precision original: a float32 matrix made double would stay rounded to float32.
        self.psp = torch.from_numpy(self._psp).to(self.psp.dtype)
        return self

    def forward(self, x: Tensor) -> Tensor:
        """Return the spikes of this layer for spikes ``x``."""
        return spike(torch.matmul(self.psp, torch.matmul(x, self.weight.T)), self.neuron)


class TSRM(SRMLayer):
    """Spike response neurons whose steps are time steps; their inputs are channels."""


class LSRM(SRMLayer):
    """Spike response neurons whose steps are locations; the first layer's inputs are time steps.

    See :func:`transpose_recording` for the input of the first layer of a location branch.
    """


def transpose_recording(x: Tensor, walk: Tensor) -> Tensor:
    """Return (batch, locations, steps) from x (batch, steps, channels): location l is channel ``walk[l]``."""
    return x.index_select(2, walk).transpose(1, 2)
