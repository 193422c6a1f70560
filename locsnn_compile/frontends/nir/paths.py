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
        self._open_pairs = _open_pairs(set(pairs), [*inputs, *populations], len(inputs))
        self.depths = dict.fromkeys(inputs, 0) | dict.fromkeys(populations, 1)
        # No loop is left, so depths end at the longest path from the input.
        while self._deepen():
            pass

    def _deepen(self) -> bool:
        """Move every target behind its sources; tell whether any was not."""
        behind = [
            (source, target)
            for source, target in self._open_pairs
            if self.depths[target] <= self.depths[source]
        ]
        for source, target in behind:
            self.depths[target] = max(self.depths[target], self.depths[source] + 1)
        return bool(behind)

    def late(self, source: str, target: str) -> int:
        """Return the delay with which a spike arrives as in a framework; below 0 if it must be faster than a step."""
        # Here a spike takes one step; in a framework none, or one where it closes a loop.
        steps_in_framework = 0 if (source, target) in self._open_pairs else 1
        return self.depths[target] - self.depths[source] + steps_in_framework - 1

    def fit(self, delays: list[tuple[str, str, int]]) -> None:
        """Lower depths until no (source, target, delay) has a delay below :meth:`late`."""
        for _ in self.depths:
            for source, target, delay in delays:
                self.depths[target] -= max(self.late(source, target) - delay, 0)


def _open_pairs(pairs: set[Pair], names: list[str], inputs: int) -> set[Pair]:
    """Return the pairs that close no loop.

    What leads to the population of a loop that is nearest to the input closes it.
    """
    number_of = {name: number for number, name in enumerate(names)}
    numbers = [(number_of[source], number_of[target]) for source, target in sorted(pairs)]
    links = np.array(numbers, dtype=np.int64).reshape(-1, 2)
    distance = csgraph.dijkstra(
        _matrix(links, len(names)), indices=range(inputs), unweighted=True, min_only=True
    )
    while True:
        matrix = _matrix(links, len(names))
        _, loop_of = csgraph.connected_components(matrix, connection="strong")
        nearest = np.full(len(names), np.inf)
        np.minimum.at(nearest, loop_of, distance)
        source, target = links.T
        is_within = loop_of[source] == loop_of[target]
        leads_to_nearest = distance[target] == nearest[loop_of[target]]
        closes_loop = is_within & leads_to_nearest
        if not closes_loop.any():
            return {(names[source], names[target]) for source, target in links.tolist()}
        links = links[~closes_loop]


def _matrix(links: IntArray, size: int) -> Any:
    """Return pairs (n, 2) as a matrix of ones."""
    return sparse.csr_array((np.ones(len(links)), tuple(links.T)), shape=(size, size))
