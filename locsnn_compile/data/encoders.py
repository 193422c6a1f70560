"""Encode plain numbers as spikes: by rate, by latency, or where a signal crosses levels.

Every encoding loses precision. The result therefore also has the numbers that a decoder would read
from the spikes, and how far these are from the numbers that were encoded.
"""

import numpy as np

from hw_model.values import BoolArray, ByteArray, FloatArray, Frozen, IntArray
from locsnn_compile.data.channels import Channels
from locsnn_compile.data.recordings import MAX_ELEMENTS, MAX_STEPS, Recordings
from locsnn_compile.errors import InputError, check_most

_RATE_AXES = ("samples", "channels")
_SIGNAL_AXES = ("samples", "steps", "signals")


class Encoded(Frozen, eq=False):
    """Numbers, their spikes, and what the spikes still say of the numbers.

    - ``spikes``: uint8 (samples, steps, channels), 0 or 1
    - ``values``: what was encoded; ``decoded``: what the spikes stand for, of the same shape
    - ``channels``: what the channels are, None if each is one of the values
    """

    spikes: ByteArray
    values: FloatArray
    decoded: FloatArray
    channels: Channels | None = None

    @property
    def rms_error(self) -> float:
        """The root of the mean square of ``decoded - values``, in their unit."""
        return float(np.sqrt(np.mean((self.decoded - self.values) ** 2)))

    @property
    def largest_error(self) -> float:
        """The largest ``abs(decoded - values)``, in their unit."""
        return float(np.abs(self.decoded - self.values).max())

    def recordings(
        self,
        *,
        labels: IntArray | None = None,
        step_seconds: float | None = None,
        source: str = "encoded",
    ) -> Recordings:
        """Return the spikes as recordings, with class numbers (samples,) and the width of a step."""
        return Recordings(self.spikes, labels, step_seconds, source, channels=self.channels)


def rate_spikes(values: FloatArray, steps: int, *, seed: int) -> Encoded:
    """Encode values (samples, channels) from 0 to 1 as the chance of a spike in each step.

    Decoded by ``spikes.mean(steps)``. A value p is lost by chance, with a standard deviation of
    ``sqrt(p (1 - p) / steps)``: at most ``0.5 / sqrt(steps)``. The same seed gives the same spikes.
    Raises ``InputError`` for other shapes, values out of range, and sizes above the limits.
    """
    values = _shares(values)
    samples, channels = values.shape
    _check_steps(steps, least=1)
    _check_spike_count(samples, steps, channels)
    generator = np.random.default_rng(seed)
    spikes = np.empty((samples, steps, channels), dtype=np.uint8)
    # Sample by sample, because a random number takes eight times the memory of a spike.
    for sample in range(samples):
        spikes[sample] = generator.random((steps, channels)) < values[sample]
    return Encoded(spikes, values, spikes.mean(axis=1))


def latency_spikes(values: FloatArray, steps: int) -> Encoded:
    """Encode values (samples, channels) from 0 to 1 as one spike each, the larger the earlier.

    A value v spikes in step ``round((1 - v) (steps - 1))``, half to even, and is decoded by
    ``1 - step / (steps - 1)``: it is lost by at most ``0.5 / (steps - 1)``. Raises ``InputError`` for
    other shapes, values out of range, fewer than two steps, and sizes above the limits.
    """
    values = _shares(values)
    samples, channels = values.shape
    _check_steps(steps, least=2)
    _check_spike_count(samples, steps, channels)
    last_step = steps - 1
    spike_step = np.rint((1 - values) * last_step).astype(np.int64)
    spikes = np.zeros((samples, steps, channels), dtype=np.uint8)
    np.put_along_axis(spikes, spike_step[:, None, :], 1, axis=1)
    return Encoded(spikes, values, 1 - spike_step / last_step)


def level_spikes(signals: FloatArray, threshold: float) -> Encoded:
    """Encode signals (samples, steps, signals) by a spike where one has moved by a threshold.

    Signal c spikes on channel 2 c + 1 where it has risen by ``threshold`` since the level of its last
    spike, and on channel 2 c where it has fallen by it; the level moves by the threshold. Levels start
    at the first value, which the spikes do not hold, and are the decoded signals: they are off by less
    than the threshold, unless a signal moves by more than that in a step, because there is one spike
    a step at most. Raises ``InputError`` for other shapes, values that are not finite, a threshold that
    is not above 0, and sizes above the limits.
    """
    signals = _finite_numbers(signals, _SIGNAL_AXES)
    samples, steps, signal_count = signals.shape
    channels = 2 * signal_count
    _check_steps(steps, least=1)
    _check_spike_count(samples, steps, channels)
    _check_threshold(threshold)
    spikes = np.zeros((samples, steps, channels), dtype=np.uint8)
    decoded = np.empty_like(signals)
    level = signals[:, 0].copy()
    for step in range(steps):
        distance = signals[:, step] - level
        has_risen = distance >= threshold
        has_fallen = distance <= -threshold
        spikes[:, step, 1::2] = has_risen
        spikes[:, step, 0::2] = has_fallen
        # By one threshold per step at most, because there is one spike per step at most.
        level += threshold * (has_risen.astype(np.float64) - has_fallen)
        decoded[:, step] = level
    return Encoded(spikes, signals, decoded, Channels(signal_count, rows=1, polarities=2))


def _shares(values: FloatArray) -> FloatArray:
    """Return numbers (samples, channels) from 0 to 1 in float64; ``InputError`` for others."""
    numbers = _numbers(values, _RATE_AXES)
    # Written so that a number that is not finite is out of range as well.
    is_share = (numbers >= 0.0) & (numbers <= 1.0)
    _check_all(is_share, numbers, fix="Scale them to 0..1.")
    return numbers


def _finite_numbers(values: FloatArray, axes: tuple[str, ...]) -> FloatArray:
    """Return numbers of some axes that are finite; ``InputError`` for others."""
    numbers = _numbers(values, axes)
    _check_all(np.isfinite(numbers), numbers, fix="Give finite numbers.")
    return numbers


def _numbers(values: FloatArray, axes: tuple[str, ...]) -> FloatArray:
    """Return real numbers in float64; ``InputError`` for other types and axes, and for no numbers."""
    array = np.asarray(values)
    is_real = array.dtype.kind in "biuf"
    if array.ndim != len(axes) or not is_real or array.size == 0:
        what = f"they are not numbers of axes ({', '.join(axes)})"
        measured = f"{array.dtype} of shape {array.shape}"
        raise InputError("values", what, measured=measured, fix="Give such an array.")
    return array.astype(np.float64)


def _check_all(is_valid: BoolArray, numbers: FloatArray, *, fix: str) -> None:
    """Refuse numbers that are not all valid, and show the first that is not."""
    if not is_valid.all():
        measured = f"{numbers[~is_valid][0]:g}"
        raise InputError("values", "one is out of range", measured=measured, fix=fix)


def _check_threshold(threshold: float) -> None:
    is_valid = np.isfinite(threshold) and threshold > 0
    if not is_valid:
        what = "it is not above 0"
        raise InputError("threshold", what, measured=f"{threshold}", fix="Give a positive number.")


def _check_steps(steps: int, *, least: int) -> None:
    if not least <= steps <= MAX_STEPS:
        measured = f"{steps} against {least} to {MAX_STEPS}"
        what = "their number is out of range"
        raise InputError("steps", what, measured=measured, fix="Give another number.")


def _check_spike_count(samples: int, steps: int, channels: int) -> None:
    """Refuse spikes that would take too much memory: each takes a byte, whether it is 0 or 1."""
    elements = samples * steps * channels
    what = "their spikes are too many"
    check_most(elements, MAX_ELEMENTS, "values", what, fix="Give fewer samples or steps.")
