"""The input of a node in a network of linear nodes: a sum of delayed, weighted spikes, and of constants.

Linear nodes (weights, scales, delays, sums) turn one :class:`Signal` into another, so a chain of them becomes the
projections of one signal onto the next population.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from scipy import sparse

from hw_model.values import FloatArray, Frozen, IntArray, sealed
from locsnn_compile.frontends.linear_maps import product
from locsnn_compile.network.projections import Matrix, Projection, matrix

DENSE = 0.5
"""Share of possible connections from which a matrix is kept dense; chosen by hand."""


class Term(Frozen, eq=False):
    """Spikes of one source through weights (n, n_source), CSR, after ``delay`` whole steps."""

    source: str
    delay: int
    weights: Any


class Onset(Frozen, eq=False):
    """Constants ``values`` (n,) that arrive in every step from step ``delay`` on: a bias that passed delays."""

    delay: int
    values: FloatArray


class Signal(Frozen, eq=False):
    """The sum of ``terms`` and ``constants`` for ``size`` values, such as the inputs of so many neurons.

    ``constants`` have one entry per delay, in ascending order; most signals have at most one, of delay 0.
    """

    size: int
    terms: tuple[Term, ...]
    constants: tuple[Onset, ...] = ()

    @property
    def constant(self) -> FloatArray:
        """The sum of all constants, (size,): what arrives in every step once all have set in."""
        total = np.zeros(self.size)
        for onset in self.constants:
            total += onset.values
        return total

    def plus(self, values: FloatArray, delay: int = 0) -> Signal:
        """Return the signal with ``values`` (size,) added from step ``delay`` on."""
        constants = _summed((*self.constants, Onset(delay, values)))
        return Signal(self.size, self.terms, constants)

    @classmethod
    def of_source(cls, name: str, size: int) -> Signal:
        """Return the spikes of a source, unchanged."""
        return cls(
            size, (Term(source=name, delay=0, weights=sparse.csr_array(sparse.eye_array(size))),)
        )

    @classmethod
    def total(cls, parts: Iterable[Signal], size: int) -> Signal:
        """Return the sum of signals; 0 if there are none."""
        signals = tuple(parts)
        terms = tuple(term for signal in signals for term in signal.terms)
        constants = [onset for signal in signals for onset in signal.constants]
        return cls(size, terms, _summed(constants))

    def through(self, weights: Any, constant: FloatArray | float, where: str) -> Signal:
        """Return ``weights @ signal + constant``, the output of a layer with weights (m, n) and a constant (m,)."""
        terms = tuple(
            Term(t.source, t.delay, product(weights, t.weights, where)) for t in self.terms
        )
        size = weights.shape[0]
        passed = tuple(Onset(c.delay, weights @ c.values) for c in self.constants)
        signal = Signal(size, terms, passed)
        bias = np.broadcast_to(np.asarray(constant, dtype=np.float64), (size,))
        return signal.plus(bias) if bias.any() else signal

    def scaled(self, factor: FloatArray, of_constants: FloatArray | None = None) -> Signal:
        """Return the signal with each value multiplied by its ``factor``, (n,).

        Constants are multiplied by ``of_constants`` (n,), by default by the same factor.
        """
        diagonal = sparse.diags_array(factor)
        terms = tuple(Term(t.source, t.delay, diagonal @ t.weights) for t in self.terms)
        gain = factor if of_constants is None else of_constants
        constants = tuple(Onset(c.delay, c.values * gain) for c in self.constants)
        return Signal(self.size, terms, constants)

    def delayed(self, steps: IntArray) -> Signal:
        """Return the signal with each value delayed by its own number of steps, (n,)."""
        # A term has one delay, so each is split into one per number of steps. The mask (n,) of a number of steps is 1.0
        # for the values with this delay, and 0.0 for all others.
        mask_of = {
            count: (steps == count).astype(np.float64) for count in np.unique(steps).tolist()
        }
        terms = tuple(
            Term(term.source, term.delay + count, sparse.diags_array(mask) @ term.weights)
            for term in self.terms
            for count, mask in mask_of.items()
        )
        constants = [
            Onset(onset.delay + count, mask * onset.values)
            for onset in self.constants
            for count, mask in mask_of.items()
        ]
        return Signal(self.size, terms, _summed(constants))

    def aligned(self, late: Mapping[str, int]) -> Signal:
        """Return the signal with the spikes of each source delayed by ``late[source]`` more steps.

        The number may be below 0; a delay is then shortened, to 0 at the least. (Constants are not sent by a source;
        the caller delays them.)
        """
        terms = (Term(t.source, max(t.delay + late[t.source], 0), t.weights) for t in self.terms)
        return Signal(self.size, tuple(terms), self.constants)

    def projections(self, target: str) -> tuple[Projection, ...]:
        """Return the projections of the terms: one per source, unless a connection has several delays."""
        by_source: dict[str, dict[int, Any]] = {}
        for term in self.terms:
            by_delay = by_source.setdefault(term.source, {})
            weights_so_far = by_delay.get(term.delay)
            if weights_so_far is None:
                by_delay[term.delay] = term.weights
            else:
                by_delay[term.delay] = weights_so_far + term.weights
        return tuple(
            Projection(source, target, weights, delay)
            for source, by_delay in by_source.items()
            for weights, delay in _joined(by_delay)
        )


def as_column(values: FloatArray) -> Any:
    """Return weights (n,) as the matrix (n, 1) of a source with one neuron."""
    return sparse.csr_array(values[:, None])


def on_diagonal(values: FloatArray) -> Any:
    """Return weights (n,) as the matrix (n, n) by which each of n neurons reaches the neuron of the same number."""
    return sparse.csr_array(sparse.diags_array(values))


def _summed(constants: Iterable[Onset]) -> tuple[Onset, ...]:
    """Return constants with one entry per delay, in ascending order; entries of zeros are left out."""
    by_delay: dict[int, FloatArray] = {}
    for onset in constants:
        values_so_far = by_delay.get(onset.delay)
        if values_so_far is None:
            by_delay[onset.delay] = onset.values
        else:
            by_delay[onset.delay] = values_so_far + onset.values
    return tuple(Onset(delay, values) for delay, values in sorted(by_delay.items()) if values.any())


def _joined(by_delay: Mapping[int, Any]) -> list[tuple[Matrix, int | IntArray]]:
    """Return pairs (weights, delay) for the projections of one source, given its weights by delay.

    If no connection has two delays, there is a single pair, with an array of delays. Otherwise there is one per delay.
    """
    canonical = {delay: _canonical(weights) for delay, weights in by_delay.items()}
    connected = {delay: weights for delay, weights in canonical.items() if weights.nnz}
    if not connected:
        # A source without a connection still has a projection: one of zeros.
        delay, weights = next(iter(canonical.items()))
        return [(compact(weights), delay)]
    # Connections with any delay; magnitudes, so that weights of different delays do not cancel.
    union = _canonical(sum(abs(weights) for weights in connected.values()))
    has_two_delays = union.nnz != sum(weights.nnz for weights in connected.values())
    if len(connected) == 1 or has_two_delays:
        return [(compact(weights), delay) for delay, weights in connected.items()]
    total = matrix(sum(connected.values()), np.float64)
    # Delays in the order of the weights' entries. One is added to them and taken away again, because a delay of 0 would
    # not be stored in a sparse matrix.
    one_more = sum((weights != 0) * (delay + 1) for delay, weights in connected.items())
    return [(total, sealed(matrix(one_more, np.int64).data - 1))]


def _canonical(weights: Any) -> Any:
    """Return weights as CSR with one entry per connection, and no entries of 0."""
    copied = sparse.csr_array(weights, copy=True)
    copied.sum_duplicates()
    copied.eliminate_zeros()
    return copied


def compact(weights: Any) -> Matrix:
    """Return canonical weights as a network holds them: dense from a share of :data:`DENSE` entries up, else CSR."""
    rows, columns = weights.shape
    is_dense = weights.nnz >= DENSE * rows * columns
    return matrix(weights.toarray() if is_dense else weights, np.float64)
