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
    """What is needed of a Gram matrix G (n, n) of n inputs.

    - ``order`` (n,): in which its columns are rounded
    - ``factor`` (n, n): upper triangular; the inverse of G in this order is ``factor.T @ factor``
    """

    order: IntArray
    factor: FloatArray

    @classmethod
    def of(cls, gram: FloatArray) -> "Metric":
        """Return the metric of a positive definite matrix."""
        order = np.argsort(-np.diag(gram), kind="stable")
        inverse = np.linalg.inv(gram[np.ix_(order, order)])
        # Rounding leaves the inverse not quite symmetric.
        symmetric = (inverse + inverse.T) / 2
        return cls(order, np.linalg.cholesky(symmetric).T.astype(np.float64))


def round_together(
    metric: Metric, ideal: FloatArray, step: IntArray, most: IntArray, beam: int
) -> IntArray:
    """Return weights of m neurons with n inputs, (m, n), near ``ideal`` in the metric G.

    They are whole multiples of ``step`` (m, n), at most ``most`` (m, n) in magnitude, which is such a multiple itself.
    A step of 0 marks an input without a synapse, whose weight is 0. ``beam`` candidates per neuron are continued.
    """
    rounded = np.empty(ideal.shape, dtype=np.int64)
    neurons_at_once = max(1, CANDIDATES // beam)
    for start in range(0, len(ideal), neurons_at_once):
        rows = slice(start, start + neurons_at_once)
        search = _Search(
            metric.factor,
            ideal[rows, metric.order].astype(np.float64),
            step[rows, metric.order].astype(np.float64),
            most[rows, metric.order].astype(np.float64),
        )
        rounded[rows, metric.order] = search.run(beam)
    return rounded


class _Search:
    """The best roundings of the columns so far, from left to right, of m neurons.

    - ``targets`` (m, candidates, columns left): what the columns that are left are rounded near to
    - ``cost`` (m, candidates): the squared error so far
    - ``neuron`` (m,): the numbers 0 to m - 1, which pick something for each neuron from arrays
    - ``values`` and ``came_from``: by column, the value that each candidate took, and the number of
      the candidate that it continues
    """

    def __init__(
        self, factor: FloatArray, ideal: FloatArray, step: FloatArray, most: FloatArray
    ) -> None:
        self.factor = factor
        self.step = step
        self.most = most
        self.targets = ideal[:, None]
        self.cost = np.zeros((len(ideal), 1))
        self.neuron = np.arange(len(ideal))
        self.values: list[FloatArray] = []
        self.came_from: list[IntArray] = []

    def run(self, beam: int) -> IntArray:
        """Round all columns; return the best rounding of every neuron (m, n)."""
        for column in range(len(self.factor)):
            self._round(column, beam)
        return self._best()

    def _round(self, column: int, beam: int) -> None:
        """Continue every candidate by both neighbours of its target, and keep the best ``beam``."""
        neurons = len(self.neuron)
        own_factor = self.factor[column, column]
        target = self.targets[:, :, :1]
        values = self._neighbours(column)
        error = (target - values) / own_factor
        cost = self.cost[:, :, None] + error**2
        are_equal = values[:, :, 0] == values[:, :, 1]
        cost[:, :, 1] = np.where(are_equal, np.inf, cost[:, :, 1])  # equal neighbours count once

        flat_cost = cost.reshape(neurons, -1)
        best = np.argsort(flat_cost, axis=1, kind="stable")[:, :beam]
        neuron = self.neuron[:, None]
        continued = best // 2
        self.cost = flat_cost[neuron, best]
        self.came_from.append(continued)
        self.values.append(values.reshape(neurons, -1)[neuron, best])
        # The columns that are left make up for what this one is off.
        off = error.reshape(neurons, -1)[neuron, best]
        self.targets = self.targets[neuron, continued, 1:]
        self.targets -= off[:, :, None] * self.factor[column, column + 1 :]

    def _neighbours(self, column: int) -> FloatArray:
        """Return the multiples of the step below and above each target, (m, candidates, 2)."""
        step = self.step[:, None, column]
        most = self.most[:, None, column, None]
        steps_below = np.floor(self.targets[:, :, 0] / np.where(step > 0, step, 1.0))
        below = steps_below * step
        return np.clip(np.stack((below, below + step), axis=2), -most, most)

    def _best(self) -> IntArray:
        """Return the values on the way to the first candidate of every neuron, which costs least."""
        columns = len(self.values)
        rounded = np.empty((len(self.neuron), columns))
        candidate = np.zeros(len(self.neuron), dtype=np.int64)
        for column in reversed(range(columns)):
            rounded[:, column] = self.values[column][self.neuron, candidate]
            candidate = self.came_from[column][self.neuron, candidate]
        return np.rint(rounded).astype(np.int64)
