"""Weights: matrices (n_target, n_source), dense or scipy CSR, and the projections that hold them, in float or integers.

Passes treat both kinds of matrix alike, through the *values* of a matrix: for a dense matrix the array itself, for a
sparse one its stored entries, (entries,) row by row. A value of 0 is not a connection, stored or not.
"""

from functools import cached_property
from typing import Any, ClassVar, Literal, TypeAlias

import numpy as np
import numpy.typing as npt
from scipy import sparse

from hw_model.arithmetic.whole import whole_numbers
from hw_model.errors import InputError
from hw_model.values import (
    AnyArray,
    ArrayLike,
    ByteArray,
    FloatArray,
    Frozen,
    IntArray,
    Shown,
    sealed,
)

Values = AnyArray
Matrix: TypeAlias = Any
"""A numpy array (n_target, n_source), or a ``scipy.sparse.csr_array`` of that shape in canonical order."""


Signs = Literal["apart", "mixed"]
"""``apart``: separate formats for positive and negative weights, all bits for the magnitude. ``mixed``: both in one,
with one bit fewer for the magnitude."""


class Connection(Frozen, eq=False):
    """A projection of either kind, from a ``source`` to a ``target``."""

    source: str
    target: str

    @property
    def held(self) -> Matrix:
        """The matrix: weights in float, or mantissas."""
        raise NotImplementedError

    @property
    def where(self) -> str:
        """How errors name it."""
        return f"projection {self.source!r} -> {self.target!r}"

    @cached_property
    def fan_out(self) -> IntArray:
        """The number of targets of each source with a weight other than 0, (n_source,)."""
        return fan_out(self.held)


class Projection(Shown, Connection):
    """Weights (n_target, n_source), float64, dense or CSR, from an input view or a population to a population.

    A spike of step t acts at step ``t + 1 + delay``. ``delay`` is in steps: one for all, or an array like the values of
    the matrix, (n_target, n_source) or, if sparse, (entries,). The source may be the target, or come after it.
    """

    weights: Matrix
    delay: int | IntArray = 0

    on_grid: ClassVar[bool] = False
    """Whether the weights are the chip's integers already."""
    dendrite: ClassVar[int] = 0
    """Float weights always reach the first dendrite; ``ChipProjection`` has a field of this name."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "weights", held_matrix(self.weights, self.where))

    @property
    def held(self) -> Matrix:
        """The weights."""
        return self.weights


class ChipProjection(Shown, Connection):
    """Weights in the chip's integers: mantissas (n_target, n_source), int64, dense or CSR, with one exponent.

    The charge of a spike is ``64 floor(mantissa 2^exponent)``, as in :mod:`hw_model.arithmetic.loihi`.
    ``weight_bits`` and ``signs`` choose the grid of mantissas. ``delay`` is in steps: one for all, or an array like the
    values of the matrix. ``dendrite`` is the number of the target's alpha dendrite, from 0, that the charge reaches.
    Several projections may connect the same source and target; their weights add up.
    """

    mantissa: Matrix
    exponent: int
    weight_bits: int
    signs: Signs = "apart"
    delay: int | IntArray = 0
    dendrite: int = 0

    on_grid: ClassVar[bool] = True

    @property
    def held(self) -> Matrix:
        """The mantissas."""
        return self.mantissa


def matrix(weights: Any, dtype: npt.DTypeLike) -> Matrix:
    """Return a read-only copy: CSR with sorted entries and summed duplicates for a sparse matrix, or else an array.

    Numbers to be converted to integers must be whole.
    """
    if sparse.issparse(weights):
        csr = sparse.csr_array(weights, copy=True)
        csr.data = _of_type(csr.data, dtype)
        csr.sum_duplicates()
        for part in (csr.data, csr.indices, csr.indptr):
            part.setflags(write=False)
        return csr
    return sealed(_of_type(weights, dtype))


def held_matrix(weights: Any, where: str) -> Matrix:
    """Return weights as a read-only float64 matrix; a copy, unless they are one already."""
    is_sparse = sparse.issparse(weights)
    values = weights.data if is_sparse else weights
    is_canonical = not is_sparse or (weights.format == "csr" and weights.has_canonical_format)
    is_read_only = (
        isinstance(values, np.ndarray) and values.dtype == np.float64 and not values.flags.writeable
    )
    if is_read_only and is_canonical:
        return weights
    try:
        return matrix(weights, np.float64)
    except (TypeError, ValueError, OverflowError):
        fix = "Give one row per target and one column per source."
        raise InputError(where, "the weights are not an array of numbers", fix=fix) from None


def _of_type(numbers: ArrayLike, dtype: npt.DTypeLike) -> Values:
    """Return a copy as another type; raise ``TypeError`` for complex numbers, which numpy would cut with a warning."""
    if np.iscomplexobj(numbers):
        raise TypeError
    if np.issubdtype(dtype, np.integer):
        return whole_numbers(numbers)
    return np.array(numbers, dtype=dtype)


def values_of(m: Matrix) -> Values:
    """Return the values of a matrix: an array (n_target, n_source), or (entries,) if it is sparse."""
    values: Values = m.data if sparse.issparse(m) else m
    return values


def with_values(m: Matrix, values: Values) -> Matrix:
    """Return a matrix of the same connections with other values, shaped as :func:`values_of`; read-only."""
    sealed_values = sealed(values)
    if sparse.issparse(m):
        return sparse.csr_array((sealed_values, m.indices, m.indptr), shape=m.shape)
    return sealed_values


def of_target(m: Matrix, per_target: ArrayLike) -> Values:
    """Broadcast one number per target, (n_target,), to a shape that multiplies with the values of ``m``."""
    column = np.asarray(per_target)
    if not sparse.issparse(m):
        return column[:, None]
    entries_of_row = np.diff(m.indptr)
    return np.repeat(column, entries_of_row)


def of_source(m: Matrix, per_source: AnyArray) -> Values:
    """Broadcast one number per source, (n_source,), in the same way; a sparse matrix must be in canonical order."""
    return per_source[m.indices] if sparse.issparse(m) else per_source


def by_delay(m: Matrix, delay: int | IntArray) -> list[tuple[int, Matrix]]:
    """Split a matrix into one of equal shape per delay, (delay, matrix).

    ``delay``: one for all weights, or an array like the values. Weights of other delays are 0 in each matrix.
    """
    delays = np.asarray(delay)
    if delays.ndim == 0:
        return [(int(delays), m)]
    matrices = []
    for d in np.unique(delays):
        weights_of_delay = np.where(delays == d, values_of(m), 0)
        matrices.append((int(d), with_values(m, weights_of_delay)))
    return matrices


def connections(m: Matrix) -> tuple[IntArray, IntArray, IntArray]:
    """Return (target, source, index into the flat values) of all values except 0, ordered by source, then target.

    By source, because the chip stores the synapses of a source together.
    """
    target, source = (indices.astype(np.int64) for indices in m.nonzero())
    # Both nonzero() and flatnonzero() go row by row, so their entries correspond.
    index = np.flatnonzero(values_of(m))
    order = np.lexsort((target, source))
    return target[order], source[order], index[order]


def fan_out(m: Matrix) -> IntArray:
    """Return how many targets every source reaches with a weight other than 0, (n_source,)."""
    _, source = m.nonzero()
    return np.bincount(source, minlength=m.shape[1]).astype(np.int64)


def row_maxima(m: Matrix) -> FloatArray:
    """Return the largest magnitude among the weights of each target, (n_target,); 0 if it has none."""
    maxima = np.zeros(m.shape[0])
    target, _, index = connections(m)
    np.maximum.at(maxima, target, np.abs(values_of(m).ravel()[index]).astype(np.float64))
    return maxima


def row_sums(m: Matrix) -> FloatArray:
    """Return the larger of two sums for each target, (n_target,): of its positive weights, and of its negative ones.

    The sum of the negative weights is taken without its sign. It bounds the charge of one step, whatever spikes.
    """
    target, _, index = connections(m)
    weights = values_of(m).ravel()[index].astype(np.float64)
    rows = m.shape[0]
    positive = np.bincount(target, weights=np.maximum(weights, 0.0), minlength=rows)
    negative = np.bincount(target, weights=np.maximum(-weights, 0.0), minlength=rows)
    return np.maximum(positive, negative)


def charge(spikes: ByteArray, m: Matrix) -> Values:
    """Return the charges (..., n_target) that spikes (..., n_source) cause: the sum of their weights.

    The result has the type of the weights. Integers are added as integers, without a float in between.
    """
    rows = spikes.reshape(-1, m.shape[1])
    if np.issubdtype(values_of(m).dtype, np.integer):
        # numpy multiplies matrices of integers slowly; a sparse product only visits the spikes.
        sums = sparse_spikes(rows, np.int64) @ m.T
        charges: Values = sums.toarray() if sparse.issparse(sums) else sums
    elif sparse.issparse(m):
        charges = (m @ rows.T.astype(np.float64)).T
    else:
        charges = rows.astype(np.float64) @ m.T
    return charges.reshape(*spikes.shape[:-1], m.shape[0])


def sparse_spikes(rows: ByteArray, dtype: npt.DTypeLike) -> Matrix:
    """Return spikes (rows, n) of 0 and 1 as a CSR matrix."""
    # numpy searches booleans fastest, and bytes of 0 and 1 can be viewed as booleans.
    flat_index = np.flatnonzero(rows.view(np.bool_))
    # Rows without columns have no spikes: any divisor but 0 will do.
    columns = max(rows.shape[1], 1)
    row, column = np.divmod(flat_index, columns)
    # np.flatnonzero ascends, so row i is the spikes from the first with row >= i to the first with row >= i + 1.
    starts = np.searchsorted(row, np.arange(len(rows) + 1))
    return sparse.csr_array((np.ones(len(row), dtype), column, starts), shape=rows.shape)
