"""In which order the axes of an array are: as files have them, or, by their sizes, more likely in another one."""

from __future__ import annotations

from typing import Any

from numpy.typing import NDArray

from locsnn_compile.data.sensor import POLARITIES, TAXELS
from locsnn_compile.errors import InputError

Order = tuple[str, ...]
_READ: dict[int, tuple[Order, ...]] = {
    2: (("channels", "steps"),),
    3: (("samples", "channels", "steps"), ("taxels", "polarities", "steps")),
    4: (("samples", "taxels", "polarities", "steps"),),
}
"""Number of axes -> orders that are read."""
_OTHERS: dict[int, tuple[Order, ...]] = {
    2: (("steps", "channels"),),
    3: (
        ("samples", "steps", "channels"),
        ("polarities", "taxels", "steps"),
        ("steps", "taxels", "polarities"),
        ("steps", "polarities", "taxels"),
        ("channels", "samples", "steps"),
    ),
    4: (
        ("samples", "polarities", "taxels", "steps"),
        ("samples", "steps", "taxels", "polarities"),
        ("samples", "steps", "polarities", "taxels"),
    ),
}
"""Number of axes -> orders that are not, the likely ones first."""


def check_axes(array: NDArray[Any], where: str, channels: int | None = None) -> None:
    """Refuse an array whose axes have the sizes of another order than those that are read.

    Sizes tell where ``channels`` of the sensor, by default those of whole fingertips, are on one axis, or on one of 39
    taxels each and one of two polarities, and the orders that are read have them elsewhere.
    """
    read = _READ.get(array.ndim, ())
    if any(_fits(order, array.shape, channels) for order in read):
        return
    for order in _OTHERS.get(array.ndim, ()):
        if _fits(order, array.shape, channels):
            wanted = next(names for names in read if sorted(names) == sorted(order))
            raise InputError(
                where,
                f"its axes look like ({', '.join(order)})",
                measured=f"{' x '.join(map(str, array.shape))} values",
                fix=f"Transpose it to ({', '.join(wanted)}).",
            )


def _fits(order: Order, shape: tuple[int, ...], channels: int | None) -> bool:
    sizes = dict(zip(order, shape, strict=True))
    if "channels" in sizes:
        found = sizes["channels"]
    elif sizes["polarities"] == POLARITIES and sizes["taxels"] % TAXELS == 0:
        found = POLARITIES * sizes["taxels"]
    else:
        return False
    return found == channels if channels is not None else found > 0 and found % (TAXELS * POLARITIES) == 0
