"""Float neurons step by step in float64, as the network's author means them."""

import math
from collections import deque

import numpy as np

from hw_model.description.chip import Registers
from hw_model.values import BoolArray, FloatArray
from locsnn_compile.network.neurons import Cuba, SoftCuba, SrmAlpha, alpha_recursion


class SrmSteps:
    """SRM neurons (batch, n), with both kernels in recursive form, full or cut.

    c * k * a^(k-1) is the response of two first-order filters with decay a in a row to a spike one step earlier, times
    c = e * a / tau.
    """

    def __init__(
        self, neuron: SrmAlpha, batch: int, size: int, registers: Registers | None = None
    ) -> None:
        self._theta = neuron.theta
        self._a, self._gain = alpha_recursion(neuron.tau_sr)
        own = -neuron.scale_ref * neuron.theta
        self._refractory_a, self._refractory_gain = alpha_recursion(neuron.tau_ref, own)
        self._current, self._response, self._refractory_current, self._refractory = np.zeros(
            (4, batch, size)
        )
        self._fired = np.zeros((batch, size), dtype=np.bool_)
        taps = (neuron.eps_taps, self._a), (neuron.nu_taps, self._refractory_a)
        self._cuts = [None if math.isinf(count) else _Cut(int(count), a) for count, a in taps]

    def step(self, arriving: FloatArray) -> tuple[BoolArray, FloatArray]:
        """Take the weights that arrive, (batch, n); return the spikes, and the potential that decided them."""
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
    """Ends a kernel ``k a^(k-1)`` after its first K values, counting lag 0, by changing the input of its filter.

    From lag K on, the kernel equals K a^(K-1) times itself K - 1 steps later, minus (K - 1) a^K times itself K steps
    later. Both are subtracted.
    """

    def __init__(self, taps: int, a: float) -> None:
        self._taps, self._near, self._far = taps, taps * a ** (taps - 1), (taps - 1) * a**taps
        self._past: deque[FloatArray] = deque(maxlen=taps + 1)

    def step(self, x: FloatArray | BoolArray) -> FloatArray:
        """Take what arrives; return what the filter of the full kernel must get instead."""
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

    def __init__(
        self, neuron: Cuba, batch: int, size: int, registers: Registers | None = None
    ) -> None:
        self._neuron = neuron
        self._current, self._voltage = np.zeros((2, batch, size))
        self._blocked = np.zeros((batch, size), dtype=np.int64)

    def step(self, arriving: FloatArray) -> tuple[BoolArray, FloatArray]:
        """Take the weights that arrive, (batch, n); return spikes and the potential before the reset."""
        n = self._neuron
        self._current = (1.0 - n.decay_u) * self._current + arriving
        held = self._blocked > 0
        potential = (1.0 - n.decay_v) * self._voltage + self._current + n.bias
        if n.floor is not None:
            potential = np.maximum(potential, n.floor)
        potential = np.where(held, 0.0, potential)
        above = potential > n.threshold if n.rule == ">" else potential >= n.threshold
        fired: BoolArray = above & ~held
        self._voltage = np.where(fired, 0.0, potential)
        self._blocked = np.where(fired, n.refractory - 1, np.maximum(self._blocked - 1, 0))
        return fired, potential


class SoftCubaSteps:
    """Leaky integrate-and-fire neurons (batch, n) with a current, from which a spike takes its drop."""

    def __init__(
        self, neuron: SoftCuba, batch: int, size: int, registers: Registers | None = None
    ) -> None:
        self._neuron = neuron
        self._current, self._voltage = np.zeros((2, batch, size))
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
