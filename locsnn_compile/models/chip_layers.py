"""Layers whose forward pass is the chip's integer arithmetic, and whose gradient is that of the float neuron.

They are for training a network on the arithmetic of the chip that will run it, so that nothing changes when it is
compiled. Weights that learn are floats, called latent; what the chip gets are the integers that they round to, called
mantissas.

Forward: latent weights are rounded to mantissas, their sums over spikes are exact, and a compiled loop, a *scan*, takes
the chip's steps. Spike response neurons may be built from compartments in different ways, called strategies
(:data:`.chip_entry.MOST_OWN_SYNAPSES`); the scan knows all of them. Backward: rounding passes the gradient straight
through (Bengio et al. 2013), and the steps count as linear filters of the chip's decays, behind SLAYER's surrogate
(Shrestha and Orchard 2018) at the integer potential.

Arithmetic of the scan, as in :mod:`hw_model.arithmetic.loihi`, whose step :mod:`hw_model.engine.alone` takes: the
*charge* q, the sum of weights that reach a compartment in a step, is added to its current u, which is added to its
voltage v. What the spikes of step t send acts at step t + 1.
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
"""The ends of registers, in units of the chip: (the largest v, half the range of q, half the range of u).

A voltage beyond its end is clipped; a charge or a current wraps around.
"""


def register_ends(registers: RegisterWidths) -> Ends:
    """Return the ends of the registers of a chip."""
    return (
        np.int32(registers.voltage_max),
        np.int32(loihi.charge_span(registers.charge_bits)),
        np.int32(half_range(registers.current_bits)),
    )


@compiled_with_arrays
def scan(  # type: ignore[no-untyped-def]  # noqa: PLR0913 - a compiled loop takes arrays
    charge, keep, threshold, pull, refractory, taps, ends, potential, spikes, live, events
):
    """Take all steps of a population, including what its own spikes cause. Arguments that are None cost nothing.

    Inputs:

    - ``charge``: (batch, steps, n), int32, the weights that arrive from other populations, sent in each step
    - ``keep``: the share of u and of v that a step keeps, in 4096ths; ``threshold``: of v
    - ``refractory``: the refractory steps of the chip's own reset; None for the other strategies
    - ``pull``: of a dendrite that is inhibited by the neuron's own spikes, (the share that a step keeps, the charge
      that a spike sends it). A soma without memory adds its voltage to that of the dendrite for the inputs. None for
      the other strategies
    - ``taps`` (2, k), int32: delays and charges of the k synapses of a neuron to itself
    - ``ends``: those of :func:`register_ends`

    Outputs, to be filled:

    - ``potential``: (batch, steps, n), int32, v as it is compared with the threshold, before any reset
    - ``spikes``, ``live``: (batch, steps, n), uint8; ``live`` is 0 in a refractory step
    - ``events``: (3,), to which is added how often all compartments met each of
      :data:`hw_model.arithmetic.loihi.EVENTS` (charge wraps, current wraps, voltage clips)
    """
    batch, steps, n = charge.shape
    longest_delay = taps[0].max() if taps.shape[1] > 0 else 0
    # The charges due in each step. There is room for those that own spikes send beyond the last step.
    due = np.zeros((steps + 1 + longest_delay, n), np.int32)
    u = np.zeros(n, np.int32)
    v = np.zeros(n, np.int32)
    fired = np.zeros(n, np.int32)
    pull_u = np.zeros(n, np.int32)
    pull_v = np.zeros(n, np.int32)
    blocked = np.zeros(n, np.int32)
    wraps_q = np.zeros(n, np.int32)
    wraps_u = np.zeros(n, np.int32)
    clips = np.zeros(n, np.int32)
    # Unsigned indices cannot count from the end of an array, so the loops over neurons run in vectors.
    size = np.uint64(n)
    live[:] = 1
    for b in range(batch):
        for state in (u, v, pull_u, pull_v, fired, blocked):
            state[:] = 0
        # What is sent in a step is due in the next. Row 0 is never written, so nothing is due in step 0.
        due[1 : steps + 1] = charge[b]
        due[steps + 1 :] = 0
        for t in range(steps):
            for i in range(size):
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
                        pull_charge = np.int32(pull[1] * fired[i])
                        pull_u[i], pull_v[i], pull_wrap_q, pull_wrap_u, pull_clip = dendrite(
                            pull_u[i], pull_v[i], pull_charge, pull[0], *ends
                        )
                        joined = np.int32(joined + pull_v[i])
                        wrap_q = np.int32(wrap_q + pull_wrap_q)
                        wrap_u = np.int32(wrap_u + pull_wrap_u)
                        clip = np.int32(clip + pull_clip)
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
                    for i in range(size):
                        due[row, i] += np.int32(taps[1, k] * fired[i])
    events[0] += wraps_q.sum()
    events[1] += wraps_u.sum()
    events[2] += clips.sum()


def rounded(weight: Tensor, numbers: ChipPopulation) -> Tensor:
    """Return the mantissas of latent weights, as floats: step * round(w / (unit * step)), clipped to the range.

    Rounding passes the gradient straight through: d mantissa / d w = 1 / unit.
    """
    step = numbers.grid.step
    most_steps = numbers.grid.high // step
    mantissas = torch.round(weight.detach() / (numbers.unit * step))
    mantissas.clamp_(-most_steps, most_steps).mul_(step)
    # The difference is 0, and has the gradient of the latent weight.
    scaled = weight / numbers.unit
    return mantissas + (scaled - scaled.detach())


def potential_of_sum(
    drive: AnyArray, neuron: ChipCuba, exponent: int, registers: RegisterWidths
) -> IntArray:
    """Return the potentials (batch, n) of neurons at rest after one step, given sums of mantissas (batch, n)."""
    voltage_max = registers.voltage_max
    parameters = Parameters(
        keep_u=loihi.keep_of(neuron.decay_u),
        keep_v=loihi.keep_of(neuron.decay_v),
        bias=loihi.bias_of(neuron.bias_mantissa, neuron.bias_exponent),
        threshold=loihi.threshold_of(neuron.threshold),
        refractory=neuron.refractory,
        vmin=-voltage_max,
        vmax=voltage_max,
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
        ctx.layer = layer
        ctx.potential = potential
        ctx.live = live
        ctx.spikes = spikes
        return to_device(spikes, drive).to(drive.dtype)

    @staticmethod
    def backward(ctx: Any, *grads: Tensor) -> tuple[Tensor, None]:
        layer: ChipLayer = ctx.layer
        numbers = layer.numbers
        neuron = layer.neuron
        by_spikes = grads[0]
        # SLAYER's surrogate: scale_rho / width * exp(-|u - theta| / width), in place.
        width = neuron.tau_rho * neuron.theta
        surrogate = to_device(ctx.potential, by_spikes).to(by_spikes.dtype).div_(numbers.scale)
        surrogate.sub_(neuron.theta).abs_().mul_(-1.0 / width).exp_()
        slope = to_host(surrogate.mul_(neuron.scale_rho / width))
        v_carries_on = None
        if layer.chip.strategy == "reset":
            # In a refractory step no input can cause a spike; and v reaches the next step neither from
            # such a step nor after a spike.
            slope *= ctx.live
            v_carries_on = ctx.live & (1 - ctx.spikes)
        decay = loihi_inverse.share_kept(numbers.decay)
        gain = loihi.in_registers(2.0**numbers.exponent) / numbers.scale
        of_step = constants(slope.dtype, decay, gain, 0)
        respond_back(slope, to_host(by_spikes), v_carries_on, of_step)
        return to_device(slope, by_spikes), None


class ChipLayer(DenseLayer[NeuronParameters]):
    """A fully connected population as the chip runs it, which steps through the middle axis of its input.

    Input (batch, steps, inputs), floats 0 or 1; output (batch, steps, outputs). ``weight`` [out, in] is latent: the
    chip gets its :meth:`mantissas`. ``events``: numbers of charge wraps, current wraps and voltage clips so far.
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
        self.numbers = numbers
        self.chip = chip
        self._ends = register_ends(chip.registers)
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
        """Return (spikes, potential, live) of :func:`scan`, given sums of mantissas (batch, steps, n)."""
        numbers = self.numbers
        sums = drive.astype(np.int32, order="C")
        # Mantissas of few bits are multiples of a power of two, so shifting right loses no bit.
        if numbers.exponent >= 0:
            charge = np.left_shift(sums, numbers.exponent)
        else:
            charge = np.right_shift(sums, -numbers.exponent)
        spikes = np.empty(charge.shape, np.uint8)
        live = np.empty(charge.shape, np.uint8)
        potential = np.empty(charge.shape, np.int32)
        taps = self._taps()
        pull = None
        if self.chip.strategy == "dendrite":
            keep_of_pull = np.int32(loihi.keep_of(numbers.refractory_decay))
            # The own synapse of this strategy goes to the dendrite, and not to the neuron itself.
            pull = (keep_of_pull, taps[1].sum(dtype=np.int32))
            taps = taps[:, :0]
        refractory = np.int32(numbers.refractory) if self.chip.strategy == "reset" else None
        keep = np.int32(loihi.keep_of(numbers.decay))
        threshold = np.int32(loihi.threshold_of(numbers.threshold))
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

    def _taps(self) -> Int32Array:
        """Return the delays and the charges, in units of the chip, of a neuron's synapses to itself, (2, synapses)."""
        own_synapses = np.array(self.numbers.own, dtype=np.int64).reshape(-1, 3)
        mantissa, exponent, delay = own_synapses.T
        charges = loihi.whole_units(loihi.charge_of(mantissa, exponent))
        return np.stack([delay, charges]).astype(np.int32)
