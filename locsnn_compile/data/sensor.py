"""The NeuTouch fingertip: where its taxels lie, how its channels are numbered, in which orders they are
walked.

Source: Kang et al. 2022 and its released configuration; coordinates of the TactileSGNet release (Gu et al.
2020).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from locsnn_compile.errors import InputError, did_you_mean

#: Taxels of one fingertip, numbered from 1 in every file and order.
TAXELS = 39
#: Polarities of a taxel: 0 where pressure rises, 1 where it falls; channel = 2 * taxel + polarity, taxel from
#: 0.
POLARITIES = 2

#: (x, y) of taxels 1..39 in millimetres, the centre of the fingertip at (0, 0).
TAXEL_COORDINATES_MM: tuple[tuple[float, float], ...] = (
    *((-6, 0), (-5.3, -3), (-5.3, 3), (-4.6, -7.8), (-4.6, 7.8), (-3.5, 0), (-3.05, -5.2), (-3.05, 5.2)),
    *((-3.1, -1.75), (-3.1, 1.75), (-1.6, -8.9), (-1.75, -3), (-1.6, 8.9), (-1.75, 3), (-1.5, 0)),
    *((-0.7, -1.3), (-0.7, 1.3), (0, -6), (0, 6), (0, -3.5), (0, 0), (0, 3.5), (0.8, -1.3), (0.8, 1.3)),
    *((1.6, -8.9), (1.6, 8.9), (1.5, 0), (1.75, 3), (1.75, -3), (3.05, -5.2), (3.1, 1.75), (3.05, 5.2)),
    *((3.1, -1.75), (3.6, 0), (4.6, -7.8), (4.6, 7.8), (5.3, -3), (5.3, 3), (6, 0)),
)

#: The published walks over one fingertip, 1-based taxel numbers.
LOCATION_ORDERS: dict[str, tuple[int, ...]] = {
    "arch": (
        *(11, 25, 35, 4, 18, 30, 7, 2, 20, 37, 29, 12, 9, 33, 23, 16, 1, 6, 15, 21),
        *(27, 34, 39, 24, 17, 10, 31, 38, 28, 14, 3, 22, 32, 8, 19, 36, 5, 13, 26),
    ),
    "loop": tuple(range(1, TAXELS + 1)),
    "whorl": (
        *(21, 15, 16, 23, 27, 24, 17, 6, 9, 12, 20, 29, 33, 34, 31, 28, 22, 14, 10, 1),
        *(2, 7, 18, 30, 37, 39, 38, 32, 19, 8, 3, 4, 11, 25, 35, 36, 26, 13, 5),
    ),
}


def parse_location_order(text: str) -> tuple[str, tuple[int, ...]]:
    """Return (name, 1-based taxel numbers) of ``arch``, ``loop``, ``whorl`` or a comma list, named
    ``custom``.

    Raises ``InputError`` for an unknown name and for a list that is no permutation of the taxels.
    """
    if text in LOCATION_ORDERS:
        return text, LOCATION_ORDERS[text]
    if "," not in text:
        raise InputError("location order", f"{text!r} is not known", fix=did_you_mean(text, LOCATION_ORDERS))
    order: list[int] = []
    for entry in text.split(","):
        if not (entry.strip().isascii() and entry.strip().isdigit() and len(entry.strip()) <= 6):
            raise InputError(
                "location order",
                f"entry {len(order) + 1} is not a taxel number",
                measured=f"got {entry.strip()!r}",
                fix=f"Give the taxels 1 to {TAXELS} separated by commas.",
            )
        order.append(int(entry))
    check_location_taxels(order, TAXELS)
    return "custom", tuple(order)


def channel_walk(
    order: Sequence[int], fingertips: int, *, taxels: int = TAXELS, polarities: int = POLARITIES
) -> NDArray[np.int64]:
    """Return the walk (fingertips * taxels * polarities,): position -> channel, read-only.

    Taxel p of the order contributes channels polarities * (p - 1), ... in that order; fingertips follow one
    another. Raises ``InputError`` naming the first taxel that is out of range, repeated or missing.
    """
    check_location_taxels(order, taxels)
    taxel = np.asarray(order, dtype=np.int64) - 1
    one = (taxel[:, np.newaxis] * polarities + np.arange(polarities)).reshape(-1)
    walk = (one + np.arange(fingertips)[:, np.newaxis] * (taxels * polarities)).reshape(-1)
    walk.setflags(write=False)
    return walk


def check_location_taxels(taxels: Sequence[int], count: int) -> None:
    """Refuse an order that is no permutation of the taxels 1..``count`` of a fingertip.

    Raises ``InputError`` that names the first number out of range, repeated or missing.
    """
    fix = f"Give every taxel from 1 to {count} exactly once."
    seen: set[int] = set()
    for position, taxel in enumerate(taxels, start=1):
        if isinstance(taxel, bool) or not isinstance(taxel, int) or not 1 <= taxel <= count:
            raise InputError(
                "location order",
                f"entry {position} is not a taxel of the fingertip",
                measured=f"got {taxel!r} against 1..{count}",
                fix=fix,
            )
        if taxel in seen:
            raise InputError("location order", f"taxel {taxel} is repeated at entry {position}", fix=fix)
        seen.add(taxel)
    if missing := [taxel for taxel in range(1, count + 1) if taxel not in seen]:
        raise InputError(
            "location order",
            f"taxel {missing[0]} is missing",
            measured=f"{len(seen)} of {count} taxels given",
            fix=fix,
        )
