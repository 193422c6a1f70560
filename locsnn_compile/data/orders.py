"""The order in which a location network visits the taxels of a surface.

A taxel is one touch-sensitive point of a tactile sensor, and a surface is one of its equal parts, such
as a fingertip. Where an ordinary spiking neuron steps through time, a location neuron steps through
the taxels, so training and compiling need a fixed order of them. It is named by the user:

- by number: ``loop`` (1, 2, 3, ... as the taxels are numbered) and ``reverse``
- by position on the sensor: ``raster``, ``snake``, ``spiral``, ``hilbert`` and ``tour``, the functions below
- as published for the NeuTouch fingertip: ``arch`` and ``whorl`` (and ``loop``, which is the same there)
- a list of numbers, or the name of a file that holds one

A *walk* is such an order as an array: walk[i] is the 0-based number of the i-th taxel (or channel).
"""

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from hw_model.io.files import read_bytes
from hw_model.values import FloatArray, IntArray, sealed
from locsnn_compile.data.sensor import LOCATION_ORDERS, SensorLayout
from locsnn_compile.errors import InputError, did_you_mean

_WHERE = "location order"
Places = FloatArray
"""(x, y) of the taxels of a surface, (taxels, 2)."""
Walk = IntArray
"""0-based numbers in the order of the visits."""


def raster(places: Places) -> Walk:
    """Row by row from the lowest y, each from the lowest x."""
    return np.lexsort((places[:, 0], places[:, 1]))


def snake(places: Places) -> Walk:
    """Row by row, every other row backwards, so that the ends of neighbouring rows meet."""
    x, y = places.T
    # Rows are numbered by their distinct y: taxels of one row have the same y exactly.
    _, row = np.unique(y, return_inverse=True)
    along_row = np.where(row % 2 == 0, x, -x)
    return raster(np.stack([along_row, row], axis=1))


def spiral(places: Places) -> Walk:
    """From the middle outwards, in square rings that are as wide as the distance between neighbours.

    Within a ring, by the angle around the middle, from -pi to pi.
    """
    middle = (places.min(axis=0) + places.max(axis=0)) / 2
    from_middle = places - middle
    # The slack keeps a taxel on the edge of a ring in that ring in spite of rounding.
    ring = np.floor(np.abs(from_middle).max(axis=1) / _pitch(places) + 1e-9)
    angle = np.arctan2(from_middle[:, 1], from_middle[:, 0])
    # With the ring as y and the angle as x, ring by ring is row by row.
    return raster(np.stack([angle, ring], axis=1))


def hilbert(places: Places) -> Walk:
    """Along a Hilbert curve over the square around the sensor: neighbours on the walk are near on the sensor."""
    # Positions are rounded to a lattice of 1024 x 1024, far finer than the taxels of any sensor.
    side = 1 << 10
    span = max(float(np.ptp(places, axis=0).max()), 1e-12)
    x, y = ((places - places.min(axis=0)) / span * (side - 1)).astype(np.int64).T
    # ``along`` becomes the distance from the start of the curve. The descent is the usual one
    # ("xy2d" on Wikipedia's page "Hilbert curve"): from the largest quarter to the smallest, each
    # mirrored and with swapped axes as the curve enters it. The curve goes through quarters 0 (lower
    # left), 1 (upper left), 2 (upper right) and 3 (lower right).
    along = np.zeros(len(places), dtype=np.int64)
    while side > 1:
        side //= 2
        is_right = (x & side) > 0
        is_up = (y & side) > 0
        quarter = (3 * is_right) ^ is_up
        along += side * side * quarter
        is_mirrored = ~is_up & is_right
        last = side - 1
        x = np.where(is_mirrored, last - (x & last), x)
        y = np.where(is_mirrored, last - (y & last), y)
        x, y = np.where(is_up, x, y), np.where(is_up, y, x)  # lower quarters swap the axes
    return np.argsort(along, kind="stable")


def tour(places: Places) -> Walk:
    """From taxel 1, always on to the nearest taxel left; among equally near ones, to the lowest number."""
    not_visited = np.ones(len(places), dtype=np.bool_)
    walk = [0]  # 0-based: taxel 1
    for _ in range(len(places) - 1):
        taxel = walk[-1]
        not_visited[taxel] = False
        # Rounded so that equal distances compare as equal.
        square_distance = np.square(places - places[taxel]).sum(axis=1).round(9)
        walk.append(int(np.argmin(np.where(not_visited, square_distance, np.inf))))
    return np.array(walk)


def _pitch(places: Places) -> float:
    """Return the median distance between neighbours; 1 for a single taxel."""
    if len(places) < 2:
        return 1.0
    from scipy.spatial import KDTree  # a table of all distances would take gigabytes for a camera

    # Two neighbours are asked for, because the nearest place is the place itself. The distance is the
    # larger one of the distances in x and y (p = infinity), which makes the rings of a spiral squares.
    distances, _ = KDTree(places).query(places, k=2, p=np.inf)
    return float(np.median(distances[:, 1]))


BY_PLACE: dict[str, Callable[[Places], Walk]] = {
    walk.__name__: walk for walk in (raster, snake, spiral, hilbert, tour)
}
"""Orders by position: name -> function of the places."""
BY_NUMBER: dict[str, Callable[[int], range]] = {
    "loop": lambda taxels: range(1, taxels + 1),
    "reverse": lambda taxels: range(taxels, 0, -1),
}
"""Orders by number: name -> function of the number of taxels; they return 1-based numbers."""
ORDERS = (*LOCATION_ORDERS, "reverse", *BY_PLACE)
"""Names of all orders: ``loop`` and ``reverse`` go by the taxels' numbers, upwards and downwards;
``arch`` and ``whorl`` are published for NeuTouch."""


def location_order(text: str, layout: SensorLayout) -> tuple[str, tuple[int, ...]]:
    """Return (name, 1-based taxel numbers) of the order that ``text`` asks for.

    ``text`` is the name of an order, or a comma list of numbers, whose name is then ``custom``.
    Raises ``InputError`` for an unknown name, for a name that needs positions if the layout has none,
    and for numbers that are not a permutation of the taxels.
    """
    if text in BY_NUMBER:
        return text, tuple(BY_NUMBER[text](layout.taxels))
    if text in BY_PLACE:
        places = layout.needed_places(f"location order {text!r}")
        return text, tuple((1 + BY_PLACE[text](places)).tolist())
    if text in LOCATION_ORDERS and layout.is_neutouch:
        return text, LOCATION_ORDERS[text]
    if text in LOCATION_ORDERS:
        what = "it is a walk over the 39 taxels of a NeuTouch fingertip"
        fix = f"Use one of: {', '.join((*BY_NUMBER, *BY_PLACE))}."
        raise InputError(
            f"location order {text!r}", what, measured=f"sensor {layout.name!r}", fix=fix
        )
    if "," not in text:
        raise InputError(_WHERE, f"{text!r} is not known", fix=did_you_mean(text, ORDERS))
    order: list[int] = []
    for entry in map(str.strip, text.split(",")):
        if not (entry.isascii() and entry.isdigit() and len(entry) <= 6):
            what = f"entry {len(order) + 1} is not a taxel number"
            fix = "Give taxels separated by commas."
            raise InputError(_WHERE, what, measured=f"got {entry[:40]!r}", fix=fix)
        order.append(int(entry))
    check_location_taxels(order, layout.taxels)
    return "custom", tuple(order)


def order_text(text: str) -> str:
    """Return the text of an order; if it is the name of a file, the numbers in that file as a comma list.

    A name that ends in ``.txt`` or ``.csv`` is taken for a file, in which blanks, commas or line ends
    separate the numbers. Raises ``InputError`` for a file that cannot be read.
    """
    path = Path(text)
    if path.suffix not in (".txt", ".csv"):
        return text
    content = read_bytes(path, f"{_WHERE} {path.name!r}").decode("ascii", "replace")
    return ",".join(content.replace(",", " ").split())


def channel_walk(order: Sequence[int], layout: SensorLayout) -> Walk:
    """Return the walk over the channels of a sensor, (channels,), read-only: walk[i] is the i-th channel.

    ``order`` are the 1-based taxel numbers of one surface. The walk follows it on the first surface,
    then on the next one, and so on; at each taxel it takes both polarities before it goes on. Raises
    ``InputError`` with the first taxel that is out of range, repeated or missing.
    """
    check_location_taxels(order, layout.taxels)
    channels = np.arange(layout.channels, dtype=np.int64)
    by_taxel = channels.reshape(layout.surfaces, layout.taxels, layout.polarities)
    taxel_index = np.asarray(order, dtype=np.int64) - 1
    return sealed(by_taxel[:, taxel_index].reshape(-1))


def check_location_taxels(taxels: Sequence[int], count: int) -> None:
    """Refuse an order that is not a permutation of the taxels 1..``count``.

    The ``InputError`` names the first number that is out of range, repeated or missing.
    """
    fix = f"Give every taxel from 1 to {count} exactly once."
    visited: set[int] = set()
    for position, taxel in enumerate(taxels, start=1):
        # Not isinstance: True would pass as 1.
        if type(taxel) is not int or not 1 <= taxel <= count:
            what = f"entry {position} is not a taxel of the sensor"
            raise InputError(_WHERE, what, measured=f"got {taxel!r} against 1..{count}", fix=fix)
        if taxel in visited:
            raise InputError(_WHERE, f"taxel {taxel} is repeated at entry {position}", fix=fix)
        visited.add(taxel)
    missing = [taxel for taxel in range(1, count + 1) if taxel not in visited]
    if missing:
        measured = f"{len(visited)} of {count} taxels given"
        raise InputError(_WHERE, f"taxel {missing[0]} is missing", measured=measured, fix=fix)
