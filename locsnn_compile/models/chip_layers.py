"""Layers whose forward pass is the chip's integer arithmetic, and whose gradient is that of the float neuron.

Forward: latent float weights are rounded to mantissas, their sums over spikes are exact, and a compiled scan takes the
chip's steps, of whatever strategy. Backward: rounding passes the gradient straight through (Bengio et al. 2013), and
the steps count as linear filters of the chip's decays, behind SLAYER's surrogate (Shrestha and Orchard 2018) at the
integer potential.

The scans take charges (batch, steps, n), int32 in units of :mod:`hw_model.arithmetic.loihi`, whose step
:mod:`hw_model.engine.alone` takes; what the spikes of step t send on acts at step t + 1. ``keep`` is what a decay
keeps, and ``ends`` are :func:`register_ends`. They fill ``potential`` (int32), v at the threshold before any reset,
``spikes`` (uint8) and ``live`` (uint8, 0 in a refractory step), all (batch, steps, n), and add to ``events`` (3,) how
often all compartments of the population met each.
"""

from typing import Any

import numpy as np
import torch
from torch import Tensor

from hw_model.arithmetic import loihi, loihi_inverse
from hw_model.arithmetic.fixed_point import half_range
from hw_model.arithmetic.loihi import EVENTS, Parameters
from hw_model.arithmetic.neutral import NOTHING
from hw_model.arithmetic.on_integers import OnIntegers
from hw_model.engine.alone import compartment, dendrite, sum_of_joined
from hw_model.engine.compiled import compiled_with_arrays
from hw_model.values import AnyArray, ByteArray, Int32Array, IntArray
from locsnn_compile.models.chip_entry import ChipNumbers, ChipPopulation, RegisterWidths
from locsnn_compile.models.description import NeuronParameters
from locsnn_compile.models.srm import respond_back
from locsnn_compile.models.touch_model import DenseLayer, applied, constants, to_device, to_host
from locsnn_compile.network.chip_neurons import ChipCuba

Ends = tuple[np.int32, np.int32, np.int32]


def register_ends(registers: RegisterWidths) -> Ends:
    """Return the largest v, and 2^bits of q, in units, and of u."""
    return (
        np.int32(registers.voltage_max),
        np.int32(loihi.charge_span(registers.charge_bits)),
        np.int32(half_range(registers.current_bits)),
    )


@compiled_with_arrays
def scan(  # type: ignore[no-untyped-def]
    charge, keep, threshold, pull, refractory, taps, ends, potential, spikes, live, events
):
    """Take all steps of a population, with whatever follows from its own spikes; what is None is not compiled.

    ``keep`` is that of u and v. ``pull``: keep of a refractory dendrite, and the charge that an own spike sends it; a
    memoryless soma adds both. ``refractory``: the count of the chip's own reset. ``taps`` (2, k), int32: delays, and
    charges in units, with which own spikes come back.
    """
    batch, steps, n = charge.shape
    longest = taps[0].max() if taps.shape[1] > 0 else 0
    due = np.zeros((steps + 1 + longest, n), np.int32)
    u, v, fired = np.zeros(n, np.int32), np.zeros(n, np.int32), np.zeros(n, np.int32)
    pull_u, pull_v, blocked = np.zeros(n, np.int32), np.zeros(n, np.int32), np.zeros(n, np.int32)
    wraps_q, wraps_u, clips = np.zeros(n, np.int32), np.zeros(n, np.int32), np.zeros(n, np.int32)
    many = np.uint64(n)
    live[:] = 1
    for b in range(batch):
        for state in (u, v, pull_u, pull_v, fired, blocked):
            state[:] = 0
        due[1 : steps + 1] = charge[b]
        due[steps + 1 :] = 0
        for t in range(steps):
            for i in range(many):
                if refractory is not None:
                    u[i], v[i], blocked[i], seen, fires, open_now, wrap_q, wrap_u, clip = (
                        compartment(
                            u[i], v[i], blocked[i], due[t, i], keep, threshold, refractory, *ends
                        )
                    )
                    live[b, t, i] = np.uint8(open_now)
                else:
                    u[i], v[i], wrap_q, wrap_u, clip = dendrite(u[i], v[i], due[t, i], keep, *ends)
                    joined = v[i]
                    if pull is not None:
                        own = np.int32(pull[1] * fired[i])
                        pull_u[i], pull_v[i], own_q, own_u, own_clip = dendrite(
                            pull_u[i], pull_v[i], own, pull[0], *ends
                        )
                        joined = np.int32(joined + pull_v[i])
                        wrap_q = np.int32(wrap_q + own_q)
                        wrap_u = np.int32(wrap_u + own_u)
                        clip = np.int32(clip + own_clip)
                    seen, fires, _, _, clips_of_sum = sum_of_joined(joined, threshold, *ends)
                    clip = np.int32(clip + clips_of_sum)

                wraps_q[i] += wrap_q
                wraps_u[i] += wrap_u
                clips[i] += clip
                fired[i] = fires
                potential[b, t, i] = seen
                spikes[b, t, i] = np.uint8(fires)
            if taps.shape[1] > 0 and fired.any():
                for k in range(taps.shape[1]):
                    row = np.uint64(t + 1 + taps[0, k])
                    for i in range(many):
                        due[row, i] += np.int32(taps[1, k] * fired[i])
    events[0] += wraps_q.sum()
    events[1] += wraps_u.sum()
    events[2] += clips.sum()


def rounded(weight: Tensor, numbers: ChipPopulation) -> Tensor:
    """Return the mantissas of latent weights, as floats: step * round(w / (unit * step)), clipped to the range.

    Rounding passes the gradient straight through: d mantissa / d w = 1 / unit.
    """
    high, step, scaled = numbers.grid.high, numbers.grid.step, weight / numbers.unit
    held = (
        torch.round(weight.detach() / (numbers.unit * step))
        .clamp_(-(high // step), high // step)
        .mul_(step)
    )
    return held + (scaled - scaled.detach())


def potential_of_sum(
    drive: AnyArray, neuron: ChipCuba, exponent: int, registers: RegisterWidths
) -> IntArray:
    """Return the potentials (batch, n) of memoryless neurons for sums of mantissas that arrive at once, (batch, n)."""
    last = registers.voltage_max
    parameters = Parameters(
        keep_u=loihi.keep_of(neuron.decay_u),
        keep_v=loihi.keep_of(neuron.decay_v),
        bias=loihi.bias_of(neuron.bias_mantissa, neuron.bias_exponent),
        threshold=loihi.threshold_of(neuron.threshold),
        refractory=neuron.refractory,
        vmin=-last,
        vmax=last,
    )
    charge = loihi.charge_of(drive.astype(np.int64), exponent)
    at_rest = np.zeros_like(charge)
    operations = OnIntegers(registers.charge_bits, registers.current_bits)
    response = loihi.respond(operations, parameters, at_rest, at_rest, charge, NOTHING)
    potential: IntArray = response.v
    return potential


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
        slope = to_host(
            u.sub_(neuron.theta).abs_().mul_(-1.0 / width).exp_().mul_(neuron.scale_rho / width)
        )
        carry = None
        if layer.chip.strategy == "reset":
            slope *= ctx.live
            carry = ctx.live & (1 - ctx.spikes)
        keep = loihi_inverse.share_kept(numbers.decay)
        gain = loihi.in_registers(2.0**numbers.exponent) / numbers.scale
        respond_back(slope, to_host(grads[0]), carry, constants(slope.dtype, keep, gain, 0))
        return to_device(slope, grads[0]), None


class ChipLayer(DenseLayer[NeuronParameters]):
    """A fully connected population as the chip runs it, recurring over the middle axis of its input.

    Input (batch, steps, inputs), floats 0 or 1; output (batch, steps, outputs). ``weight`` [out, in] is latent: what
    counts is :meth:`mantissas`. ``events``: charge wraps, current wraps and voltage clips so far.
    """

    def __init__(
        self,
        inputs: int,
        outputs: int,
        neuron: NeuronParameters,
        numbers: ChipPopulation,
        chip: ChipNumbers,
    ) -> None:
        super().__init__(inputs, outputs, neuron)
        self.numbers, self.chip, self._ends = numbers, chip, register_ends(chip.registers)
        self.events = np.zeros(len(EVENTS), dtype=np.int64)

    def mantissas(self) -> IntArray:
        """Return the mantissas [out, in] of the latent weights."""
        return to_host(rounded(self.weight.detach(), self.numbers)).astype(np.int64)

    def forward(self, x: Tensor) -> Tensor:
        """Return the spikes of this population for spikes ``x``.

        Sums of mantissas are exact: at most 20,000 inputs of at most 255 each are far below the 2^24 of float32.
        """
        drive = torch.matmul(x, rounded(self.weight, self.numbers).T)
        return applied(_Steps, drive, self)

    def steps(self, drive: AnyArray) -> tuple[ByteArray, Int32Array, ByteArray]:
        """Return spikes, potentials and live marks, (batch, steps, n), of sums of mantissas of that shape."""
        n = self.numbers
        whole = drive.astype(np.int32, order="C")
        # Weights of few bits are multiples of a power of two: a negative exponent loses none.
        charge = (
            np.left_shift(whole, n.exponent)
            if n.exponent >= 0
            else np.right_shift(whole, -n.exponent)
        )
        spikes, live = np.empty(charge.shape, np.uint8), np.empty(charge.shape, np.uint8)
        potential = np.empty(charge.shape, np.int32)
        mantissa, exponent, delay = np.array(n.own, dtype=np.int64).reshape(-1, 3).T
        charges = loihi.whole_units(loihi.charge_of(mantissa, exponent))
        pull, taps = None, np.stack([delay, charges]).astype(np.int32)
        if self.chip.strategy == "dendrite":
            pull, taps = (
                (np.int32(loihi.keep_of(n.refractory_decay)), taps[1].sum(dtype=np.int32)),
                taps[:, :0],
            )
        refractory = np.int32(n.refractory) if self.chip.strategy == "reset" else None
        keep = np.int32(loihi.keep_of(n.decay))
        threshold = np.int32(loihi.threshold_of(n.threshold))
        scan(
            charge,
            keep,
            threshold,
            pull,
            refractory,
            taps,
            self._ends,
            potential,
            spikes,
            live,
            self.events,
        )
        return spikes, potential, live
