"""Layers whose forward pass is the chip's integer arithmetic, and whose gradient is that of the float neuron.

Forward: latent float weights are rounded to mantissas, their sums over spikes are exact, and a compiled scan takes the
chip's steps. Backward: rounding passes the gradient straight through (Bengio et al. 2013), and the steps count as
linear filters of the chip's decays, behind SLAYER's surrogate (Shrestha and Orchard 2018) at the integer potential.
"""

from typing import Any

import numpy as np
import torch
from torch import Tensor

from hw_model.arithmetic.fixed_point import DECAY_ONE, WEIGHT_SHIFT, effective_weight
from hw_model.values import AnyArray, ByteArray, Int32Array, IntArray
from locsnn_compile.models.chip_entry import USUAL_REGISTERS, ChipPopulation, RegisterWidths
from locsnn_compile.models.chip_scan import charge_gradient, register_ends, scan
from locsnn_compile.models.dense_layer import DenseLayer, to_device, to_host
from locsnn_compile.models.description import NeuronParameters


class _Round(torch.autograd.Function):
    """mantissa = step * round(w / (unit * step)), clipped to the range; d mantissa / d w = 1 / unit."""

    @staticmethod
    def forward(ctx: Any, weight: Tensor, numbers: ChipPopulation) -> Tensor:
        ctx.unit = numbers.unit
        high, step = numbers.grid.high, numbers.grid.step
        return torch.round(weight / (numbers.unit * step)).clamp_(-(high // step), high // step).mul_(step)

    @staticmethod
    def backward(ctx: Any, *grads: Tensor) -> tuple[Tensor, None]:
        return grads[0] / ctx.unit, None


class _Steps(torch.autograd.Function):
    """Spikes of sums of mantissas: the chip's steps forward, linear filters behind a surrogate backward."""

    @staticmethod
    def forward(ctx: Any, drive: Tensor, layer: "ChipLayer") -> Tensor:
        spikes, potential, live = layer.steps(to_host(drive))
        ctx.layer, ctx.potential, ctx.live, ctx.spikes = layer, potential, live, spikes
        return to_device(spikes, drive).to(drive.dtype)

    @staticmethod
    def backward(ctx: Any, *grads: Tensor) -> tuple[Tensor, None]:
        layer: ChipLayer = ctx.layer
        numbers, neuron = layer.numbers, layer.neuron
        width = neuron.tau_rho * neuron.theta
        u = to_device(ctx.potential, grads[0]).to(grads[0].dtype).div_(numbers.scale)
        slope = u.sub_(neuron.theta).abs_().mul_(-1.0 / width).exp_().mul_(neuron.scale_rho / width)
        by_voltage = slope.mul_(grads[0])
        carry = np.ones_like(ctx.spikes)
        if "refractory" in numbers.neuron.registers:
            by_voltage.mul_(to_device(ctx.live, by_voltage))
            carry = ctx.live & (1 - ctx.spikes)
        gradient = to_host(by_voltage)
        kind = gradient.dtype.type
        keep = kind((DECAY_ONE - int(numbers.neuron.decay_u[0])) / DECAY_ONE)
        found = np.empty_like(gradient)
        charge_gradient(gradient, carry, (keep, keep, kind(0)), found)
        return to_device(found, grads[0]).mul_((1 << (WEIGHT_SHIFT + numbers.exponent)) / numbers.scale), None


class ChipLayer(DenseLayer[NeuronParameters]):
    """A fully connected population as the chip runs it, recurring over the middle axis of its input.

    Input (batch, steps, in_features), floats 0 or 1; output (batch, steps, out_features). ``weight`` [out, in] is
    latent: what counts is :meth:`mantissas`. ``events``: charge wraps, current wraps and voltage clips so far.
    """

    def __init__(
        self,
        in_features: int,
        out_features: int,
        neuron: NeuronParameters,
        numbers: ChipPopulation,
        *,
        generator: torch.Generator,
        initial_scale: float,
        registers: RegisterWidths = USUAL_REGISTERS,
    ) -> None:
        super().__init__(in_features, out_features, neuron, generator=generator, initial_scale=initial_scale)
        self.numbers, self.registers, self._ends = numbers, registers, register_ends(registers)
        self.events = np.zeros(3, dtype=np.int64)

    def mantissas(self) -> IntArray:
        """Return the mantissas [out, in] of the latent weights."""
        rounded: Tensor = _Round.apply(self.weight.detach(), self.numbers)  # type: ignore[no-untyped-call]
        return to_host(rounded).astype(np.int64)

    def hold(self) -> None:
        """Bring latent weights back into the range of the format: beyond it no gradient would be of use."""
        largest = self.numbers.grid.high * self.numbers.unit
        with torch.no_grad():
            self.weight.clamp_(-largest, largest)

    def forward(self, x: Tensor) -> Tensor:
        """Return the spikes of this population for spikes ``x``.

        Sums of mantissas are exact: at most 20,000 inputs of at most 255 each are far below the 2^24 of float32.
        """
        mantissa = _Round.apply(self.weight, self.numbers)  # type: ignore[no-untyped-call]
        spikes: Tensor = _Steps.apply(torch.matmul(x, mantissa.T), self)  # type: ignore[no-untyped-call]
        return spikes

    def steps(self, drive: AnyArray) -> tuple[ByteArray, Int32Array, ByteArray]:
        """Return spikes, potentials and live marks, (batch, steps, n), of sums of mantissas of that shape."""
        n = self.numbers
        whole = drive.astype(np.int32, order="C")
        # Weights of few bits are multiples of a power of two: a negative exponent loses none.
        charge = np.left_shift(whole, n.exponent) if n.exponent >= 0 else np.right_shift(whole, -n.exponent)
        spikes, live = np.empty(charge.shape, np.uint8), np.empty(charge.shape, np.uint8)
        potential = np.empty(charge.shape, np.int32)
        neuron, pull, taps = n.neuron, None, np.zeros((2, 0), np.int32)
        for own in neuron.own.values():
            charges = effective_weight(own.mantissa[:, 0], own.exponent) >> WEIGHT_SHIFT
            taps = np.stack([own.delay, charges]).astype(np.int32)
        if "refractory" in neuron.parts:
            pull = np.int32(DECAY_ONE - neuron.parts["refractory"][0][0]), taps[1, 0]
            taps = taps[:, :0]
        count = neuron.registers.get("refractory")
        refractory = None if count is None else np.int32(count[0])
        keep, threshold = np.int32(DECAY_ONE - neuron.decay_u[0]), np.int32(neuron.threshold[0] << WEIGHT_SHIFT)
        scan(charge, keep, threshold, pull, refractory, taps, self._ends, potential, spikes, live, self.events)
        return spikes, potential, live
