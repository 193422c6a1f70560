"""Windows whose weights have few bits on the chip: the ways with ``bits`` of ``tried_settings.yaml``.

The weights are rounded after training, or trained on the chip's integers from the start (``locsnn train --target``), with their
range ``room`` times the usual one. What is measured are the scores of the program.
"""

from __future__ import annotations

from fold_networks import learned, on_chip
from ways import Coarse, Division, Rows, Scorer


def coarse(way: Coarse, of: Division, rows: Rows) -> Scorer:
    """Train on ``rows``, unless it was done, and return the scores of the program."""
    if not way.in_training:
        return on_chip(learned(way.setting, of, rows), of, rows, weight_bits=way.bits)
    options = {"target": "loihi-sim", "weight_bits": way.bits, "weight_room": way.room}
    return on_chip(
        learned(way.setting, of, rows, f"-{way.bits}-bits-{way.room:g}", **options), of, rows
    )
