"""Layers of spike response model (SRM) neurons in torch.

The *drive*, the sum of weights that each step sends to a neuron, is one matrix product for all steps; potentials and
spikes are one compiled loop over the steps, a *scan*. Both kernels of the model, the response to an input spike and the
refractory response to an own spike, are used in recursive form, k * a^(k - 1) as two first-order filters in a row, with
their full tails:

    psp(t) = gain * sum over s < t of (t - s) a^(t - s - 1) drive(s),   u = psp + refractory terms,   spike = u >= theta

Backward: SLAYER's surrogate (Shrestha and Orchard 2018), with u after the refractory terms, then the same filter
backwards in time. As in SLAYER, no gradient passes through the refractory terms.
"""

from typing import Any

import numpy as np
import torch
from torch import Tensor
from torch.autograd.function import once_differentiable

from hw_model.engine.compiled import compiled_with_arrays
from hw_model.values import AnyArray
from locsnn_compile.models.description import NeuronParameters
from locsnn_compile.models.touch_model import DenseLayer, applied, constants, to_device, to_host
from locsnn_compile.network.neurons import alpha_recursion


@compiled_with_arrays
def _respond(
    values: AnyArray, constants: tuple[Any, ...], spikes: AnyArray
) -> None:  # pragma: no cover - compiled
    """Replace the drives in ``values`` by potentials, and fill ``spikes``; both are (batch, steps, n).

    ``current`` and ``response`` are the two filters of the response to inputs, ``charge`` and ``pull`` those of the
    refractory response to own spikes, with ``pull_decay`` and ``pull_gain`` (negative) in place of ``decay`` and
    ``gain``.
    """
    # Potentials replace drives because another array would leave less of the cache to the rest. Zero and
    # one are passed as constants of the drive's type: literals would make the loop compute in float64.
    theta, decay, gain, pull_decay, pull_gain, zero, one = constants
    batch, steps, size = values.shape
    current, response = np.empty(size, values.dtype), np.empty(size, values.dtype)
    charge, pull = np.empty(size, values.dtype), np.empty(size, values.dtype)
    for b in range(batch):
        for state in (current, response, charge, pull):
            state[:] = zero
        for t in range(steps):
            for i in range(size):
                # Responses first: a drive or a spike of this step acts from the next step on.
                response[i] = decay * response[i] + current[i]
                pull[i] = pull_decay * pull[i] + charge[i]
                u = gain * response[i] + pull_gain * pull[i]
                spike = one if u >= theta else zero
                current[i] = decay * current[i] + values[b, t, i]
                charge[i] = pull_decay * charge[i] + spike
                values[b, t, i] = u
                spikes[b, t, i] = spike


@compiled_with_arrays
def respond_back(slope, by_spikes, carry, constants):  # type: ignore[no-untyped-def]  # pragma: no cover - compiled
    """Replace ``slope``, the surrogate gradient of spikes by potentials, by the gradient of the loss by the drive.

    ``slope`` is (batch, steps, n), and so is ``by_spikes``, the gradient of the loss by spikes, which may also be
    (batch, 1, n) if it is the same in all steps. u and v are the two filters of the response, as the current and the
    voltage of a chip's compartment. Backwards in time, with du and dv the gradients by them:

        dv(t) = slope(t) * by_spikes(t) + decay * carry(t) * dv(t + 1)
        du(t) = dv(t) + decay * du(t + 1)
        gradient by the drive of step t = gain * du(t + 1), because a drive acts one step later

    ``carry`` (uint8) is 0 where v is reset and so does not reach the next step; None: it always does. ``constants`` are
    decay, gain and 0.
    """
    decay, gain, zero = constants
    batch, steps, size = slope.shape
    # The gradient of a sum over steps is the same in all steps, so it comes with one step only.
    stride = 1 if by_spikes.shape[1] == steps else 0
    du, dv = np.empty(size, slope.dtype), np.empty(size, slope.dtype)
    for b in range(batch):
        du[:] = zero
        dv[:] = zero
        for t in range(steps - 1, -1, -1):
            for i in range(size):
                # du becomes that of step t + 1, whose dv is still there; then dv becomes that of step t.
                du[i] = decay * du[i] + dv[i]
                kept = decay * dv[i]
                if carry is not None:
                    kept = kept if carry[b, t, i] else zero
                dv[i] = kept + slope[b, t, i] * by_spikes[b, stride * t, i]
                slope[b, t, i] = gain * du[i]


def respond(drive: AnyArray, neuron: NeuronParameters) -> tuple[AnyArray, AnyArray]:
    """Return (spikes, u), both (batch, steps, n), given the drive of every step, of the same shape.

    The results have the float type of the drive. u(t) = psp(t) + pull_gain * r(t), where r sums k * pull_decay^(k - 1)
    over the neuron's own past spikes; it spikes (1) where u(t) >= theta. Potentials overwrite ``drive``.
    """
    to_inputs = alpha_recursion(neuron.tau_sr)
    to_own_spikes = alpha_recursion(neuron.tau_ref, -neuron.scale_ref * neuron.theta)
    spikes = np.empty_like(drive)
    _respond(
        drive,
        constants(drive.dtype, neuron.theta, *to_inputs, *to_own_spikes, 0, 1),
        spikes,
    )
    return spikes, drive


def _gradient_of_drive(u: AnyArray, by_spikes: Tensor, neuron: NeuronParameters) -> AnyArray:
    """Return the gradient by the drive, given the potentials ``u`` and the gradient by the spikes.

    The surrogate is scale_rho / width * exp(-|u - theta| / width), with width = tau_rho * theta. Its factor scale_rho /
    width is applied with the gain at the end.
    """
    width = neuron.tau_rho * neuron.theta
    slope: AnyArray = u - neuron.theta
    np.abs(slope, out=slope)
    slope *= -1.0 / width
    # numpy's exponential takes half the time of torch's.
    np.exp(slope, out=slope)
    if by_spikes.stride(1) == 0:
        # An expanded tensor: all steps share one row, which is enough to pass on.
        by_spikes = by_spikes[:, :1]
    decay, gain = alpha_recursion(neuron.tau_sr)
    respond_back(
        slope,
        to_host(by_spikes),
        None,
        constants(u.dtype, decay, gain * neuron.scale_rho / width, 0),
    )
    return slope


def _gradient_of_weight(x: Tensor, by_drive: Tensor) -> Tensor:
    """Return the gradient (out, in) by the weight."""
    if not x.is_contiguous():
        return torch.bmm(x.transpose(1, 2), by_drive).sum(dim=0).T
    inputs = x.flatten(0, 1)
    by_sums = by_drive.flatten(0, 1)
    # With many steps to add up, a product is a quarter faster with the wider of its sides as rows.
    if inputs.shape[1] > by_sums.shape[1]:
        return torch.mm(inputs.T, by_sums).T
    return torch.mm(by_sums.T, inputs)


class _Layer(torch.autograd.Function):
    """The spikes of a layer, with grad_u = grad_spikes * scale_rho / (tau_rho theta) * exp(-|u - theta| / (tau_rho
    theta)) and grad_drive the psp's filter of grad_u, backwards in time. A whole layer is one node of torch's graph of
    gradients: bookkeeping for more nodes would cost more than the sums.
    """

    @staticmethod
    def forward(ctx: Any, x: Tensor, weight: Tensor, neuron: NeuronParameters) -> Tensor:
        if x.is_contiguous():
            drive = torch.matmul(x, weight.T)
        else:
            # One product per recording can use a transposed recording in place; a single product would copy it first.
            drive = torch.bmm(x, weight.T.expand(len(x), -1, -1))
        spikes, u = respond(to_host(drive), neuron)
        ctx.save_for_backward(x, weight)
        ctx.neuron, ctx.u = neuron, u
        return to_device(spikes, x)

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, by_spikes: Tensor) -> tuple[Tensor | None, Tensor | None, None]:
        x, weight = ctx.saved_tensors
        by_drive = to_device(_gradient_of_drive(ctx.u, by_spikes, ctx.neuron), x)
        by_x = torch.matmul(by_drive, weight) if ctx.needs_input_grad[0] else None
        by_weight = _gradient_of_weight(x, by_drive) if ctx.needs_input_grad[1] else None
        return by_x, by_weight, None


class SRMLayer(DenseLayer[NeuronParameters]):
    """A fully connected layer of spike response neurons that recur over the middle axis of its input.

    The neurons are called TSRM if that axis is time and the inputs are channels, and LSRM if its steps are locations
    and the inputs of the first layer are time steps (see :func:`transpose_recording`).

    u_i(t) = sum over own past spikes nu(t - t_f) + sum over j, t_j of w_ij eps(t - t_j); a spike where u_i >= theta.
    The kernels eps and nu are those of :class:`~locsnn_compile.models.description.NeuronParameters`.
    """

    def forward(self, x: Tensor) -> Tensor:
        """Return the spikes of this layer for spikes ``x``; they can be differentiated once."""
        return applied(_Layer, x, self.weight, self.neuron)


def transpose_recording(x: Tensor, walk: Tensor) -> Tensor:
    """Return (batch, locations, steps) from x (batch, steps, channels): location l is channel ``walk[l]``."""
    return x.transpose(1, 2).index_select(1, walk)
