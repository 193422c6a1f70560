"""In which order parts are worked on that feed each other: sources first, and a circle all at once."""

import numpy as np

from hw_model.values import ArrayLike


def sources_first(count: int, edges: ArrayLike) -> list[list[int]]:
    """Return the nodes 0 to ``count - 1``, those in a circle of edges together, sources before their targets.

    ``edges`` (n, 2): source and target. Where they leave a choice, the one with the least node comes first.
    """
    reached = np.eye(count, dtype=np.float32)
    reached[tuple(np.reshape(edges, (-1, 2)).astype(np.int64).T)] = 1
    while (further := (reached @ reached > 0).astype(np.float32)).sum() > reached.sum():
        reached = further
    circles = {int(np.argmax(row)): np.flatnonzero(row) for row in reached * reached.T}
    before = {first: int(np.count_nonzero(reached[:, first])) - len(nodes) for first, nodes in circles.items()}
    order: list[list[int]] = []
    while before:
        first = min(node for node, waits in before.items() if waits == 0)
        del before[first]
        before = {node: waits - len(circles[first]) * int(reached[first, node]) for node, waits in before.items()}
        order.append(circles[first].tolist())
    return order
