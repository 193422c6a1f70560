"""Which taxels of a fingertip are neighbours: the graphs of TactileSGNet.

Source of the three ways: Gu et al., IROS 2020. Edges are undirected here, each held once.
"""

from collections.abc import Iterable

import numpy as np
from scipy.spatial.distance import cdist

from hw_model.arithmetic.arrays import FloatArray
from locsnn_compile.data.sensor import MANUAL_EDGES, TAXEL_COORDINATES_MM, TAXELS
from locsnn_compile.errors import InputError, did_you_mean

Edges = tuple[tuple[int, int], ...]
GRAPHS = ("manual", "nearest", "tree")
CENTRE = 21
"""The taxel in the middle of the fingertip, from which the spanning tree grows."""


def taxel_graph(kind: str, *, neighbours: int, nearer_mm: float) -> Edges:
    """Return the edges of a fingertip's graph, pairs of 1-based taxel numbers, the lower first, sorted.

    ``manual``: joined by hand. ``nearest``: every taxel and its ``neighbours`` nearest ones, of equally near ones those
    of the lowest number. ``tree``: the minimum spanning tree that grows from the centre taxel, and all pairs nearer
    than ``nearer_mm`` millimetres. Raises ``InputError`` for another kind.
    """
    if kind == "manual":
        return MANUAL_EDGES
    distance = _distances_mm()
    if kind == "nearest":
        near = np.argsort(distance + np.diag(np.full(TAXELS, np.inf)), axis=1, kind="stable")
        return _edges((a, int(b)) for a in range(TAXELS) for b in near[a, :neighbours])
    if kind == "tree":
        close = zip(*np.nonzero(np.triu(distance < nearer_mm, k=1)), strict=True)
        return _edges([*_spanning_tree(distance), *((int(a), int(b)) for a, b in close)])
    raise InputError("taxel graph", f"{kind!r} is not known", fix=did_you_mean(kind, GRAPHS))


def _distances_mm() -> FloatArray:
    """Return all distances (taxels, taxels), rounded so that equal ones compare as equal."""
    distance: FloatArray = cdist(TAXEL_COORDINATES_MM, TAXEL_COORDINATES_MM).round(9)
    return distance


def _spanning_tree(distance: FloatArray) -> list[tuple[int, int]]:
    """Return the edges, 0-based, by which a tree grows from the centre to the nearest taxel outside it."""
    inside, edges = [CENTRE - 1], []
    outside = [taxel for taxel in range(TAXELS) if taxel != CENTRE - 1]
    while outside:
        _, a, b = min((distance[a, b], a, b) for a in inside for b in outside)
        edges.append((a, b))
        inside.append(b)
        outside.remove(b)
    return edges


def _edges(pairs: Iterable[tuple[int, int]]) -> Edges:
    """Return 1-based pairs in order, of 0-based ones that may come twice or turned round."""
    return tuple(sorted({(min(a, b) + 1, max(a, b) + 1) for a, b in pairs}))
