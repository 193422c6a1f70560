"""What the inputs of a population add to its potentials on calibration recordings, and what they should."""

from collections.abc import Sequence
from functools import cached_property
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np
from scipy import sparse

from hw_model.values import ByteArray, FloatArray, Frozen
from locsnn_compile.network.neurons import SrmAlpha, alpha_recursion
from locsnn_compile.network.projections import Projection
from locsnn_compile.passes.kernels import keeps
from locsnn_compile.passes.rounding.together import Metric
from locsnn_compile.reference.evaluate import CHUNK, Calibration

INPUTS_MAX = 2048
"""Inputs of a population beyond which their Gram matrix is not made."""
RIDGE = 0.16
"""Share of the inputs' mean power, over the number of recordings, by which weights are held where they are: the fewer
recordings, the less their correlations say of others."""


class Drive(Frozen, eq=False):
    """Moments of x (n,), what a weight of 1 on each input adds to the chip's potential at a step.

    ``gram`` (n, n): the mean of ``x x^T``, with a ridge on its diagonal. ``ideal`` (m, n): real weights whose mean
    squared error from the float potential is least, in the unit of the float potential. ``rate`` (n,): spikes of the
    inputs a recording. ``peak_current`` (m,): the largest magnitude of the current, in the unit of the potential.
    """

    gram: FloatArray
    ideal: FloatArray
    rate: FloatArray
    peak_current: FloatArray

    @cached_property
    def metric(self) -> Metric:
        """In which roundings are near to the ideal weights."""
        return Metric.of(self.gram)


_known: WeakKeyDictionary[Calibration, dict[Any, Drive | None]] = WeakKeyDictionary()
"""Drives by what they were made from: settings that are compared differ in what they round, seldom in these."""


def drive_of(
    neuron: SrmAlpha, incoming: Sequence[Projection], decays: tuple[int, int], gain: float, calibration: Calibration
) -> Drive | None:
    """Return the drive of SRM neurons through an alpha dendrite of these decays, whose kernel fits with this gain.

    None where there is none: weights that are sparse or have delays of their own, more inputs than
    :data:`INPUTS_MAX`, or silent ones.
    """
    known, asked = _known.setdefault(calibration, {}), (neuron, tuple(incoming), decays, gain)
    if asked not in known:
        known[asked] = _drive_of(neuron, incoming, decays, gain, calibration)
    return known[asked]


def _drive_of(
    neuron: SrmAlpha, incoming: Sequence[Projection], decays: tuple[int, int], gain: float, calibration: Calibration
) -> Drive | None:
    weights = [p.weights for p in incoming]
    if not incoming or any(sparse.issparse(w) for w in weights) or any(np.ndim(p.delay) for p in incoming):
        return None
    joined = np.hstack(weights)
    m, n = joined.shape
    if n > INPUTS_MAX:
        return None
    a, c = alpha_recursion(neuron.tau_sr)
    keep_u, keep_v = (float(keep) for keep in keeps(np.array(decays)))
    gram, wanted, rate, peak, steps = np.zeros((n, n)), np.zeros((m, n)), np.zeros(n), np.zeros(m), 0
    for start in range(0, calibration.samples, CHUNK):
        spikes = np.concatenate(
            [_arriving(calibration.spikes[p.source][start : start + CHUNK], p) for p in incoming], axis=2
        )
        x = _filtered(spikes, keep_u, keep_v).reshape(-1, n)
        exact = _filtered(spikes, a, a).reshape(-1, n) * c
        gram += x.T @ x
        wanted += (exact @ joined.T).T @ x
        rate += spikes.sum(axis=(0, 1))
        current = _filtered(spikes, keep_u, 0.0).reshape(-1, n) @ (gain * joined).T
        peak = np.maximum(peak, np.abs(current).max(axis=0))
        steps += len(x)
    power = float(np.trace(gram)) / n
    if power == 0.0:
        return None
    ridge = RIDGE / calibration.samples * power
    gram[np.diag_indices(n)] += ridge
    ideal = np.linalg.solve(gram, (wanted + ridge * gain * joined).T).T
    return Drive(gram / steps, ideal, rate / calibration.samples, peak)


def _arriving(spikes: ByteArray, p: Projection) -> FloatArray:
    """Return spikes (batch, steps, n) at the steps at which they arrive."""
    late = 1 + int(p.delay)
    shifted = np.zeros(spikes.shape)
    shifted[:, late:] = spikes[:, :-late]
    return shifted


def _filtered(arriving: FloatArray, keep_u: float, keep_v: float) -> FloatArray:
    """Return the answer of two decays in a row, (batch, steps, n)."""
    answer, before, twice_before = np.empty_like(arriving), *np.zeros((2, len(arriving), arriving.shape[2]))
    for step in range(arriving.shape[1]):
        np.add(arriving[:, step], before, out=answer[:, step])
        before = twice_before + (keep_u + keep_v) * answer[:, step]
        twice_before = -(keep_u * keep_v) * answer[:, step]
    return answer
