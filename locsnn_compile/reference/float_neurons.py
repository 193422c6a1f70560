"""Float neurons step by step in float64, as the network's author means them."""

import math
from collections import deque

import numpy as np

from hw_model.description.chip import Registers
from hw_model.values import BoolArray, FloatArray
from locsnn_compile.network.neurons import Cuba, SoftCuba, SrmAlpha, alpha_recursion


class SrmSteps:
    """SRM neurons (batch, n), with both kernels in recursive form, full or cut.

    Two first-order filters with decay a, one behind the other, answer a spike with k * a^(k-1), k steps
    later; a kernel is c = e * a / tau times that. ``registers`` is not used: all kinds of neurons are made
    alike, those of the chip too.
    """

    def __init__(
        self, neuron: SrmAlpha, batch: int, size: int, registers: Registers | None = None
    ) -> None:
        self._theta = neuron.theta
        self._a, self._gain = alpha_recursion(neuron.tau_sr)
        height_of_nu = -neuron.scale_ref * neuron.theta
        self._refractory_a, self._refractory_gain = alpha_recursion(neuron.tau_ref, height_of_nu)
        self._eps_cut = _cut_after(neuron.eps_taps, self._a)
        self._nu_cut = _cut_after(neuron.nu_taps, self._refractory_a)
        self._current = np.zeros((batch, size))
        self._response = np.zeros((batch, size))
        self._refractory_current = np.zeros((batch, size))
        self._refractory = np.zeros((batch, size))
        self._fired = np.zeros((batch, size), dtype=np.bool_)

    def step(self, arriving: FloatArray) -> tuple[BoolArray, FloatArray]:
        """Take the weights that arrive, (batch, n); return the spikes, and the potential that decided them."""
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
    """Return what ends a kernel; None for one that goes on."""
    return None if math.isinf(taps) else KernelCut(int(taps), a)


class KernelCut:
    """Ends a kernel ``k a^(k-1)`` after its first K = ``taps`` values (with lag 0), by changing its filter's input.

    From lag K on, the kernel equals K a^(K-1) times itself K - 1 steps later, minus (K - 1) a^K times itself K steps
    later. Both are subtracted.
    """

    def __init__(self, taps: int, a: float) -> None:
        self._taps = taps
        self._of_last_lag = taps * a ** (taps - 1)
        self._of_lag_beyond = (taps - 1) * a**taps
        self._past: deque[FloatArray] = deque(maxlen=taps + 1)

    def step(self, x: FloatArray | BoolArray) -> FloatArray:
        """Take what arrives; return what the filter of the full kernel must get instead."""
        past = self._past
        past.append(np.array(x, dtype=np.float64))
        cut = past[-1].copy()
        if len(past) >= self._taps:
            cut -= self._of_last_lag * past[-self._taps]
        if len(past) > self._taps:
            cut += self._of_lag_beyond * past[0]
        return cut


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
        """Take the weights that arrive, (batch, n); return spikes and the potential before the reset."""
        n = self._neuron
        self._current = (1.0 - n.decay_u) * self._current + arriving
        is_blocked = self._blocked_steps > 0
        potential = (1.0 - n.decay_v) * self._voltage + self._current + n.bias
        if n.floor is not None:
            potential = np.maximum(potential, n.floor)
        # A blocked neuron is at rest, whatever its floor is.
        potential = np.where(is_blocked, 0.0, potential)
        if n.rule == ">":
            reaches = potential > n.threshold
        else:
            reaches = potential >= n.threshold
        fired: BoolArray = reaches & ~is_blocked
        self._voltage = np.where(fired, 0.0, potential)
        one_less = np.maximum(self._blocked_steps - 1, 0)
        # The step of the spike is the first of them.
        self._blocked_steps = np.where(fired, n.refractory - 1, one_less)
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
        """Take the weights that arrive, (batch, n); return spikes and the potential that decided them."""
        n = self._neuron
        self._current = (1.0 - n.decay_u) * self._current + arriving
        self._voltage = (1.0 - n.decay_v) * self._voltage + self._current - n.drop * self._fired
        if n.floor is not None:
            self._voltage = np.maximum(self._voltage, n.floor)
        self._fired = self._voltage > n.threshold
        return self._fired, self._voltage
