"""Two orders of graphs, as indices: strongly connected components in topological order, and the depth in a forest.

The simulator steps groups in the first order, the arrangement of cores finds connected components with it. The second
is for joined compartments, which form trees: each adds its voltage to its parent, the leaves first.
"""

import numpy as np

from hw_model.values import ArrayLike, IntArray


def sources_first(count: int, edges: ArrayLike) -> list[list[int]]:
    """Return the strongly connected components of nodes 0 to ``count - 1``, sources before their targets.

    ``edges`` (n, 2): source and target. Where the edges leave a choice, the component with the smallest node comes
    first.
    """
    # Transitive closure by squaring: reachable[i, j] is 1 if a path leads from i to j.
    # Floats, because numpy multiplies matrices of floats much faster than matrices of integers.
    reachable = np.eye(count, dtype=np.float32)
    reachable[tuple(np.reshape(edges, (-1, 2)).astype(np.int64).T)] = 1
    while True:
        squared = (reachable @ reachable > 0).astype(np.float32)
        if squared.sum() == reachable.sum():
            break
        reachable = squared
    # Two nodes are in one component if each reaches the other. A component goes by its smallest node.
    is_same_component = reachable * reachable.T
    components = {int(np.argmax(row)): np.flatnonzero(row) for row in is_same_component}
    # For each component, the number of nodes outside of it that have to come before it.
    sources_left: dict[int, int] = {}
    for first, nodes in components.items():
        sources = int(np.count_nonzero(reachable[:, first]))
        sources_left[first] = sources - len(nodes)
    order: list[list[int]] = []
    while sources_left:
        first = min(node for node, sources in sources_left.items() if sources == 0)
        nodes = components[first]
        order.append(nodes.tolist())
        del sources_left[first]
        for node in sources_left:
            if reachable[first, node]:
                sources_left[node] -= len(nodes)
    return order


def roots(parent: IntArray) -> tuple[IntArray, IntArray]:
    """Return the root and the depth of every node of a forest.

    ``parent`` (nodes,) is the parent of each node, or -1 for a root. A root has depth 0.
    """
    root = np.arange(len(parent))
    depth = np.zeros_like(parent)
    # All nodes climb at once, one level per round.
    ancestor = parent
    while True:
        has_ancestor = ancestor >= 0
        if not has_ancestor.any():
            return root, depth
        depth += has_ancestor
        root = np.where(has_ancestor, ancestor, root)
        ancestor = np.where(has_ancestor, parent[ancestor], -1)
