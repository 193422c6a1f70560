"""How many steps behind the input each population is, and the delays that keep paths of other lengths in step.

Here a spike takes one step to the next population, in frameworks none. A path that skips populations would arrive
early, so its spikes are delayed by what the longest path takes more. A framework's spikes take one step where they
close a loop; a loop over several populations takes a step for each here, unless a delay in it leaves room.
"""

from collections.abc import Iterable
from typing import Any

import numpy as np
from scipy import sparse
from scipy.sparse import csgraph

from hw_model.values import IntArray

Pair = tuple[str, str]


class Paths:
    """The depths of populations (1 behind the input), and by how many steps the spikes of a pair are late."""

    def __init__(self, pairs: Iterable[Pair], inputs: list[str], populations: list[str]) -> None:
        self._ahead = _ahead(set(pairs), [*inputs, *populations], len(inputs))
        self.depths = dict.fromkeys(inputs, 0) | dict.fromkeys(populations, 1)
        while behind := [(a, b) for a, b in self._ahead if self.depths[b] <= self.depths[a]]:
            for source, target in behind:
                self.depths[target] = max(self.depths[target], self.depths[source] + 1)

    def late(self, source: str, target: str) -> int:
        """Return the delay with which a spike arrives as in a framework; below 0 if it must be faster than a step."""
        return self.depths[target] - self.depths[source] - ((source, target) in self._ahead)

    def fit(self, delays: list[tuple[str, str, int]]) -> None:
        """Lower depths until no (source, target, delay) has a delay below :meth:`late`."""
        for _ in self.depths:
            for source, target, delay in delays:
                self.depths[target] -= max(self.late(source, target) - delay, 0)


def _ahead(pairs: set[Pair], names: list[str], inputs: int) -> set[Pair]:
    """Return the pairs that close no loop: what leads to the population of a loop nearest to the input closes it."""
    index = {name: k for k, name in enumerate(names)}
    ends = (
        np.array([(index[a], index[b]) for a, b in sorted(pairs)], dtype=np.int64).reshape(-1, 2).T
    )
    near = csgraph.dijkstra(
        _links(ends, len(names)), indices=range(inputs), unweighted=True, min_only=True
    )
    while True:
        loop = csgraph.connected_components(_links(ends, len(names)), connection="strong")[1]
        nearest = np.full(len(names), np.inf)
        np.minimum.at(nearest, loop, near)
        source, target = ends
        closing = (loop[source] == loop[target]) & (near[target] == nearest[loop[target]])
        if not closing.any():
            return {(names[a], names[b]) for a, b in ends.T.tolist()}
        ends = ends[:, ~closing]


def _links(ends: IntArray, size: int) -> Any:
    return sparse.csr_array((np.ones(ends.shape[1]), tuple(ends)), shape=(size, size))
