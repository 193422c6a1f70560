"""The order of an array's axes: the usual one of files, a stated one, or another one that the sizes suggest.

Files hold (samples, channels, steps); arrays in Python are (samples, steps, channels).
"""

from itertools import permutations

import numpy as np

from hw_model.values import AnyArray
from locsnn_compile.data.channels import Channels
from locsnn_compile.data.recordings import MAX_ELEMENTS, fewer_recordings
from locsnn_compile.data.sensor import POLARITIES, TAXELS
from locsnn_compile.errors import InputError, counted

Order = tuple[str, ...]
AXES = ("samples", "steps", "channels", "rows", "columns", "taxels", "polarities")
"""What an axis may count. Channels are one axis, or taxels (or rows and columns), with or without polarities."""
_PLACES = (("taxels",), ("rows", "columns"))
_CHANNELS: tuple[Order, ...] = (*_PLACES, *((*places, "polarities") for places in _PLACES))
_READ: dict[int, tuple[Order, ...]] = {
    2: (("channels", "steps"),),
    3: (("samples", "channels", "steps"), ("taxels", "polarities", "steps")),
    4: (("samples", "taxels", "polarities", "steps"),),
}
"""Number of axes -> accepted orders."""


def parse_axes(text: str, where: str) -> Order:
    """Return the order that a text names, such as ``samples,steps,channels``; ``InputError`` for other texts."""
    order = tuple(text.replace(",", " ").split())
    of_channel = tuple(axis for axis in AXES if axis in order and axis not in ("samples", "steps"))
    names_axes_once = set(order) <= set(AXES) and len(set(order)) == len(order)
    names_channels = of_channel in (("channels",), *_CHANNELS)
    if not (names_axes_once and names_channels and "steps" in order):
        measured = f"got {text[:60]!r}"
        fix = (
            "Name steps and channels, or taxels, or rows and columns, with polarities or without, "
            "and samples."
        )
        raise InputError(where, "it is not an order of axes", measured=measured, fix=fix)
    return order


def to_step_major(
    array: AnyArray, where: str, channels: int | None = None, order: Order | None = None
) -> AnyArray:
    """Return an array as (samples, steps, channels); channel = polarities * taxel + polarity.

    Its axes are in this ``order``, or else in one that files have: (samples, taxels, polarities, steps) or (samples,
    channels, steps), and for a single recording (channels, steps) or (taxels, polarities, steps). Three axes are a
    single recording if the middle one has two polarities and the first the taxels of whole fingertips (39 each).
    Raises ``InputError`` for other numbers of axes, and for sizes that reveal another order: see :func:`check_axes`.
    """
    order = order_of(array, where, channels, order)
    if "samples" not in order:
        array = array[np.newaxis]
        order = ("samples", *order)
    array = array.transpose([order.index(axis) for axis in AXES if axis in order])
    return array.reshape(*array.shape[:2], int(np.prod(array.shape[2:])))


def pixels_of(
    array: AnyArray, where: str, channels: int | None = None, order: Order | None = None
) -> Channels | None:
    """Return the pixels of what :func:`to_step_major` returns; None if one axis counts channels, or is empty."""
    sizes = dict(zip(order_of(array, where, channels, order), array.shape, strict=True))
    if "channels" in sizes or 0 in sizes.values():
        return None
    columns = sizes.get("columns", sizes.get("taxels", 1))
    return Channels(columns, sizes.get("rows", 1), sizes.get("polarities", 1))


def order_of(array: AnyArray, where: str, channels: int | None, order: Order | None) -> Order:
    """Return the order of an array's axes; see :func:`to_step_major`."""
    # A tensor may claim any size with few stored values. Reshaping would allocate all of it.
    if array.size > MAX_ELEMENTS:
        measured = f"{array.size} values against {MAX_ELEMENTS}"
        values_of_one = array.size // len(array) if array.ndim > 2 else array.size
        fix = fewer_recordings(values_of_one)
        raise InputError(where, "it is too large", measured=measured, fix=fix)
    if order is None:
        check_axes(array, where, channels)
        accepted = _READ.get(array.ndim, ((),))
        order = accepted[-1] if is_one(array.shape, channels) else accepted[0]
    if not order or array.ndim != len(order):
        measured = f"{counted(array.ndim, 'axis', 'axes')} against {len(order) or '2 to 4'}"
        wanted = "(samples, channels, steps) or (samples, taxels, polarities, steps)"
        if order:
            wanted = f"({', '.join(order)})"
        fix = f"Give {wanted}."
        raise InputError(where, "its shape is not one of recordings", measured=measured, fix=fix)
    return order


def is_one(shape: tuple[int, ...], channels: int | None = None) -> bool:
    """Tell whether an array of this shape, in an order of files, is a single recording: see :func:`to_step_major`."""
    return len(shape) == 2 or (len(shape) == 3 and _fits(_READ[3][1], shape, channels))


def check_axes(array: AnyArray, where: str, channels: int | None = None) -> None:
    """Refuse an array whose sizes reveal an order of axes that is not accepted.

    They do if one axis has the ``channels`` of the sensor (by default those of whole fingertips), or two axes its
    taxels and its two polarities, at a place where no accepted order has them.
    """
    turned = _other_order(array.shape, channels)
    if turned is None:
        return
    order, accepted = turned
    what = f"its axes look like ({', '.join(order)})"
    measured = f"{' x '.join(map(str, array.shape))} values"
    fix = (
        f"Give --axes {','.join(order)}, or transpose it to ({', '.join(accepted)}), "
        "as files have it."
    )
    raise InputError(where, what, measured=measured, fix=fix)


def is_clear(shape: tuple[int, ...]) -> bool:
    """Tell whether (samples, channels, steps) or (channels, steps) of these sizes are read as that for any sensor."""
    return _other_order(shape) is None and not (len(shape) == 3 and is_one(shape))


def _other_order(shape: tuple[int, ...], channels: int | None = None) -> tuple[Order, Order] | None:
    """Return the order that sizes reveal and the accepted one that it turns; None if they fit an accepted order."""
    accepted = _READ.get(len(shape), ())
    if any(_fits(order, shape, channels) for order in accepted):
        return None
    for names in accepted:
        for order in permutations(names):
            # With taxels on an axis, there may be as many recordings as taxels, or two: samples stay in front.
            may_move = not {"samples", "taxels"} <= set(order)
            if (may_move or order[0] == "samples") and _fits(order, shape, channels):
                return order, names
    return None


def _fits(order: Order, shape: tuple[int, ...], channels: int | None) -> bool:
    """Tell whether an axis has the channels of the sensor, or by default those of whole fingertips."""
    sizes = dict(zip(order, shape, strict=True))
    if "channels" in sizes:
        size = sizes["channels"]
    elif sizes["polarities"] == POLARITIES:
        size = POLARITIES * sizes["taxels"]
    else:
        return False
    if channels is not None:
        return size == channels
    return size > 0 and size % (TAXELS * POLARITIES) == 0
