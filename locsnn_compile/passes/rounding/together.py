"""Round the weights onto a neuron together, so that their errors cancel in its potential.

Over calibration recordings, the mean squared error of a potential is ``(q - w) G (q - w)^T``, where w (n,) are the
ideal weights, q the rounded ones, and G (n, n) is the Gram matrix of what the neuron's inputs add to it. Finding the
minimum is a closest vector problem. Weights are rounded one after the other, starting with the inputs of most power,
and later weights compensate for each rounding error. With U, the upper triangular factor of the inverse of G
(``G^-1 = U^T U``), weight c is rounded to q_c, and the targets of all later weights j move:

    e_c = (w_c - q_c) / U_cc            cost  += e_c^2
    w_j = w_j - e_c U_cj                for j > c

When all are rounded, the cost is the squared error above. This is optimal brain quantisation in a fixed order (Frantar
and others, GPTQ, 2022; Babai's nearest plane). For every weight, the multiples of its step below and above the target
are tried, and the best few roundings so far are continued (the M-algorithm of sphere decoding, a beam search).
"""

import numpy as np

from hw_model.values import FloatArray, Frozen, IntArray

CANDIDATES = 256
"""Number of candidates, over all neurons, that are worked on at a time, so that they stay in the cache; by hand."""


class Metric(Frozen, eq=False):
    """A Gram matrix G (n, n) of n inputs, prepared for rounding.

    - ``order`` (n,): the order in which the columns are rounded, largest power first
    - ``factor`` (n, n): U, upper triangular; the inverse of G in this order is ``factor.T @ factor``
    """

    order: IntArray
    factor: FloatArray

    @classmethod
    def of(cls, gram: FloatArray) -> "Metric":
        """Return the metric of a positive definite matrix."""
        power = np.diag(gram)
        order = np.argsort(-power, kind="stable")
        inverse = np.linalg.inv(gram[np.ix_(order, order)])
        # Rounding leaves the inverse not quite symmetric.
        symmetric = (inverse + inverse.T) / 2
        return cls(order, np.linalg.cholesky(symmetric).T.astype(np.float64))


def round_together(
    metric: Metric, ideal: FloatArray, step: IntArray, largest: IntArray, beam: int
) -> IntArray:
    """Return weights of m neurons with n inputs, (m, n), near ``ideal`` (m, n) in the metric G.

    They are whole multiples of ``step`` (m, n), and ``largest`` (m, n) at most, a multiple itself, in magnitude.
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
            largest[rows, metric.order].astype(np.float64),
        )
        rounded[rows, metric.order] = search.run(beam)
    return rounded


class _Search:
    """A beam search over the columns, from left to right, for m neurons at once.

    A *candidate* is a rounding of the columns so far. The arguments have their columns in the order of the metric.

    - ``targets`` (m, candidates, columns left): the values near which the remaining columns are to be rounded
    - ``cost`` (m, candidates): the squared error so far
    - ``neuron`` (m,): the numbers 0 to m - 1, which index the first axis of arrays
    - ``values`` and ``came_from``: by column, the value that each candidate took, and the number of
      the candidate of the column before that it continues
    """

    def __init__(
        self, factor: FloatArray, ideal: FloatArray, step: FloatArray, largest: FloatArray
    ) -> None:
        self.factor = factor
        self.step = step
        self.largest = largest
        self.targets = ideal[:, None]
        self.cost = np.zeros((len(ideal), 1))
        self.neuron = np.arange(len(ideal))
        self.values: list[FloatArray] = []
        self.came_from: list[IntArray] = []

    def run(self, beam: int) -> IntArray:
        """Round all columns; return the best rounding of every neuron (m, n)."""
        for column in range(len(self.factor)):
            self._round_column(column, beam)
        return self._trace_best()

    def _round_column(self, column: int, beam: int) -> None:
        """Continue every candidate by both neighbours of its target, and keep the best ``beam``."""
        neurons = len(self.neuron)
        diagonal = self.factor[column, column]
        target = self.targets[:, :, :1]
        values = self._neighbours(column)
        # Both neighbours of every candidate: (m, candidates, 2).
        error = (target - values) / diagonal
        cost = self.cost[:, :, None] + error**2
        # Clipping, or a step of 0, can make both neighbours equal; the same rounding must not fill two places.
        are_equal = values[:, :, 0] == values[:, :, 1]
        cost[:, :, 1] = np.where(are_equal, np.inf, cost[:, :, 1])

        flat_cost = cost.reshape(neurons, -1)
        best = np.argsort(flat_cost, axis=1, kind="stable")[:, :beam]
        neuron = self.neuron[:, None]
        # The candidate whose two neighbours share this place of the flat array.
        continued = best // 2
        self.cost = flat_cost[neuron, best]
        self.came_from.append(continued)
        self.values.append(values.reshape(neurons, -1)[neuron, best])
        # The remaining columns compensate for the error of this one.
        error_of_best = error.reshape(neurons, -1)[neuron, best]
        self.targets = self.targets[neuron, continued, 1:]
        self.targets -= error_of_best[:, :, None] * self.factor[column, column + 1 :]

    def _neighbours(self, column: int) -> FloatArray:
        """Return the multiples of the step below and above each target, (m, candidates, 2)."""
        step = self.step[:, None, column]
        largest = self.largest[:, None, column, None]
        # A step of 0 only has the multiple 0; dividing by 1 instead avoids a division by 0.
        steps_below = np.floor(self.targets[:, :, 0] / np.where(step > 0, step, 1.0))
        below = steps_below * step
        return np.clip(np.stack((below, below + step), axis=2), -largest, largest)

    def _trace_best(self) -> IntArray:
        """Return the values of the cheapest candidate of every neuron, by tracing it back from the last column.

        Candidates are sorted by cost, so the cheapest is number 0.
        """
        columns = len(self.values)
        rounded = np.empty((len(self.neuron), columns))
        candidate = np.zeros(len(self.neuron), dtype=np.int64)
        for column in reversed(range(columns)):
            rounded[:, column] = self.values[column][self.neuron, candidate]
            candidate = self.came_from[column][self.neuron, candidate]
        return np.rint(rounded).astype(np.int64)
