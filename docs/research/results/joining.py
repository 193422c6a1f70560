"""A hybrid and windows, joined as `objects-best.pt` is and laid out by a strategy: the ways with ``parts`` of ``tried_settings.yaml``.

What is measured are the scores of the chip's program. Strategies are compared on the same networks.
"""

from __future__ import annotations

from fold_networks import learned, on_chip
from join_branches import joined
from ways import Division, Joined, Rows, Scorer


def joined_on_chip(way: Joined, of: Division, rows: Rows) -> Scorer:
    """Train the networks on ``rows``, unless they are there, and return the scores of their program."""
    hybrid, *windows = (learned(name, of, rows) for name in way.parts)
    return on_chip(joined(hybrid, windows, "joined"), of, rows, strategy=way.strategy)
