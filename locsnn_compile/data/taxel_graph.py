"""Which taxels of a surface are neighbours: the graphs of TactileSGNet, for any sensor with known positions.

Source of the three kinds: Gu et al., IROS 2020. Edges are undirected here, and each is held once.
"""

from collections.abc import Iterable, Iterator

import numpy as np
from scipy.spatial.distance import cdist

from hw_model.values import FloatArray
from locsnn_compile.data.sensor import MANUAL_EDGES, SensorLayout
from locsnn_compile.errors import InputError, check_known, check_most

Edges = tuple[tuple[int, int], ...]
GRAPHS = ("manual", "nearest", "tree")
MAX_TAXELS = 4_096
"""Most taxels of a surface: their distances are a table of 128 MiB."""


def taxel_graph(kind: str, layout: SensorLayout, *, neighbours: int, nearer_mm: float) -> Edges:
    """Return the edges of a surface's graph, pairs of 1-based taxel numbers, the lower first, sorted.

    - ``manual``: edges drawn by hand, for NeuTouch only
    - ``nearest``: every taxel and its nearest ``neighbours``; among equally near ones, those with the lowest numbers
    - ``tree``: the minimum spanning tree that grows from the middle taxel, and all pairs nearer than ``nearer_mm``, in
      the unit of the layout

    Raises ``InputError`` for another kind, and for a sensor without the positions that are needed.
    """
    check_known("taxel graph", f"{kind!r} is not known", str(kind), GRAPHS)
    where = f"taxel graph {kind!r}"
    if kind == "manual":
        if layout.is_neutouch:
            return MANUAL_EDGES
        what = "its edges were drawn by hand for a NeuTouch fingertip"
        measured = f"sensor {layout.name!r}"
        raise InputError(where, what, measured=measured, fix="Use --graph nearest or tree.")
    places = layout.needed_places(where)
    what = "it has too many taxels for a graph"
    fix = "Use a network without one."
    check_most(len(places), MAX_TAXELS, where, what, unit="taxels", fix=fix)
    # Rounded so that equal distances compare as equal.
    distance: FloatArray = cdist(places, places).round(9)
    if kind == "nearest":
        return _edges(_nearest(distance, neighbours))
    close = np.argwhere(np.triu(distance < nearer_mm, k=1)).tolist()
    from_middle = np.square(places - places.mean(axis=0)).sum(axis=1).round(9)
    tree = _spanning_tree(distance, middle=int(from_middle.argmin()))
    return _edges([*tree, *((a, b) for a, b in close)])


def _nearest(distance: FloatArray, neighbours: int) -> Iterator[tuple[int, int]]:
    """Yield every taxel, from 0 on, with each of its nearest ones."""
    to_others = distance.copy()
    np.fill_diagonal(to_others, np.inf)
    by_distance = np.argsort(to_others, axis=1, kind="stable")
    count = min(neighbours, len(distance) - 1)
    for taxel, others in enumerate(by_distance[:, :count].tolist()):
        for other in others:
            yield taxel, other


def _spanning_tree(distance: FloatArray, middle: int) -> list[tuple[int, int]]:
    """Return the 0-based edges by which a tree grows from the middle, always to the nearest taxel outside it.

    Among equally near ones, it takes the edge from the lowest number inside, then to the lowest outside.
    """
    # Of every taxel outside the tree: the nearest one inside, and how far it is. Inside: infinitely far.
    nearest_inside = np.full(len(distance), middle)
    how_far = distance[middle].copy()
    how_far[middle] = np.inf
    edges = []
    for _ in range(len(distance) - 1):
        candidates = np.flatnonzero(how_far == how_far.min())
        first = np.lexsort((candidates, nearest_inside[candidates]))[0]
        added = int(candidates[first])
        edges.append((int(nearest_inside[added]), added))
        how_far[added] = np.inf
        to_added = distance[added]
        is_nearer = to_added < how_far
        is_lower = (to_added == how_far) & (added < nearest_inside)
        is_better = np.isfinite(how_far) & (is_nearer | is_lower)
        how_far = np.where(is_better, to_added, how_far)
        nearest_inside = np.where(is_better, added, nearest_inside)
    return edges


def _edges(pairs: Iterable[tuple[int, int]]) -> Edges:
    """Return sorted 1-based pairs, given 0-based ones that may occur twice or with their ends swapped."""
    return tuple(sorted({(min(a, b) + 1, max(a, b) + 1) for a, b in pairs}))
