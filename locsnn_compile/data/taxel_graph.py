"""Which taxels of a surface are neighbours, for layers of graph convolution over a tactile sensor.

A taxel is one touch-sensitive point, and a surface is one of the sensor's equal parts, such as a
fingertip. The three kinds of graph are those of TactileSGNet (Gu et al., IROS 2020), built here for
any sensor whose taxels have positions. Edges are undirected, and each is listed once, as a pair of
taxel numbers from 1 with the lower one first.
"""

from collections.abc import Iterable, Iterator

import numpy as np
from scipy.spatial.distance import cdist

from hw_model.values import FloatArray
from locsnn_compile.data.sensor import MANUAL_EDGES, SensorLayout
from locsnn_compile.errors import InputError, check_known, check_most

Edges = tuple[tuple[int, int], ...]
"""Sorted pairs of 1-based taxel numbers, the lower one first."""
GRAPHS = ("manual", "nearest", "tree")
MAX_TAXELS = 4_096
"""Most taxels of a surface: the distances between all pairs of these are a table of 128 MiB."""


def taxel_graph(kind: str, layout: SensorLayout, *, neighbours: int, nearer_mm: float) -> Edges:
    """Return the edges of a surface's graph, pairs of 1-based taxel numbers, the lower first, sorted.

    - ``manual``: edges drawn by hand, for NeuTouch only
    - ``nearest``: every taxel and its nearest ``neighbours``; among equally near ones, those with the lowest numbers
    - ``tree``: the minimum spanning tree that grows from the middle taxel, and all pairs nearer than
      ``nearer_mm``, which is in millimetres if the positions of the layout are

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
    # The triangle above the diagonal has each pair once, and no taxel with itself.
    close_pairs = np.argwhere(np.triu(distance < nearer_mm, k=1)).tolist()
    square_from_middle = np.square(places - places.mean(axis=0)).sum(axis=1).round(9)
    tree = _spanning_tree(distance, middle=int(square_from_middle.argmin()))
    return _edges([*tree, *((a, b) for a, b in close_pairs)])


def _nearest(distance: FloatArray, neighbours: int) -> Iterator[tuple[int, int]]:
    """Yield 0-based pairs of each taxel and one of its nearest ``neighbours``."""
    to_others = distance.copy()
    # No taxel is its own neighbour.
    np.fill_diagonal(to_others, np.inf)
    # A stable sort, so that of equally near taxels the one with the lowest number comes first.
    by_distance = np.argsort(to_others, axis=1, kind="stable")
    count = min(neighbours, len(distance) - 1)
    for taxel, neighbours_of_taxel in enumerate(by_distance[:, :count].tolist()):
        for neighbour in neighbours_of_taxel:
            yield taxel, neighbour


def _spanning_tree(distance: FloatArray, middle: int) -> list[tuple[int, int]]:
    """Return the 0-based edges of the minimum spanning tree, by Prim's algorithm from the taxel ``middle``.

    Every step adds the taxel outside the tree that is nearest to any taxel inside. Among equally short
    edges, it takes the one from the lowest number inside, and then the one to the lowest outside, so
    that equal sensors get equal trees.
    """
    # Of every taxel outside the tree: the nearest one inside, and the distance to it. A taxel inside
    # has distance infinity, so that it is never added again.
    nearest_inside = np.full(len(distance), middle)
    distance_to_tree = distance[middle].copy()
    distance_to_tree[middle] = np.inf
    edges = []
    for _ in range(len(distance) - 1):
        candidates = np.flatnonzero(distance_to_tree == distance_to_tree.min())
        # The last key of lexsort is the first to sort by.
        first = np.lexsort((candidates, nearest_inside[candidates]))[0]
        added = int(candidates[first])
        edges.append((int(nearest_inside[added]), added))
        distance_to_tree[added] = np.inf
        to_added = distance[added]
        is_nearer = to_added < distance_to_tree
        is_lower = (to_added == distance_to_tree) & (added < nearest_inside)
        is_outside = np.isfinite(distance_to_tree)
        is_better = is_outside & (is_nearer | is_lower)
        distance_to_tree = np.where(is_better, to_added, distance_to_tree)
        nearest_inside = np.where(is_better, added, nearest_inside)
    return edges


def _edges(pairs: Iterable[tuple[int, int]]) -> Edges:
    """Return sorted 1-based pairs without repetition, given 0-based pairs in either direction."""
    return tuple(sorted({(min(a, b) + 1, max(a, b) + 1) for a, b in pairs}))
