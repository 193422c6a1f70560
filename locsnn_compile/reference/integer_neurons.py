"""On-grid neurons step by step in int64: the chip's step of :mod:`hw_model.arithmetic.loihi`, for whole populations.

The spikes of a quantised network must equal those of its program bit for bit; this is the network's side of the
comparison. The letters u, v, q and r are those of :mod:`locsnn_compile.network.chip_neurons`.
"""

from collections import deque
from dataclasses import replace
from functools import singledispatch

import numpy as np

from hw_model.arithmetic import loihi
from hw_model.arithmetic.fixed_point import decay
from hw_model.arithmetic.loihi import Parameters, State
from hw_model.arithmetic.neutral import NOTHING
from hw_model.arithmetic.on_integers import OnIntegers
from hw_model.description.chip import Registers
from hw_model.values import BoolArray, FloatArray, IntArray
from locsnn_compile.network.chip_neurons import ChipCuba, ChipNeuron, ChipSrm, HostCuba
from locsnn_compile.network.projections import ChipProjection, Matrix, values_of, with_values


def effective_weights(projection: ChipProjection) -> Matrix:
    """Return a projection's effective weights, int64, in the form of its mantissas."""
    return with_values(
        projection.mantissa, loihi.charge_of(values_of(projection.mantissa), projection.exponent)
    )


def _on_integers(registers: Registers) -> OnIntegers:
    """Return the operations of a step on int64, which wrap charge and current in their registers."""
    return OnIntegers(registers.charge_bits, registers.current_bits)


def _unspiking(
    decay_u: IntArray, decay_v: IntArray, registers: Registers, vmin: IntArray | None
) -> Parameters:
    """Return parameters of compartments that have no bias and never spike.

    The voltage is limited by its register, and from below by ``vmin`` if there is one.
    """
    voltage_max = registers.voltage_max
    return Parameters(
        keep_u=loihi.keep_of(decay_u),
        keep_v=loihi.keep_of(decay_v),
        bias=NOTHING,
        threshold=voltage_max,  # a spike needs more
        refractory=1,
        vmin=-voltage_max if vmin is None else vmin,
        vmax=voltage_max,
    )


class Filter:
    """Current and voltage of compartments (batch, n) that never spike and are never reset."""

    def __init__(
        self,
        decay_u: IntArray,
        decay_v: IntArray,
        registers: Registers,
        batch: int,
        vmin: IntArray | None = None,
    ) -> None:
        self._arithmetic = _on_integers(registers)
        self._parameters = _unspiking(decay_u, decay_v, registers, vmin)
        self._u = np.zeros((batch, len(decay_u)), dtype=np.int64)
        self.v = np.zeros((batch, len(decay_u)), dtype=np.int64)

    def step(self, charge: IntArray) -> IntArray:
        """Take the charge that arrives, (batch, n); return v."""
        response = loihi.respond(
            self._arithmetic, self._parameters, self._u, self.v, charge, NOTHING
        )
        self._u = response.u
        self.v = response.v
        return self.v


def input_response(
    neuron: ChipNeuron, charge: IntArray, registers: Registers, steps: int
) -> IntArray:
    """Return the voltage (steps, n), without bias or spikes, after a charge (n,) in the first step only.

    Several dendrites share the charge, and their voltages add up.
    """
    dendrites = neuron.dendrites
    # Shares that differ by 1 at most, and add up to the charge.
    first_charge = np.stack([(charge + number) // dendrites for number in range(dendrites)])
    # The dendrites of a neuron take the place of recordings in the batch.
    state = Filter(neuron.decay_u, neuron.decay_v, registers, dendrites)
    silence = np.zeros_like(first_charge)
    charges = [first_charge, *[silence] * (steps - 1)]
    return np.stack([state.step(q).sum(axis=0) for q in charges])


class ChipSrmSteps:
    """SRM neurons (batch, n) of d dendrites each, whose own spikes come back after the delay of each tap.

    ``fired`` are the spikes of the last step, which a caller may replace before the next one.
    """

    def __init__(self, neuron: ChipSrm, batch: int, size: int, registers: Registers) -> None:
        own = neuron.refractory
        self._threshold = loihi.threshold_of(neuron.threshold)
        self._arithmetic = _on_integers(registers)
        self._vmax = registers.voltage_max
        self._vmin = -self._vmax if neuron.vmin is None else neuron.vmin
        self._dendrites = neuron.dendrites
        decay_u = np.tile(neuron.decay_u, neuron.dendrites)
        decay_v = np.tile(neuron.decay_v, neuron.dendrites)
        vmin = None if neuron.vmin is None else np.tile(neuron.vmin, neuron.dendrites)
        self._alpha = Filter(decay_u, decay_v, registers, batch, vmin)
        # All refractory dendrites of a neuron get the same charge, so one is computed for all.
        self._refractory = None
        if own.decay is not None:
            self._refractory = Filter(own.decay, own.decay, registers, batch, neuron.vmin)
        weights = loihi.charge_of(own.mantissa, own.exponent[:, None])
        self._taps = list(zip(own.delay, weights, strict=True))
        self.fired = np.zeros((batch, size), dtype=np.bool_)
        # A tap of delay 0 needs the spikes of the step before, one of delay d those of d + 1 steps before.
        length = int(own.delay.max(initial=0)) + 1
        self._past = deque([np.zeros_like(self.fired)] * length, maxlen=length)

    def step(self, arriving: IntArray) -> tuple[BoolArray, IntArray]:
        """Take the charge that arrives from others, (batch, d n), dendrite by dendrite.

        Returns the spikes, and the potentials that caused them, (batch, n): the clipped sum of the dendrites' voltages,
        since a soma keeps nothing of its own.
        """
        self._past.appendleft(self.fired)
        own_charge = np.zeros(self.fired.shape, dtype=np.int64)
        for delay, weights in self._taps:
            own_charge += weights * self._past[delay]
        if self._refractory is None:
            arriving = arriving + np.tile(own_charge, self._dendrites)
        alpha = self._alpha.step(arriving)
        joined = alpha.reshape(len(alpha), self._dendrites, -1).sum(axis=1)
        if self._refractory is not None:
            joined += self._dendrites * self._refractory.step(own_charge)
        potential = self._arithmetic.clip(joined, self._vmin, self._vmax)
        self.fired = potential > self._threshold
        return self.fired, potential


@singledispatch
def own_spike_response(neuron: ChipNeuron, registers: Registers, steps: int) -> IntArray:
    """Return what an own spike adds to the potential of neurons in the steps after it, (steps, n)."""
    raise NotImplementedError(type(neuron).__name__)


@own_spike_response.register
def _at_rest(neuron: ChipSrm, registers: Registers, steps: int) -> IntArray:
    """Return what a spike adds to neurons at rest; without a floor, which would cut the response off."""
    state = ChipSrmSteps(replace(neuron, vmin=None), 1, len(neuron.threshold), registers)
    state.fired[:] = True
    silence = np.zeros((1, neuron.dendrites * len(neuron.threshold)), dtype=np.int64)
    return np.concatenate([state.step(silence)[1] for _ in range(steps)])


@own_spike_response.register
def _by_reset(neuron: ChipCuba, registers: Registers, steps: int) -> IntArray:
    """Return what the reset takes from neurons that a steady current holds at the threshold.

    The state is that of the step after a spike: v is 0, the current is steady, and the refractory count has begun.
    """
    threshold = loihi.threshold_of(neuron.threshold)
    state = ChipCubaSteps(neuron, 1, len(neuron.threshold), registers)
    # A steady current replaces what the voltage loses per step, a steady charge what the current loses.
    state.u[:] = threshold - decay(threshold, neuron.decay_v)
    state.blocked[:] = loihi.blocked_by_spike(neuron.refractory)
    charge = state.u - decay(state.u, neuron.decay_u)
    return np.concatenate([state.step(charge)[1] - threshold for _ in range(steps)])


class ChipCubaSteps:
    """Single compartments (batch, n) with the chip's own reset and refractory count."""

    def __init__(self, neuron: ChipCuba, batch: int, size: int, registers: Registers) -> None:
        self._arithmetic = _on_integers(registers)
        unspiking = _unspiking(neuron.decay_u, neuron.decay_v, registers, neuron.vmin)
        self._parameters = unspiking._replace(
            bias=loihi.bias_of(neuron.bias_mantissa, neuron.bias_exponent),
            threshold=loihi.threshold_of(neuron.threshold),
            refractory=neuron.refractory,
        )
        self.u, self.v, self.blocked = np.zeros((3, batch, size), dtype=np.int64)

    def step(self, arriving: IntArray) -> tuple[BoolArray, IntArray]:
        """Take the charge that arrives, (batch, n); return spikes, and potentials before the reset."""
        state = State(self.u, self.v, self.blocked)
        step = loihi.step(self._arithmetic, self._parameters, state, arriving, NOTHING)
        self.u, self.v, self.blocked = step.state
        fired: BoolArray = step.fired
        potential: IntArray = step.potential
        return fired, potential


class HostCubaSteps:
    """Compartments of :class:`ChipCubaSteps` that the host computes; their charge comes in float and is truncated."""

    def __init__(self, neuron: HostCuba, batch: int, size: int, registers: Registers) -> None:
        self._compartments = ChipCubaSteps(neuron, batch, size, registers)
        # A float beyond the register of q might not fit an int64, so it is clipped before it becomes an integer.
        self._largest = registers.half_charge - 1

    def step(self, arriving: FloatArray) -> tuple[BoolArray, IntArray]:
        """Take the charge that arrives, (batch, n), in counts of the registers; see :meth:`ChipCubaSteps.step`."""
        within_range = np.clip(arriving, -self._largest, self._largest)
        return self._compartments.step(np.trunc(within_range).astype(np.int64))
