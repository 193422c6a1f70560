"""Which taxels of a surface are neighbours: the graphs of TactileSGNet, for any sensor with known positions.

Source of the three kinds: Gu et al., IROS 2020. Edges are undirected here, and each is held once.
"""

from collections.abc import Iterable

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
        if not layout.is_neutouch:
            what = "its edges were drawn by hand for a NeuTouch fingertip"
            raise InputError(
                where, what, measured=f"sensor {layout.name!r}", fix="Use --graph nearest or tree."
            )
        return MANUAL_EDGES
    places = layout.needed_places(where)
    what, fix = "it has too many taxels for a graph", "Use a network without one."
    check_most(len(places), MAX_TAXELS, where, what, unit="taxels", fix=fix)
    # Rounded so that equal distances compare as equal.
    distance: FloatArray = cdist(places, places).round(9)
    if kind == "nearest":
        near = np.argsort(distance + np.diag(np.full(len(places), np.inf)), axis=1, kind="stable")
        return _edges(
            (a, int(b))
            for a in range(len(places))
            for b in near[a, : min(neighbours, len(places) - 1)]
        )
    close = zip(*np.nonzero(np.triu(distance < nearer_mm, k=1)), strict=True)
    middle = int(np.square(places - places.mean(axis=0)).sum(axis=1).round(9).argmin())
    return _edges([*_spanning_tree(distance, middle), *((int(a), int(b)) for a, b in close)])


def _spanning_tree(distance: FloatArray, middle: int) -> list[tuple[int, int]]:
    """Return the 0-based edges by which a tree grows from the middle, always to the nearest taxel outside it.

    Among equally near ones, it takes the edge from the lowest number inside, then to the lowest outside.
    """
    far, inside = distance[middle].copy(), np.full(len(distance), middle)
    far[middle] = np.inf
    edges = []
    for _ in range(len(distance) - 1):
        nearest = np.flatnonzero(far == far.min())
        b = int(nearest[np.lexsort((nearest, inside[nearest]))[0]])
        edges.append((int(inside[b]), b))
        far[b] = np.inf
        better = np.isfinite(far) & ((distance[b] < far) | ((distance[b] == far) & (b < inside)))
        far, inside = np.where(better, distance[b], far), np.where(better, b, inside)
    return edges


def _edges(pairs: Iterable[tuple[int, int]]) -> Edges:
    """Return sorted 1-based pairs, given 0-based ones that may occur twice or with their ends swapped."""
    return tuple(sorted({(min(a, b) + 1, max(a, b) + 1) for a, b in pairs}))
