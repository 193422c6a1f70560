"""How many steps behind the input each population is, and the delays that keep paths of other lengths in step.

Here a spike takes one step to the next population, in frameworks none. A path that skips populations would arrive
early, so its spikes are delayed by what the longest path takes more. On a loop, a framework's spikes come one step
later; a loop over several populations takes a step for each.
"""

from collections.abc import Iterable
from graphlib import TopologicalSorter

import numpy as np
from scipy import sparse
from scipy.sparse import csgraph


class Paths:
    """The depths of populations (1 behind the input), and the delay of each pair (source, target)."""

    def __init__(self, pairs: Iterable[tuple[str, str]], inputs: list[str], populations: Iterable[str]) -> None:
        pairs, names = set(pairs), [*inputs, *populations]
        index = {name: k for k, name in enumerate(names)}
        ends = np.array([(index[a], index[b]) for a, b in sorted(pairs)], dtype=np.int64).reshape(-1, 2).T
        links = sparse.csr_array((np.ones(ends.shape[1]), tuple(ends)), shape=(len(names), len(names)))
        loop = csgraph.connected_components(links, connection="strong")[1]
        near = csgraph.dijkstra(links, indices=range(len(inputs)), unweighted=True, min_only=True)
        # Within a loop, what leads away from the input is a path; the rest closes the loop.
        self._ahead = {(a, b) for a, b in pairs if loop[index[a]] != loop[index[b]] or near[index[a]] < near[index[b]]}
        before = {name: [a for a, b in self._ahead if b == name] for name in names}
        self.depths: dict[str, int] = {}
        for name in TopologicalSorter(before).static_order():
            longest = max((self.depths[a] for a in before[name]), default=0)
            self.depths[name] = 0 if name in inputs else longest + 1

    def delay(self, source: str, target: str) -> int:
        """Return the steps by which spikes of a source are delayed on their way to a target."""
        apart = self.depths[target] - self.depths[source]
        return max(apart - ((source, target) in self._ahead), 0)
