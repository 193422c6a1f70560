"""Neurons step by step: float ones in float64, what the network's author means, and on-grid ones in int64.

The integers are chip.md's arithmetic written once more, by population instead of compartment. They share no arithmetic
with ``hw_model``, so that agreement of the two means something. Letters as in ``network.quantized``.
"""

import math
from collections import deque
from functools import singledispatch
from typing import Any, Protocol

import numpy as np

from hw_model.description.chip import Registers
from hw_model.values import AnyArray, BoolArray, FloatArray, IntArray
from locsnn_compile.errors import InputError
from locsnn_compile.network.neurons import Cuba, Neuron, SoftCuba, SrmAlpha, alpha_recursion
from locsnn_compile.network.projections import ChipProjection, Matrix, values_of, with_values
from locsnn_compile.network.quantized import ChipCuba, ChipNeuron, ChipSrm


def kept(x: IntArray, decay: IntArray | int) -> IntArray:
    """Return x * (4096 - decay) / 4096, truncated toward zero."""
    product = x * (4096 - decay)
    return (product + (product >> 63 & 4095)) >> 12


def effective(mantissa: IntArray, exponent: int | IntArray) -> IntArray:
    """Return 64 * floor(mantissa * 2^exponent)."""
    return np.floor(np.ldexp(np.asarray(mantissa, dtype=np.float64), exponent)).astype(np.int64) * 64


def effective_weights(projection: ChipProjection) -> Matrix:
    """Return a projection's effective weights, int64, in the form of its mantissas."""
    return with_values(projection.mantissa, effective(values_of(projection.mantissa), projection.exponent))


class NeuronSteps(Protocol):
    """The state of a population's neurons, (batch, n)."""

    def step(self, arriving: Any) -> tuple[BoolArray, AnyArray]:
        """Take the weights that arrive; return spikes and the potential that decided them."""


@singledispatch
def steps_of(neuron: Neuron, batch: int, size: int, registers: Registers | None = None) -> NeuronSteps:
    """Return neurons at rest, as their model has registered them; on-grid ones wrap and clip in ``registers``."""
    fix = "Register its state with locsnn_compile.reference.evaluate.steps_of."
    raise InputError(f"neuron {type(neuron).__name__}", "nothing says how it steps", fix=fix)


class Filter:
    """Current and voltage of compartments (batch, n) that neither spike nor are reset."""

    def __init__(self, decay_u: IntArray, decay_v: IntArray, registers: Registers, batch: int) -> None:
        self._decay_u, self._decay_v, self._registers = decay_u, decay_v, registers
        self._u, self.v = np.zeros((2, batch, len(decay_u)), dtype=np.int64)

    def step(self, charge: IntArray) -> IntArray:
        """Take the charge that arrives, (batch, n); return v."""
        r = self._registers
        self._u = _wrapped(kept(self._u, self._decay_u) + _wrapped(charge, r.charge_bits), r.current_bits)
        self.v = _clipped(kept(self.v, self._decay_v) + self._u, r)
        return self.v


def input_response(neuron: ChipNeuron, charge: IntArray, registers: Registers, steps: int) -> IntArray:
    """Return the voltage, without bias or spikes, after a charge (n,) in the first step alone; (steps, n).

    Of several dendrites each takes its share, and their voltages are added up.
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
        decay_u, decay_v = (np.tile(decay, neuron.dendrites) for decay in (neuron.decay_u, neuron.decay_v))
        self._alpha = Filter(decay_u, decay_v, registers, batch)
        self._pull = None if own.decay is None else Filter(own.decay, own.decay, registers, batch)
        self._taps = list(zip(own.delay, effective(own.mantissa, own.exponent[:, None]), strict=True))
        self.fired = np.zeros((batch, size), dtype=np.bool_)
        length = int(own.delay.max(initial=0)) + 1
        self._past = deque([np.zeros_like(self.fired)] * length, maxlen=length)

    def step(self, arriving: IntArray) -> tuple[BoolArray, IntArray]:
        """Take the charge that arrives from others, (batch, d n), dendrite by dendrite; return spikes and the potential
        that decided them, (batch, n)."""
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
    """Return what it adds at rest."""
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
        self.u = _wrapped(kept(self.u, n.decay_u) + _wrapped(arriving, r.charge_bits), r.current_bits)
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
        return x  # nearly always, and a remainder takes long
    return (x + half) % (2 * half) - half


def _clipped(x: IntArray, registers: Registers) -> IntArray:
    """Return x within the voltage register."""
    return np.clip(x, -registers.voltage_max, registers.voltage_max)


class SrmSteps:
    """SRM neurons (batch, n), both kernels in recursive form, with their full tails or cut.

    c * k * a^(k-1) is the answer of two first-order filters of decay a in a row to a spike one step earlier, times
    c = e * a / tau.
    """

    def __init__(self, neuron: SrmAlpha, batch: int, size: int, registers: Registers | None = None) -> None:
        self._theta = neuron.theta
        self._a, self._gain = alpha_recursion(neuron.tau_sr)
        own = -neuron.scale_ref * neuron.theta
        self._refractory_a, self._refractory_gain = alpha_recursion(neuron.tau_ref, own)
        self._current, self._response, self._refractory_current, self._refractory = np.zeros((4, batch, size))
        self._fired = np.zeros((batch, size), dtype=np.bool_)
        taps = (neuron.eps_taps, self._a), (neuron.nu_taps, self._refractory_a)
        self._cuts = [None if math.isinf(count) else _Cut(int(count), a) for count, a in taps]

    def step(self, arriving: FloatArray) -> tuple[BoolArray, FloatArray]:
        """Take the weights that arrive, (batch, n); return spikes and the potential that decided them."""
        eps, nu = self._cuts
        arriving = eps.step(arriving) if eps else arriving
        own = nu.step(self._fired) if nu else self._fired
        self._current = self._a * self._current + arriving
        self._response = self._a * self._response + self._current
        self._refractory_current = self._refractory_a * self._refractory_current + own
        self._refractory = self._refractory_a * self._refractory + self._refractory_current
        potential = self._gain * self._response + self._refractory_gain * self._refractory
        self._fired = potential >= self._theta
        return self._fired, potential


class _Cut:
    """Ends a kernel ``k a^(k-1)`` after its first K values, lag 0 included, by what is sent to its filter.

    What is left of the kernel from lag K on is K a^(K-1) times the kernel itself K - 1 steps later, less
    (K - 1) a^K times it K steps later: both are taken away again.
    """

    def __init__(self, taps: int, a: float) -> None:
        self._taps, self._near, self._far = taps, taps * a ** (taps - 1), (taps - 1) * a**taps
        self._past: deque[FloatArray] = deque(maxlen=taps + 1)

    def step(self, x: FloatArray | BoolArray) -> FloatArray:
        """Take what arrives; return what the filter of the whole kernel is to take instead."""
        past = self._past
        past.append(np.array(x, dtype=np.float64))
        found = past[-1].copy()
        if len(past) >= self._taps:
            found -= self._near * past[-self._taps]
        if len(past) > self._taps:
            found += self._far * past[0]
        return found


class CubaSteps:
    """Leaky integrate-and-fire neurons (batch, n) with a current and a reset to zero."""

    def __init__(self, neuron: Cuba, batch: int, size: int, registers: Registers | None = None) -> None:
        self._neuron = neuron
        self._current, self._voltage = np.zeros((2, batch, size))
        self._blocked = np.zeros((batch, size), dtype=np.int64)

    def step(self, arriving: FloatArray) -> tuple[BoolArray, FloatArray]:
        """Take the weights that arrive, (batch, n); return spikes and the potential before the reset."""
        n = self._neuron
        self._current = (1.0 - n.decay_u) * self._current + arriving
        held = self._blocked > 0
        potential = np.where(held, 0.0, (1.0 - n.decay_v) * self._voltage + self._current + n.bias)
        above = potential > n.threshold if n.rule == ">" else potential >= n.threshold
        fired: BoolArray = above & ~held
        self._voltage = np.where(fired, 0.0, potential)
        self._blocked = np.where(fired, n.refractory - 1, np.maximum(self._blocked - 1, 0))
        return fired, potential


class SoftCubaSteps:
    """Leaky integrate-and-fire neurons (batch, n) with a current, from which a spike takes its drop."""

    def __init__(self, neuron: SoftCuba, batch: int, size: int, registers: Registers | None = None) -> None:
        self._neuron = neuron
        self._current, self._voltage = np.zeros((2, batch, size))
        self._fired = np.zeros((batch, size), dtype=np.bool_)

    def step(self, arriving: FloatArray) -> tuple[BoolArray, FloatArray]:
        """Take the weights that arrive, (batch, n); return spikes and the potential that decided them."""
        n = self._neuron
        self._current = (1.0 - n.decay_u) * self._current + arriving
        self._voltage = (1.0 - n.decay_v) * self._voltage + self._current - n.drop * self._fired
        self._fired = self._voltage > n.threshold
        return self._fired, self._voltage


steps_of.register(SrmAlpha, SrmSteps)
steps_of.register(Cuba, CubaSteps)
steps_of.register(SoftCuba, SoftCubaSteps)
steps_of.register(ChipCuba, ChipCubaSteps)
steps_of.register(ChipSrm, ChipSrmSteps)
