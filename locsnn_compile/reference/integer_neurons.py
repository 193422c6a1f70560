"""On-grid neurons step by step in int64: the chip's arithmetic written once more, by population, not by compartment.

It shares no arithmetic with ``hw_model``, so that the agreement of the two means something. Letters are those of
``network.chip_neurons``.
"""

from collections import deque
from functools import singledispatch

import numpy as np

from hw_model.description.chip import Registers
from hw_model.values import BoolArray, IntArray
from locsnn_compile.network.chip_neurons import ChipCuba, ChipNeuron, ChipSrm
from locsnn_compile.network.projections import ChipProjection, Matrix, values_of, with_values


def kept(x: IntArray, decay: IntArray | int) -> IntArray:
    """Return x * (4096 - decay) / 4096, truncated toward zero."""
    product = x * (4096 - decay)
    return (product + (product >> 63 & 4095)) >> 12


def effective(mantissa: IntArray, exponent: int | IntArray) -> IntArray:
    """Return 64 * floor(mantissa * 2^exponent)."""
    return (
        np.floor(np.ldexp(np.asarray(mantissa, dtype=np.float64), exponent)).astype(np.int64) * 64
    )


def effective_weights(projection: ChipProjection) -> Matrix:
    """Return a projection's effective weights, int64, in the form of its mantissas."""
    return with_values(
        projection.mantissa, effective(values_of(projection.mantissa), projection.exponent)
    )


class Filter:
    """Current and voltage of compartments (batch, n) that never spike and are never reset."""

    def __init__(
        self, decay_u: IntArray, decay_v: IntArray, registers: Registers, batch: int
    ) -> None:
        self._decay_u, self._decay_v, self._registers = decay_u, decay_v, registers
        self._u, self.v = np.zeros((2, batch, len(decay_u)), dtype=np.int64)

    def step(self, charge: IntArray) -> IntArray:
        """Take the charge that arrives, (batch, n); return v."""
        r = self._registers
        self._u = _wrapped(
            kept(self._u, self._decay_u) + _wrapped(charge, r.charge_bits), r.current_bits
        )
        self.v = _clipped(kept(self.v, self._decay_v) + self._u, r)
        return self.v


def input_response(
    neuron: ChipNeuron, charge: IntArray, registers: Registers, steps: int
) -> IntArray:
    """Return the voltage (steps, n), without bias or spikes, after a charge (n,) in the first step only.

    Several dendrites share the charge, and their voltages add up.
    """
    dendrites = neuron.dendrites
    parts = np.stack([(charge + number) // dendrites for number in range(dendrites)])
    state = Filter(neuron.decay_u, neuron.decay_v, registers, dendrites)
    charges = [parts, *[np.zeros_like(parts)] * (steps - 1)]
    return np.stack([state.step(q).sum(axis=0) for q in charges])


class ChipSrmSteps:
    """SRM neurons (batch, n) of d dendrites each, whose own spikes come back after the delay of each tap."""

    def __init__(self, neuron: ChipSrm, batch: int, size: int, registers: Registers) -> None:
        self._threshold, self._registers = 64 * neuron.threshold, registers
        self._dendrites, own = neuron.dendrites, neuron.refractory
        decay_u, decay_v = (
            np.tile(decay, neuron.dendrites) for decay in (neuron.decay_u, neuron.decay_v)
        )
        self._alpha = Filter(decay_u, decay_v, registers, batch)
        self._pull = None if own.decay is None else Filter(own.decay, own.decay, registers, batch)
        self._taps = list(
            zip(own.delay, effective(own.mantissa, own.exponent[:, None]), strict=True)
        )
        self.fired = np.zeros((batch, size), dtype=np.bool_)
        length = int(own.delay.max(initial=0)) + 1
        self._past = deque([np.zeros_like(self.fired)] * length, maxlen=length)

    def step(self, arriving: IntArray) -> tuple[BoolArray, IntArray]:
        """Take the charge that arrives from others, (batch, d n), dendrite by dendrite.

        Returns the spikes, and the potential that decided them, (batch, n).
        """
        self._past.appendleft(self.fired)
        own = np.zeros(self.fired.shape, dtype=np.int64)
        for delay, weights in self._taps:
            own += weights * self._past[delay]
        if self._pull is None:
            arriving = arriving + np.tile(own, self._dendrites)
        alpha = self._alpha.step(arriving)
        summed = alpha.reshape(len(alpha), self._dendrites, -1).sum(axis=1)
        if self._pull is not None:
            summed += self._dendrites * self._pull.step(own)
        potential = _clipped(summed, self._registers)
        self.fired = potential > self._threshold
        return self.fired, potential


@singledispatch
def own_spike_response(neuron: ChipNeuron, registers: Registers, steps: int) -> IntArray:
    """Return what a spike adds to the potential of neurons in the steps after it, (steps, n)."""
    raise NotImplementedError(type(neuron).__name__)


@own_spike_response.register
def _at_rest(neuron: ChipSrm, registers: Registers, steps: int) -> IntArray:
    """Return what it adds to neurons at rest."""
    state = ChipSrmSteps(neuron, 1, len(neuron.threshold), registers)
    state.fired[:] = True
    silence = np.zeros((1, neuron.dendrites * len(neuron.threshold)), dtype=np.int64)
    return np.concatenate([state.step(silence)[1] for _ in range(steps)])


@own_spike_response.register
def _by_reset(neuron: ChipCuba, registers: Registers, steps: int) -> IntArray:
    """Return what the reset takes from neurons that a steady current holds at the threshold."""
    held = 64 * neuron.threshold
    state = ChipCubaSteps(neuron, 1, len(neuron.threshold), registers)
    state.u[:] = held - kept(held, neuron.decay_v)
    state.blocked[:] = neuron.refractory - 1
    charge = state.u - kept(state.u, neuron.decay_u)
    return np.concatenate([state.step(charge)[1] - held for _ in range(steps)])


class ChipCubaSteps:
    """Single compartments (batch, n) with the chip's own reset and refractory count."""

    def __init__(self, neuron: ChipCuba, batch: int, size: int, registers: Registers) -> None:
        self._neuron, self._registers = neuron, registers
        self._bias = neuron.bias_mantissa << neuron.bias_exponent
        self.u, self.v, self.blocked = np.zeros((3, batch, size), dtype=np.int64)

    def step(self, arriving: IntArray) -> tuple[BoolArray, IntArray]:
        """Take the charge that arrives, (batch, n); return spikes and the potential before the reset."""
        n, r = self._neuron, self._registers
        self.u = _wrapped(
            kept(self.u, n.decay_u) + _wrapped(arriving, r.charge_bits), r.current_bits
        )
        drive = _wrapped(self.u + self._bias, r.current_bits)
        held = self.blocked > 0
        potential = np.where(held, 0, _clipped(kept(self.v, n.decay_v) + drive, r))
        fired: BoolArray = ~held & (potential > 64 * n.threshold)
        self.v = np.where(fired, 0, potential)
        self.blocked = np.where(fired, n.refractory - 1, np.maximum(self.blocked - 1, 0))
        return fired, potential


def _wrapped(x: IntArray, bits: int) -> IntArray:
    """Return x in two's complement of ``bits`` bits plus sign."""
    half = 1 << bits
    if -half <= x.min(initial=0) and x.max(initial=0) < half:
        return x  # nearly always, and the remainder is slow
    return (x + half) % (2 * half) - half


def _clipped(x: IntArray, registers: Registers) -> IntArray:
    """Clip x to the voltage register, and return it."""
    return np.minimum(
        np.maximum(x, -registers.voltage_max, out=x), registers.voltage_max, out=x
    )  # faster than np.clip
