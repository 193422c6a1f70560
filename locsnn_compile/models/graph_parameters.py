"""Graph convolutions in plain values: which nodes are joined, how far they hear, how many features they give.

Nothing here imports torch, so that the compiler can read descriptions without it.
"""

from hw_model.values import Frozen
from locsnn_compile.errors import InputError
from locsnn_compile.models.plain_checks import require_count, rises

MAX_HOPS = 16
MAX_FEATURES = 1024


class GraphParameters(Frozen):
    """The topology-adaptive graph convolutions of a network (Du et al. 2017), one for each of its branches.

    ``taxel_edges``: pairs of 1-based taxel numbers of a fingertip, the lower first, each pair once; ``name`` says how
    they were found. A node hears nodes up to ``hops`` edges away and gives ``features`` outputs; on the location axis,
    where nodes are the time steps of the recording and neighbours in time are joined, ``step_features``.
    """

    name: str
    taxel_edges: tuple[tuple[int, int], ...]
    hops: int = 3
    features: int = 64
    step_features: int = 8

    def check(self, taxels: int) -> None:
        """Raise ``InputError`` for numbers out of range, and for a pair that is none of ``taxels`` taxels."""
        limits = {"hops": MAX_HOPS, "features": MAX_FEATURES, "step_features": MAX_FEATURES}
        for name, limit in limits.items():
            require_count(f"graph {name!r}", getattr(self, name), limit)
        seen: set[tuple[int, int]] = set()
        for a, b in self.taxel_edges:
            if not rises((a, b), 1, taxels):
                what = "an edge is not a pair of taxels with the lower number first"
                fix = "Correct the graph."
                raise InputError("taxel graph", what, measured=f"got {a!r}-{b!r} against 1..{taxels}", fix=fix)
            if (a, b) in seen:
                raise InputError("taxel graph", f"edge {a}-{b} is given twice", fix="Give every edge once.")
            seen.add((a, b))
