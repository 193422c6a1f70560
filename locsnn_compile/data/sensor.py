"""The NeuTouch fingertip: where its taxels lie, how its channels are numbered, the published walks over them.

Its tables are those of ``neutouch.json``. Source: Kang et al. 2022 and its released configuration; coordinates and
edges of the TactileSGNet release (Gu et al. 2020).
"""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from hw_model.arithmetic.arrays import IntArray
from locsnn_compile.errors import InputError, did_you_mean

#: Taxels of one fingertip, numbered from 1 in every file and order.
TAXELS = 39
#: Polarities of a taxel: 0 where pressure rises, 1 where it falls; channel = 2 * taxel + polarity, taxel from
#: 0.
POLARITIES = 2

_FILE: dict[str, Any] = json.loads(Path(__file__).with_name("neutouch.json").read_text("utf-8"))
#: (x, y) of taxels 1..39 in millimetres, the centre of the fingertip at (0, 0).
TAXEL_COORDINATES_MM: tuple[tuple[float, float], ...] = tuple((x, y) for x, y in _FILE["positions"])
#: The published walks over one fingertip, 1-based taxel numbers.
LOCATION_ORDERS = {"loop": tuple(range(1, TAXELS + 1)), "arch": tuple(_FILE["arch"]), "whorl": tuple(_FILE["whorl"])}
#: Neighbours that the authors of TactileSGNet joined by hand: pairs of taxel numbers, the lower first.
MANUAL_EDGES: tuple[tuple[int, int], ...] = tuple((a, b) for a, b in _FILE["edges"])
#: Taxel numbers by row (y from -8.9 to 8.9 mm) and column (x from -6 to 6 mm); 0 where there is none. Every taxel has a
#: cell of its own, so that the squared distances between taxels and the middles of their cells add up to the least.
FRAME_OF_TAXELS: tuple[tuple[int, ...], ...] = tuple(map(tuple, _FILE["frame"]))


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
) -> IntArray:
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
            "location order", f"taxel {missing[0]} is missing", measured=f"{len(seen)} of {count} taxels given", fix=fix
        )
