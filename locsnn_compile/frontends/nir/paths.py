"""Delays that keep the paths through a network as synchronous as in a framework.

On the chip a spike takes one step to the next population, in frameworks none. The *depth* of a population is the number
of steps by which it is behind the framework: that of the longest path from the input. On a shorter path, which skips
populations, spikes would arrive too early, so they are delayed by the difference.

Loops are different: in a framework, a spike takes one step where it closes a loop. On the chip, a loop over several
populations takes one step for each of them, so its spikes come too late, unless a delay in it leaves room.
"""

from collections.abc import Iterable
from typing import Any

import numpy as np
from scipy import sparse
from scipy.sparse import csgraph

from hw_model.values import IntArray

Pair = tuple[str, str]
"""The names of a source and of the population that its spikes reach."""


class Paths:
    """The depths of populations, and the delays that connections between them need.

    ``depths`` has 0 for inputs, and at least 1 for populations, by name.
    """

    def __init__(self, pairs: Iterable[Pair], inputs: list[str], populations: list[str]) -> None:
        self._open_pairs = _open_pairs(set(pairs), [*inputs, *populations], len(inputs))
        self.depths = dict.fromkeys(inputs, 0) | dict.fromkeys(populations, 1)
        # Without loops this ends, when every depth is that of the longest path from the input.
        while self._deepen():
            pass

    def _deepen(self) -> bool:
        """Make every target at least one deeper than its sources; return whether any depth changed."""
        not_deeper = [
            (source, target)
            for source, target in self._open_pairs
            if self.depths[target] <= self.depths[source]
        ]
        for source, target in not_deeper:
            self.depths[target] = max(self.depths[target], self.depths[source] + 1)
        return bool(not_deeper)

    def late(self, source: str, target: str) -> int:
        """Return the delay with which a spike arrives as in a framework; below 0 if one step is already too late."""
        # In a framework a spike takes no step, or one where it closes a loop. On the chip it takes one.
        steps_in_framework = 0 if (source, target) in self._open_pairs else 1
        steps_on_chip = 1
        return self.depths[target] - self.depths[source] + steps_in_framework - steps_on_chip

    def fit(self, delays: list[tuple[str, str, int]]) -> None:
        """Lower depths until each (source, target, delay) has at least the delay of :meth:`late`.

        The NIR exporter needs this: it writes ``delay - late`` steps as a Delay node, which cannot be negative.
        """
        # A lower depth can require the depths behind it to be lower, along a path of at most all populations. Loops do
        # not make this endless: the depths cancel out of the sum of `late` around a loop, which is therefore 0 or less,
        # and no delay is below 0.
        for _ in self.depths:
            for source, target, delay in delays:
                missing_delay = max(self.late(source, target) - delay, 0)
                self.depths[target] -= missing_delay


def _open_pairs(pairs: set[Pair], names: list[str], inputs: int) -> set[Pair]:
    """Return the pairs that close no loop; ``names`` begin with as many ``inputs``.

    A loop is closed by the pairs that lead to its population nearest to the input. These are removed from every set of
    populations that can all reach each other (a strongly connected component), again and again until no loop is left.
    A loop that no input reaches has all its populations at the same, infinite distance, and loses all of its pairs.
    """
    number_of = {name: number for number, name in enumerate(names)}
    numbers = [(number_of[source], number_of[target]) for source, target in sorted(pairs)]
    edges = np.array(numbers, dtype=np.int64).reshape(-1, 2)
    # The distance of every population from the nearest input.
    distance = csgraph.dijkstra(
        _adjacency(edges, len(names)), indices=range(inputs), unweighted=True, min_only=True
    )
    while True:
        adjacency = _adjacency(edges, len(names))
        _, component_of = csgraph.connected_components(adjacency, connection="strong")
        nearest = np.full(len(names), np.inf)
        np.minimum.at(nearest, component_of, distance)
        source, target = edges.T
        is_within = component_of[source] == component_of[target]
        leads_to_nearest = distance[target] == nearest[component_of[target]]
        closes_loop = is_within & leads_to_nearest
        if not closes_loop.any():
            return {(names[source], names[target]) for source, target in edges.tolist()}
        edges = edges[~closes_loop]


def _adjacency(edges: IntArray, size: int) -> Any:
    """Return edges (n, 2) as a sparse matrix of ones (size, size)."""
    return sparse.csr_array((np.ones(len(edges)), tuple(edges.T)), shape=(size, size))
