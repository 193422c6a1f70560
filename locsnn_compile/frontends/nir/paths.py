"""How many steps behind the input each population is, and the delays that keep paths of other lengths in step.

Here a spike takes one step to the next population, in frameworks none. A path that skips populations would arrive
early, so its spikes are delayed by what the longest path takes more. A framework's spikes take one step where they
close a loop; a loop over several populations takes a step for each here, unless a delay in it leaves room.
"""

from collections.abc import Iterable
from graphlib import TopologicalSorter

import numpy as np
from scipy import sparse
from scipy.sparse import csgraph

Pair = tuple[str, str]


class Paths:
    """The depths of populations (1 behind the input), and by how many steps the spikes of a pair are late."""

    def __init__(self, pairs: Iterable[Pair], inputs: list[str], populations: Iterable[str]) -> None:
        names = [*inputs, *populations]
        self._ahead = _ahead(set(pairs), names, len(inputs))
        before: dict[str, list[str]] = {name: [] for name in names}
        for source, target in self._ahead:
            before[target].append(source)
        self.depths: dict[str, int] = {}
        for name in TopologicalSorter(before).static_order():
            longest = max((self.depths[source] for source in before[name]), default=0)
            self.depths[name] = 0 if name in inputs else longest + 1

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
    ends = np.array([(index[a], index[b]) for a, b in sorted(pairs)], dtype=np.int64).reshape(-1, 2).T
    near = None
    while True:
        links = sparse.csr_array((np.ones(ends.shape[1]), tuple(ends)), shape=(len(names), len(names)))
        if near is None:
            near = csgraph.dijkstra(links, indices=range(inputs), unweighted=True, min_only=True)
        loop = csgraph.connected_components(links, connection="strong")[1]
        nearest = np.full(len(names), np.inf)
        np.minimum.at(nearest, loop, near)
        source, target = ends
        closing = (loop[source] == loop[target]) & (near[target] == nearest[loop[target]])
        if not closing.any():
            return {(names[a], names[b]) for a, b in ends.T.tolist()}
        ends = ends[:, ~closing]
