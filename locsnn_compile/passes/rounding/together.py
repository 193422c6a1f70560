"""Round the weights onto a neuron together, so that their errors cancel in its potential.

Over calibration recordings the mean squared error of a potential is ``(q - w) G (q - w)^T``: w (n,) the ideal weights,
q the rounded ones, G (n, n) the Gram matrix of what the neuron's inputs add to it. Finding the least is a closest
vector problem. Weights are rounded one after the other, the inputs of most power first, and each rounding error is made
up for by those that follow, through the Cholesky factor of the inverse of G. That is optimal brain quantisation in a
fixed order (Frantar and others, GPTQ, 2022; Babai's nearest plane). At every weight both neighbours are tried, and the
best few of all roundings so far go on (the M-algorithm of sphere decoding).
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from hw_model.arithmetic.fixed_point import IntArray

FloatArray = npt.NDArray[np.float64]

ROWS = 16
"""Neurons that are worked on at a time, so that their candidates stay in the cache."""


def round_together(gram: FloatArray, ideal: FloatArray, step: IntArray, most: IntArray, beam: int) -> IntArray:
    """Return whole multiples of ``step`` (m, n), at most ``most`` in magnitude, near ``ideal`` (m, n) in the metric G.

    ``gram`` is positive definite. Where ``step`` is 0, the weight is 0. ``beam`` candidates a neuron go on at a time.
    """
    order = np.argsort(-np.diag(gram), kind="stable")
    inverse = np.linalg.inv(gram[np.ix_(order, order)])
    factor: FloatArray = np.linalg.cholesky((inverse + inverse.T) / 2).T.astype(np.float64)
    rounded = np.empty(ideal.shape, dtype=np.int64)
    for start in range(0, len(ideal), ROWS):
        rows = slice(start, start + ROWS)
        sorted_parts = [part[rows, order].astype(np.float64) for part in (ideal, step, most)]
        rounded[rows, order] = _beam(factor, *sorted_parts, beam=beam)
    return rounded


def _beam(factor: FloatArray, ideal: FloatArray, step: FloatArray, most: FloatArray, *, beam: int) -> IntArray:
    """Round columns left to right; ``left`` (m, candidates, n) is what the columns should still be."""
    m, n = ideal.shape
    left, taken, cost = ideal[:, None].copy(), np.zeros((m, 1, n)), np.zeros((m, 1))
    row = np.arange(m)[:, None]
    for j in range(n):
        unit, limit = step[:, None, j], most[:, None, j]
        with np.errstate(divide="ignore", invalid="ignore"):
            below = np.where(unit > 0, np.floor(left[:, :, j] / unit), 0.0) * unit
        tried = np.clip(np.stack((below, below + unit), axis=2), -limit[:, :, None], limit[:, :, None])
        error = (left[:, :, j, None] - tried) / factor[j, j]
        costs = cost[:, :, None] + error**2
        # Equal neighbours are one.
        costs[:, :, 1] = np.where(tried[:, :, 0] == tried[:, :, 1], np.inf, costs[:, :, 1])
        costs, error, tried = (part.reshape(m, -1) for part in (costs, error, tried))
        best = np.argsort(costs, axis=1, kind="stable")[:, :beam]
        cost = costs[row, best]
        left, taken = left[row, best // 2], taken[row, best // 2]
        taken[:, :, j] = tried[row, best]
        left[:, :, j + 1 :] -= error[row, best][:, :, None] * factor[j, j + 1 :]
    return np.rint(taken[:, 0]).astype(np.int64)
