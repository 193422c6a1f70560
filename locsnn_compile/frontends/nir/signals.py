"""The input of a node in a linear network: a sum of delayed, weighted spikes, and of constants."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from scipy import sparse

from hw_model.values import FloatArray, Frozen, IntArray, sealed
from locsnn_compile.frontends.linear_maps import product
from locsnn_compile.network.projections import Matrix, Projection, matrix

DENSE = 0.5
"""Share of connections from which a matrix is kept dense."""


class Term(Frozen, eq=False):
    """Spikes of one source through weights (n, n_source), CSR, after ``delay`` whole steps."""

    source: str
    delay: int
    weights: Any


class Onset(Frozen, eq=False):
    """A constant ``values`` (n,), which arrives from step ``delay`` on: a bias behind delays."""

    delay: int
    values: FloatArray


class Signal(Frozen, eq=False):
    """The sum of terms and of constants, at ``size`` values.

    ``constants`` have one entry per delay, in ascending order; most signals have one of delay 0.
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
        """Return it with ``values`` (size,) added from step ``delay`` on."""
        constants = _summed((*self.constants, Onset(delay, values)))
        return Signal(self.size, self.terms, constants)

    @classmethod
    def of_source(cls, name: str, size: int) -> Signal:
        """Return the spikes of a source, unchanged."""
        return cls(size, (Term(name, 0, sparse.csr_array(sparse.eye_array(size))),))

    @classmethod
    def total(cls, parts: Iterable[Signal], size: int) -> Signal:
        """Return the sum of signals; 0 if there are none."""
        signals = tuple(parts)
        terms = tuple(term for signal in signals for term in signal.terms)
        constants = [onset for signal in signals for onset in signal.constants]
        return cls(size, terms, _summed(constants))

    def through(self, weights: Any, constant: FloatArray | float, where: str) -> Signal:
        """Return the output of a linear layer with weights (m, n) and a constant for this signal."""
        terms = tuple(
            Term(t.source, t.delay, product(weights, t.weights, where)) for t in self.terms
        )
        size = weights.shape[0]
        passed = tuple(Onset(c.delay, weights @ c.values) for c in self.constants)
        signal = Signal(size, terms, passed)
        added = np.broadcast_to(np.asarray(constant, dtype=np.float64), (size,))
        return signal.plus(added) if added.any() else signal

    def scaled(self, factor: FloatArray, of_constants: FloatArray | None = None) -> Signal:
        """Return it with each value multiplied by its factor, (n,).

        Constants are multiplied by ``of_constants`` (n,), by default by the same factor.
        """
        rows = sparse.diags_array(factor)
        terms = tuple(Term(t.source, t.delay, rows @ t.weights) for t in self.terms)
        gain = factor if of_constants is None else of_constants
        constants = tuple(Onset(c.delay, c.values * gain) for c in self.constants)
        return Signal(self.size, terms, constants)

    def delayed(self, steps: IntArray) -> Signal:
        """Return it with each value delayed by its own number of steps, (n,)."""
        # For every number of steps, a mask (n,): 1.0 for the values that are delayed by so many, else 0.0.
        mask_of = {late: (steps == late).astype(np.float64) for late in np.unique(steps).tolist()}
        terms = tuple(
            Term(term.source, term.delay + late, sparse.diags_array(mask) @ term.weights)
            for term in self.terms
            for late, mask in mask_of.items()
        )
        constants = [
            Onset(onset.delay + late, mask * onset.values)
            for onset in self.constants
            for late, mask in mask_of.items()
        ]
        return Signal(self.size, terms, _summed(constants))

    def aligned(self, late: Mapping[str, int]) -> Signal:
        """Return it with the spikes of each source delayed by ``late[source]`` more steps, as far as they can be."""
        terms = (Term(t.source, max(t.delay + late[t.source], 0), t.weights) for t in self.terms)
        return Signal(self.size, tuple(terms), self.constants)

    def projections(self, target: str) -> tuple[Projection, ...]:
        """Return the projections of the terms: one per source, unless a connection has several delays."""
        by_source: dict[str, dict[int, Any]] = {}
        for term in self.terms:
            by_delay = by_source.setdefault(term.source, {})
            before = by_delay.get(term.delay)
            by_delay[term.delay] = term.weights if before is None else before + term.weights
        return tuple(
            Projection(source, target, weights, delay)
            for source, by_delay in by_source.items()
            for weights, delay in _joined(by_delay)
        )


def as_column(values: FloatArray) -> Any:
    """Return the weights (n, 1) of a source of one neuron."""
    return sparse.csr_array(values[:, None])


def on_diagonal(values: FloatArray) -> Any:
    """Return the weights (n, n) by which each of n neurons reaches the neuron of its own number."""
    return sparse.csr_array(sparse.diags_array(values))


def _summed(constants: Iterable[Onset]) -> tuple[Onset, ...]:
    """Return constants with one entry per delay, in ascending order; those of zeros are left out."""
    by_delay: dict[int, FloatArray] = {}
    for onset in constants:
        before = by_delay.get(onset.delay)
        by_delay[onset.delay] = onset.values if before is None else before + onset.values
    return tuple(Onset(delay, values) for delay, values in sorted(by_delay.items()) if values.any())


def _joined(by_delay: Mapping[int, Any]) -> list[tuple[Matrix, int | IntArray]]:
    """Return pairs (weights, delay) for one source: a single pair with an array of delays if no connection has two."""
    canonical = {delay: _canonical(weights) for delay, weights in by_delay.items()}
    connected = {delay: weights for delay, weights in canonical.items() if weights.nnz}
    if not connected:
        # A source without a connection still has a projection: one of zeros.
        delay, weights = next(iter(canonical.items()))
        return [(compact(weights), delay)]
    anywhere = _canonical(sum(abs(weights) for weights in connected.values()))
    has_two_delays = anywhere.nnz != sum(weights.nnz for weights in connected.values())
    if len(connected) == 1 or has_two_delays:
        return [(compact(weights), delay) for delay, weights in connected.items()]
    total = matrix(sum(connected.values()), np.float64)
    # One is added to delays, because a sparse matrix cannot hold a delay of 0 next to entries that are not stored.
    one_more = sum((weights != 0) * (delay + 1) for delay, weights in connected.items())
    return [(total, sealed(matrix(one_more, np.int64).data - 1))]


def _canonical(weights: Any) -> Any:
    """Return weights in CSR with one entry for each connection, and none of 0."""
    copied = sparse.csr_array(weights, copy=True)
    copied.sum_duplicates()
    copied.eliminate_zeros()
    return copied


def compact(weights: Any) -> Matrix:
    """Return canonical weights as the levels hold them: dense if most connections exist, else CSR."""
    rows, columns = weights.shape
    is_dense = weights.nnz >= DENSE * rows * columns
    return matrix(weights.toarray() if is_dense else weights, np.float64)
