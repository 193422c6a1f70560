"""Round the weights onto a neuron together, so that their errors cancel in its potential.

Over calibration recordings, the mean squared error of a potential is ``(q - w) G (q - w)^T``, where w (n,) are the
ideal weights, q the rounded ones, and G (n, n) is the Gram matrix of what the neuron's inputs add to it. Finding the
minimum is a closest vector problem. Weights are rounded one after the other, starting with the inputs of most power,
and later weights compensate for each rounding error, through the Cholesky factor of the inverse of G. This is optimal
brain quantisation in a fixed order (Frantar and others, GPTQ, 2022; Babai's nearest plane). For every weight both
neighbours are tried, and the best few roundings so far are continued (the M-algorithm of sphere decoding).
"""

import numpy as np

from hw_model.values import FloatArray, Frozen, IntArray

CANDIDATES = 256
"""Number of candidates, over all neurons, that are worked on at a time, so that they stay in the cache."""


class Metric(Frozen, eq=False):
    """The ``order`` in which the columns of a Gram matrix (n, n) are rounded, and the ``factor`` of its inverse."""

    order: IntArray
    factor: FloatArray

    @classmethod
    def of(cls, gram: FloatArray) -> "Metric":
        """Return the metric of a positive definite matrix."""
        order = np.argsort(-np.diag(gram), kind="stable")
        inverse = np.linalg.inv(gram[np.ix_(order, order)])
        return cls(order, np.linalg.cholesky((inverse + inverse.T) / 2).T.astype(np.float64))


def round_together(
    metric: Metric, ideal: FloatArray, step: IntArray, most: IntArray, beam: int
) -> IntArray:
    """Return whole multiples of ``step`` (m, n), at most ``most`` in magnitude, near ``ideal`` (m, n) in the metric G.

    Where ``step`` is 0, the weight is 0. ``beam`` candidates per neuron are continued.
    """
    rounded = np.empty(ideal.shape, dtype=np.int64)
    at_once = max(1, CANDIDATES // beam)
    for start in range(0, len(ideal), at_once):
        rows = slice(start, start + at_once)
        sorted_parts = [part[rows, metric.order].astype(np.float64) for part in (ideal, step, most)]
        rounded[rows, metric.order] = _beam(metric.factor, *sorted_parts, beam=beam)
    return rounded


def _beam(
    factor: FloatArray, ideal: FloatArray, step: FloatArray, most: FloatArray, *, beam: int
) -> IntArray:
    """Round columns from left to right; ``left`` (m, candidates, columns) holds the targets of the remaining ones."""
    m, n = ideal.shape
    left, cost, row = ideal[:, None], np.zeros((m, 1)), np.arange(m)[:, None]
    came_from, taken = [], []
    for j in range(n):
        unit, limit = step[:, None, j], most[:, None, j]
        below = np.floor(left[:, :, 0] / np.where(unit > 0, unit, 1.0)) * unit
        tried = np.clip(
            np.stack((below, below + unit), axis=2), -limit[:, :, None], limit[:, :, None]
        )
        error = (left[:, :, :1] - tried) / factor[j, j]
        costs = cost[:, :, None] + error**2
        # Equal neighbours count once.
        costs[:, :, 1] = np.where(tried[:, :, 0] == tried[:, :, 1], np.inf, costs[:, :, 1])
        costs, error, tried = (part.reshape(m, -1) for part in (costs, error, tried))
        best = np.argsort(costs, axis=1, kind="stable")[:, :beam]
        cost = costs[row, best]
        came_from.append(best // 2)
        taken.append(tried[row, best])
        left = left[row, came_from[-1], 1:]
        left -= error[row, best][:, :, None] * factor[j, j + 1 :]
    rounded, one, number = np.empty((m, n)), row[:, 0], np.zeros(m, dtype=np.int64)
    for j in reversed(range(n)):
        rounded[:, j] = taken[j][one, number]
        number = came_from[j][one, number]
    return np.rint(rounded).astype(np.int64)
