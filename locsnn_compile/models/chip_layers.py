"""Layers whose forward pass is the chip's integer arithmetic, and whose gradient is that of the float neuron.

Forward: latent float weights are rounded to mantissas, their sums over spikes are exact, and a compiled scan takes the
chip's steps, of whatever strategy. Backward: rounding passes the gradient straight through (Bengio et al. 2013), and
the steps count as linear filters of the chip's decays, behind SLAYER's surrogate (Shrestha and Orchard 2018) at the
integer potential.

The scans take charges (batch, steps, n), int32 in units of 64, that the spikes of each step send on: what step t sends
arrives at step t + 1. A step is that of ``hw_model``: q and u wrap, v is clipped, a spike where v > threshold; ``keep``
is 4096 less a decay, and ``ends`` are :func:`register_ends`. They fill ``potential`` (int32), v at the threshold before
any reset, ``spikes`` (uint8) and ``live`` (uint8, 0 in a refractory step), all (batch, steps, n), and add to ``events``
(3,): charge wraps, current wraps and voltage clips of all compartments of the population.
"""

from typing import Any

import numpy as np
import torch
from torch import Tensor

from hw_model.arithmetic import fixed_point
from hw_model.arithmetic.fixed_point import DECAY_ONE, WEIGHT_SHIFT, effective_weight
from hw_model.engine.compiled import absorbed, compiled_with_arrays
from hw_model.engine.lane_arithmetic import rz, wrap
from hw_model.values import AnyArray, ByteArray, Int32Array, IntArray
from locsnn_compile.models.chip_entry import ChipNumbers, ChipPopulation, RegisterWidths
from locsnn_compile.models.description import NeuronParameters
from locsnn_compile.models.srm import respond_back
from locsnn_compile.models.touch_model import DenseLayer, applied, constants, to_device, to_host
from locsnn_compile.network.chip_neurons import ChipCuba

Ends = tuple[np.int32, np.int32, np.int32]


def register_ends(registers: RegisterWidths) -> Ends:
    """Return 2^bits of q, in units of 64, and of u, and the largest v."""
    return (
        np.int32(1 << (registers.charge_bits - WEIGHT_SHIFT)),
        np.int32(1 << registers.current_bits),
        np.int32((1 << registers.voltage_bits) - 1),
    )


@absorbed
def _clip(x, last):  # type: ignore[no-untyped-def]
    """Return x within the voltage register's limits."""
    return np.int32(min(max(x, np.int32(-last)), last))


@absorbed
def _arrive(u, v, charge, keep_u, keep_v, ends):  # type: ignore[no-untyped-def]
    """Take a compartment's step: return u and v, and 1 or 0 for a charge wrap, a current wrap and a voltage clip."""
    half_charge, half_current, last = ends
    q = wrap(charge, half_charge)
    current = np.int32(rz(u, keep_u) + np.int32(q << np.int32(6)))
    u = wrap(current, half_current)
    voltage = np.int32(rz(v, keep_v) + u)
    v = _clip(voltage, last)
    return u, v, np.int32(q != charge), np.int32(u != current), np.int32(v != voltage)


@compiled_with_arrays
def scan(  # type: ignore[no-untyped-def]
    charge, keep, threshold, pull, refractory, taps, ends, potential, spikes, live, events
):
    """Take all steps of a population, with whatever follows from its own spikes; what is None is not compiled.

    ``keep`` is that of u and v. ``pull``: keep of a refractory dendrite, and the charge that an own spike sends it; a
    memoryless soma adds both. ``refractory``: the count of the chip's own reset. ``taps`` (2, k), int32: delays, and
    charges in units of 64, with which own spikes come back.
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
                u[i], voltage, wrap_q, wrap_u, clip = _arrive(
                    u[i], v[i], due[t, i], keep, keep, ends
                )
                seen = voltage
                if pull is not None:
                    own = np.int32(pull[1] * fired[i])
                    pull_u[i], pull_v[i], own_q, own_u, own_clip = _arrive(
                        pull_u[i], pull_v[i], own, pull[0], pull[0], ends
                    )
                    soma = np.int32(voltage + pull_v[i])
                    seen = _clip(soma, ends[2])
                    wrap_q, wrap_u = np.int32(wrap_q + own_q), np.int32(wrap_u + own_u)
                    clip = np.int32(clip + own_clip + np.int32(seen != soma))
                if refractory is not None:
                    open_now = np.int32(blocked[i] == 0)
                    seen, clip = np.int32(seen * open_now), np.int32(clip * open_now)
                    live[b, t, i] = np.uint8(open_now)
                    fires = np.int32(open_now & np.int32(seen > threshold))
                    voltage = np.int32(seen * (np.int32(1) - fires))
                    held = np.int32(0) if open_now else np.int32(blocked[i] - np.int32(1))
                    blocked[i] = np.int32(refractory - np.int32(1)) if fires else held
                else:
                    fires = np.int32(seen > threshold)

                v[i] = voltage
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
    last = (1 << registers.voltage_bits) - 1
    charge = fixed_point.wrap(
        effective_weight(drive.astype(np.int64), exponent), registers.charge_bits
    )
    current = fixed_point.wrap(charge, registers.current_bits) + (
        neuron.bias_mantissa << neuron.bias_exponent
    )
    return fixed_point.clip(fixed_point.wrap(current, registers.current_bits), -last, last)


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
        keep = (DECAY_ONE - numbers.decay) / DECAY_ONE
        gain = (1 << (WEIGHT_SHIFT + numbers.exponent)) / numbers.scale
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
        self.events = np.zeros(3, dtype=np.int64)

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
        charges = effective_weight(mantissa, exponent) >> WEIGHT_SHIFT
        pull, taps = None, np.stack([delay, charges]).astype(np.int32)
        if self.chip.strategy == "dendrite":
            pull, taps = (
                (np.int32(DECAY_ONE - n.refractory_decay), taps[1].sum(dtype=np.int32)),
                taps[:, :0],
            )
        refractory = np.int32(n.refractory) if self.chip.strategy == "reset" else None
        keep, threshold = np.int32(DECAY_ONE - n.decay), np.int32(n.threshold << WEIGHT_SHIFT)
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
