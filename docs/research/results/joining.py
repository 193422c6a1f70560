"""A hybrid and networks of windows, joined as in `objects-best.pt`: the ways with ``parts`` of ``tried_settings.yaml``.

They are compiled with a strategy and scored by the program on the chip. Strategies are compared on the same networks.
"""

from __future__ import annotations

from fold_networks import learned, on_chip
from join_branches import joined
from ways import Division, Joined, Rows, Scorer


def joined_on_chip(way: Joined, division: Division, rows: Rows) -> Scorer:
    """Train the networks on ``rows``, unless they are there, and return a scorer of their program on the chip."""
    hybrid, *windows = (learned(name, division, rows) for name in way.parts)
    return on_chip(joined(hybrid, windows, "joined"), division, rows, strategy=way.strategy)
