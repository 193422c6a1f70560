"""Float neurons step by step in float64: the equations of :mod:`locsnn_compile.network.neurons` in recursive form.

Each class holds the state of one population for a batch of recordings, (batch, n), and is registered with
``reference.evaluate.steps_of``. All constructors take ``registers``, because those of the chip's neurons need them;
float neurons ignore them.
"""

import math
from collections import deque

import numpy as np

from hw_model.description.chip import Registers
from hw_model.values import BoolArray, FloatArray
from locsnn_compile.network.neurons import Cuba, SoftCuba, SrmAlpha, alpha_recursion


class SrmSteps:
    """SRM neurons (batch, n), with both kernels in recursive form, whole or cut.

    Two first-order filters in a row, which keep the share a per step, respond to a spike with ``k * a^(k-1)``, k steps
    later. A kernel is this response times ``c = e * a / tau`` (:func:`alpha_recursion`):

        current = a current + arriving      response = a response + current         for eps, from weighted input spikes
        the same with names in ``_refractory``                                      for nu, from own spikes
    """

    def __init__(
        self, neuron: SrmAlpha, batch: int, size: int, registers: Registers | None = None
    ) -> None:
        self._theta = neuron.theta
        self._a, self._gain = alpha_recursion(neuron.tau_sr)
        peak_of_nu = -neuron.scale_ref * neuron.theta
        self._refractory_a, self._refractory_gain = alpha_recursion(neuron.tau_ref, peak_of_nu)
        # Kernels that end early, as slayerPytorch's do, need other inputs to the same filters.
        self._eps_cut = _cut_after(neuron.eps_taps, self._a)
        self._nu_cut = _cut_after(neuron.nu_taps, self._refractory_a)
        self._current = np.zeros((batch, size))
        self._response = np.zeros((batch, size))
        self._refractory_current = np.zeros((batch, size))
        self._refractory = np.zeros((batch, size))
        self._fired = np.zeros((batch, size), dtype=np.bool_)

    def step(self, arriving: FloatArray) -> tuple[BoolArray, FloatArray]:
        """Take the sums of weights that arrive, (batch, n); return the spikes, and the potentials that caused them."""
        # The spikes of the step before: nu(0) is 0, so a spike first acts one step later.
        own_spikes: FloatArray | BoolArray = self._fired
        if self._eps_cut is not None:
            arriving = self._eps_cut.step(arriving)
        if self._nu_cut is not None:
            own_spikes = self._nu_cut.step(own_spikes)
        self._current = self._a * self._current + arriving
        self._response = self._a * self._response + self._current
        self._refractory_current = self._refractory_a * self._refractory_current + own_spikes
        self._refractory = self._refractory_a * self._refractory + self._refractory_current
        potential = self._gain * self._response + self._refractory_gain * self._refractory
        self._fired = potential >= self._theta
        return self._fired, potential


def _cut_after(taps: float, a: float) -> "KernelCut | None":
    """Return the cut of a kernel after its first ``taps`` values; None for a whole kernel, whose taps are infinite."""
    if math.isinf(taps):
        return None
    return KernelCut(int(taps), a)


class KernelCut:
    """Ends a kernel ``g(k) = k a^(k-1)`` after its first K = ``taps`` values, the lags 0 to K - 1.

    The recursive filter of the kernel never ends, so two delayed copies of its input are added that cancel the tail.
    From lag K on, the kernel is a sum of delayed kernels:

        g(k) = K a^(K-1) g(k - (K-1))  -  (K-1) a^K g(k - K)                  for k >= K

    So, in place of its input x(t), the filter gets

        x(t)  -  K a^(K-1) x(t - (K-1))  +  (K-1) a^K x(t - K)
    """

    def __init__(self, taps: int, a: float) -> None:
        self._taps = taps
        self._factor_of_last_lag = taps * a ** (taps - 1)
        self._factor_of_next_lag = (taps - 1) * a**taps
        self._past: deque[FloatArray] = deque(maxlen=taps + 1)  # x(t - K) to x(t)

    def step(self, x: FloatArray | BoolArray) -> FloatArray:
        """Take the input x(t); return what the filter of the whole kernel must get instead."""
        past = self._past
        past.append(np.array(x, dtype=np.float64))
        filter_input = past[-1].copy()
        if len(past) >= self._taps:
            filter_input -= self._factor_of_last_lag * past[-self._taps]  # x(t - (K-1))
        if len(past) > self._taps:
            filter_input += self._factor_of_next_lag * past[0]  # x(t - K)
        return filter_input


class CubaSteps:
    """Leaky integrate-and-fire neurons (batch, n) with a current and a reset to zero."""

    def __init__(
        self, neuron: Cuba, batch: int, size: int, registers: Registers | None = None
    ) -> None:
        self._neuron = neuron
        self._current = np.zeros((batch, size))
        self._voltage = np.zeros((batch, size))
        self._blocked_steps = np.zeros((batch, size), dtype=np.int64)

    def step(self, arriving: FloatArray) -> tuple[BoolArray, FloatArray]:
        """Take the sums of weights that arrive, (batch, n); return the spikes, and the potentials before the reset."""
        n = self._neuron
        self._current = (1.0 - n.decay_u) * self._current + arriving
        is_blocked = self._blocked_steps > 0
        potential = (1.0 - n.decay_v) * self._voltage + self._current + n.bias
        if n.floor is not None:
            potential = np.maximum(potential, n.floor)
        # A refractory neuron stays at rest. Its current goes on, and its floor is 0 or below, so 0 is allowed.
        potential = np.where(is_blocked, 0.0, potential)
        if n.rule == ">":
            reaches = potential > n.threshold
        else:
            reaches = potential >= n.threshold
        fired: BoolArray = reaches & ~is_blocked
        self._voltage = np.where(fired, 0.0, potential)
        counted_down = np.maximum(self._blocked_steps - 1, 0)
        # The step of the spike is the first of the refractory steps, so one fewer is blocked.
        self._blocked_steps = np.where(fired, n.refractory - 1, counted_down)
        return fired, potential


class SoftCubaSteps:
    """Leaky integrate-and-fire neurons (batch, n) with a current; a spike lowers the next voltage by ``drop``."""

    def __init__(
        self, neuron: SoftCuba, batch: int, size: int, registers: Registers | None = None
    ) -> None:
        self._neuron = neuron
        self._current = np.zeros((batch, size))
        self._voltage = np.zeros((batch, size))
        self._fired = np.zeros((batch, size), dtype=np.bool_)

    def step(self, arriving: FloatArray) -> tuple[BoolArray, FloatArray]:
        """Take the sums of weights that arrive, (batch, n); return the spikes, and the potentials that caused them."""
        n = self._neuron
        self._current = (1.0 - n.decay_u) * self._current + arriving
        # self._fired are still the spikes of the step before.
        self._voltage = (1.0 - n.decay_v) * self._voltage + self._current - n.drop * self._fired
        if n.floor is not None:
            self._voltage = np.maximum(self._voltage, n.floor)
        self._fired = self._voltage > n.threshold
        return self._fired, self._voltage
