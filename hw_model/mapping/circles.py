"""In which order parts are worked on: sources first, a circle all at once, and what is joined from the leaves on."""

import numpy as np

from hw_model.values import ArrayLike, IntArray


def sources_first(count: int, edges: ArrayLike) -> list[list[int]]:
    """Return the nodes 0 to ``count - 1``, those in a circle of edges together, sources before their targets.

    ``edges`` (n, 2): source and target. Where they leave a choice, the one with the least node comes first.
    """
    reached = np.eye(count, dtype=np.float32)
    reached[tuple(np.reshape(edges, (-1, 2)).astype(np.int64).T)] = 1
    while (further := (reached @ reached > 0).astype(np.float32)).sum() > reached.sum():
        reached = further
    circles = {int(np.argmax(row)): np.flatnonzero(row) for row in reached * reached.T}
    before = {
        first: int(np.count_nonzero(reached[:, first])) - len(nodes)
        for first, nodes in circles.items()
    }
    order: list[list[int]] = []
    while before:
        first = min(node for node, waits in before.items() if waits == 0)
        del before[first]
        before = {
            node: waits - len(circles[first]) * int(reached[first, node])
            for node, waits in before.items()
        }
        order.append(circles[first].tolist())
    return order


def roots(parent: IntArray) -> tuple[IntArray, IntArray]:
    """Return the root of each node, given the parent of each, or -1, and how far below its root each node is."""
    root, depth, above = np.arange(len(parent)), np.zeros_like(parent), parent
    while (above >= 0).any():
        depth += above >= 0
        root, above = np.where(above >= 0, above, root), np.where(above >= 0, parent[above], -1)
    return root, depth
