"""In which order parts are worked on: sources first, a circle all at once, and what is joined from the leaves on."""

import numpy as np

from hw_model.values import ArrayLike, IntArray


def sources_first(count: int, edges: ArrayLike) -> list[list[int]]:
    """Return the nodes 0 to ``count - 1``, those in a circle of edges together, sources before their targets.

    ``edges`` (n, 2): source and target. Where they leave a choice, the one with the least node comes first.
    """
    reached = np.eye(count, dtype=np.float32)
    reached[tuple(np.reshape(edges, (-1, 2)).astype(np.int64).T)] = 1
    while True:
        further = (reached @ reached > 0).astype(np.float32)
        if further.sum() == reached.sum():
            break
        reached = further
    # By the least node of a circle: its nodes, and how many nodes outside of it come before.
    circles = {int(np.argmax(row)): np.flatnonzero(row) for row in reached * reached.T}
    sources_left: dict[int, int] = {}
    for first, nodes in circles.items():
        sources = int(np.count_nonzero(reached[:, first]))
        sources_left[first] = sources - len(nodes)
    order: list[list[int]] = []
    while sources_left:
        first = min(node for node, sources in sources_left.items() if sources == 0)
        nodes = circles[first]
        order.append(nodes.tolist())
        del sources_left[first]
        for node in sources_left:
            if reached[first, node]:
                sources_left[node] -= len(nodes)
    return order


def roots(parent: IntArray) -> tuple[IntArray, IntArray]:
    """Return the root of each node, given the parent of each, or -1, and how far below its root each node is."""
    root = np.arange(len(parent))
    depth = np.zeros_like(parent)
    above = parent
    while True:
        is_below = above >= 0
        if not is_below.any():
            return root, depth
        depth += is_below
        root = np.where(is_below, above, root)
        above = np.where(is_below, parent[above], -1)
