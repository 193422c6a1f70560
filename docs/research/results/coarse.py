"""Networks of windows whose weights have few bits on the chip: the ways with ``bits`` of ``tried_settings.yaml``.

The weights are rounded after training, or trained on the chip's integers from the start (``locsnn train --target``), with their
range ``room`` times the usual one. Accuracy is that of the scores of the program on the chip.
"""

from __future__ import annotations

from fold_networks import learned, on_chip
from ways import Coarse, Division, Rows, Scorer


def coarse(way: Coarse, division: Division, rows: Rows) -> Scorer:
    """Train on ``rows``, unless the network is there, and return a scorer of its program on the chip."""
    if not way.in_training:
        return on_chip(learned(way.setting, division, rows), division, rows, weight_bits=way.bits)
    options = {"target": "loihi-sim", "weight_bits": way.bits, "weight_room": way.room}
    return on_chip(
        learned(way.setting, division, rows, f"-{way.bits}-bits-{way.room:g}", **options),
        division,
        rows,
    )
