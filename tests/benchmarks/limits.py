"""What the machine can do at most: kernels of the same memory traffic as a network's, and of nearly no arithmetic.

The engine's time is compared with these kernels, as shares of the limit.

*Rows*: every delivered spike adds its row of weights to the row of charges of the step in which it is due, in the engine's
order (recordings, tiles of 64 steps, layers, spikes), in its types, on all threads. The spikes are known beforehand; nothing
is computed to find them, updated or counted. If a row of charges has many spikes due, eight rows of weights are added at
once; *one row at a time* is the plain loop, which loads and stores the charges for each spike. *Rows and state*: besides,
every compartment and step reads its charge and clears it, reads and writes u and v, and writes a spike, with shifts in place
of the chip's rounding.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise

import numba
import numpy as np
from numpy.typing import NDArray
from workloads import IntArray, LayeredNetwork

from hw_model.engine.threads import cores

TILE = 64
THREADS = cores()
REPEATS = 7
PLAIN, TOGETHER, WITH_STATE = range(3)
"""Kinds of kernels, as numbers that compiled code can compare."""


class TrafficLimit:
    """The kernels on a network's own spikes, (batch, steps, n) by layer.

    Each call plays all recordings once, divided between the threads, and returns seconds per recording.
    """

    def __init__(self, network: LayeredNetwork, spikes: Sequence[NDArray[np.uint8]]) -> None:
        self.batch, self.steps, _ = spikes[0].shape
        self.matrices = tuple(
            np.ascontiguousarray(matrix.T, dtype=np.int16) for matrix in network.weights
        )
        arriving = [network.recordings[: self.batch], *spikes[:-1]]
        bounds = np.linspace(0, self.batch, THREADS + 1).astype(int)
        self.pool = ThreadPoolExecutor(THREADS)
        self.parts = [deliveries([s[a:b] for s in arriving]) for a, b in pairwise(bounds)]

    def plain(self) -> float:
        """Add one row at a time."""
        return self._seconds(PLAIN)

    def rows(self) -> float:
        """Add rows."""
        return self._seconds(TOGETHER)

    def rows_and_state(self) -> float:
        """Add rows, and read and write the state of every compartment and step."""
        return self._seconds(WITH_STATE)

    def _seconds(self, kind: int) -> float:
        def run(part: tuple[IntArray, IntArray, IntArray]) -> None:
            sizes = [matrix.shape[1] for matrix in self.matrices]
            charges = tuple(np.zeros((TILE + 1, size), dtype=np.int32) for size in sizes)
            states = tuple(np.zeros((2, size), dtype=np.int32) for size in sizes)
            fired = tuple(np.zeros((TILE + 1, size), dtype=np.uint8) for size in sizes)
            _play(*part, self.matrices, charges, states, fired, self.steps, kind)

        start = time.perf_counter()
        list(self.pool.map(run, self.parts))
        return (time.perf_counter() - start) / self.batch


def deliveries(arriving: Sequence[NDArray[np.uint8]]) -> tuple[IntArray, IntArray, IntArray]:
    """List the spikes that reach each layer, given the spikes (batch, steps, n) of the layer before it: begin, source, due.

    A part is a recording, a tile of steps and a layer. Part p has the spikes from ``begin[p]`` to ``begin[p + 1]``; spike e
    adds row ``source[e]`` of the layer's weights to row ``due[e]`` of its charges, one step after the spike.
    """
    batch, steps, _ = arriving[0].shape
    none = np.empty(0, dtype=np.int64)
    sources, dues, counts = [none], [none], [0]
    for b in range(batch):
        for start in range(0, steps, TILE):
            for spikes in arriving:
                row, source = np.nonzero(spikes[b, start : start + TILE])
                sources.append(source)
                dues.append(row + 1)
                counts.append(len(row))
    return np.cumsum(counts), np.concatenate(sources), np.concatenate(dues)


def working_sets(sizes_kib: Sequence[int], width: int = 256) -> dict[int, float]:
    """Return synaptic operations per second of adding random rows out of tables of so many KiB, one for each thread."""
    return {kib: _random_rows(kib, width) for kib in sizes_kib}


def _random_rows(kib: int, width: int) -> float:
    r = np.random.default_rng(0)
    rows = max(1, kib * 1024 // (2 * width))
    tables = [r.integers(-127, 127, (rows, width), dtype=np.int16) for _ in range(THREADS)]
    source, due = r.integers(0, rows, 1 << 16), np.sort(r.integers(0, TILE, 1 << 16))

    def run(table: NDArray[np.int16]) -> None:
        _add_together(source, due, 0, len(source), table, np.zeros((TILE, width), np.int32))

    with ThreadPoolExecutor(THREADS) as pool:
        seconds = median_seconds(lambda: list(pool.map(run, tables)))
    return THREADS * len(source) * width / seconds


def median_seconds(run: Callable[[], object], times: int = REPEATS) -> float:
    """Return the median of several calls after one that is not timed."""
    run()
    seconds = []
    for _ in range(times):
        start = time.perf_counter()
        run()
        seconds.append(time.perf_counter() - start)
    return statistics.median(seconds)


def _compiled(function):  # type: ignore[no-untyped-def]
    return numba.njit(nogil=True, boundscheck=False)(function)


# Indices are uint64 in these loops: with signed ones numba adds a test for negative indices.
@_compiled
def _add_plain(source, due, first, stop, matrix, charge):  # type: ignore[no-untyped-def]
    """Add the row of each spike by itself."""
    width = np.uint64(matrix.shape[1])
    weight, into = matrix.reshape(-1), charge.reshape(-1)
    for e in range(first, stop):
        row, at = np.uint64(source[e]) * width, np.uint64(due[e]) * width
        for j in range(width):
            into[at + j] += weight[row + j]


@_compiled
def _rows(source, e, width):  # type: ignore[no-untyped-def]
    """Return where the rows of four spikes begin."""
    return (
        np.uint64(source[e]) * width,
        np.uint64(source[e + 1]) * width,
        np.uint64(source[e + 2]) * width,
        np.uint64(source[e + 3]) * width,
    )


@_compiled
def _add_together(source, due, first, stop, matrix, charge):  # type: ignore[no-untyped-def]
    """Add the rows of eight spikes that are due in the same step at once; the rest one by one."""
    width = np.uint64(matrix.shape[1])
    weight, into = matrix.reshape(-1), charge.reshape(-1)
    e = first
    while e < stop:
        same = e + 1
        while same < stop and due[same] == due[e]:
            same += 1
        at = np.uint64(due[e]) * width
        while e + 8 <= same:
            a, b = _rows(source, e, width), _rows(source, e + 4, width)
            for j in range(width):
                into[at + j] += (
                    np.int32(np.int32(weight[a[0] + j]) + np.int32(weight[a[1] + j]))
                    + np.int32(np.int32(weight[a[2] + j]) + np.int32(weight[a[3] + j]))
                    + np.int32(np.int32(weight[b[0] + j]) + np.int32(weight[b[1] + j]))
                    + np.int32(np.int32(weight[b[2] + j]) + np.int32(weight[b[3] + j]))
                )
            e += 8
        while e < same:
            row = np.uint64(source[e]) * width
            for j in range(width):
                into[at + j] += weight[row + j]
            e += 1


@_compiled
def _update(charge, state, fired, rows):  # type: ignore[no-untyped-def]
    """Step the state of all compartments; the shifts, 2 and 5, and the threshold stand for any decays and threshold."""
    u, v = state[0], state[1]
    for r in range(rows):
        arrived, spikes = charge[r], fired[r]
        for i in range(len(u)):
            u[i] += arrived[i] - (u[i] >> np.int32(2))
            arrived[i] = 0
            v[i] += u[i] - (v[i] >> np.int32(5))
            spikes[i] = v[i] > np.int32(1 << 20)


@_compiled
def _play(begin, source, due, matrices, charges, states, fired, steps, kind):  # type: ignore[no-untyped-def]
    part = 0
    while part < len(begin) - 1:
        for start in range(0, steps, TILE):
            for layer in range(len(matrices)):
                first, stop = begin[part], begin[part + 1]
                if kind == PLAIN:
                    _add_plain(source, due, first, stop, matrices[layer], charges[layer])
                else:
                    _add_together(source, due, first, stop, matrices[layer], charges[layer])
                if kind == WITH_STATE:
                    _update(charges[layer], states[layer], fired[layer], min(TILE, steps - start))
                part += 1
