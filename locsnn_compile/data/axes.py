"""Which axis of an array of recordings counts what: samples, steps, channels.

By convention, files hold (samples, channels, steps), and arrays in Python are (samples, steps,
channels). Readers of array files use this module to turn the former into the latter. A user or a file
may state another order. If nothing states one but the sizes of the axes suggest another order (for
example because the sensor's number of channels is on the last axis), the array is refused rather
than read with steps and channels swapped.
"""

from itertools import permutations

import numpy as np

from hw_model.values import AnyArray
from locsnn_compile.data.channels import Channels
from locsnn_compile.data.recordings import MAX_ELEMENTS, fewer_recordings
from locsnn_compile.data.sensor import POLARITIES, TAXELS
from locsnn_compile.errors import InputError, counted

Order = tuple[str, ...]
"""The names of an array's axes, first to last, out of :data:`AXES`."""
AXES = ("samples", "steps", "channels", "rows", "columns", "taxels", "polarities")
"""What an axis may count. Channels are one axis, or taxels (or rows and columns), with or without polarities."""
_PLACES = (("taxels",), ("rows", "columns"))
"""The axes that can say where a channel lies on the sensor."""
_CHANNELS: tuple[Order, ...] = (*_PLACES, *((*places, "polarities") for places in _PLACES))
"""The sets of axes, in the order of ``AXES``, that together count channels."""
_READ: dict[int, tuple[Order, ...]] = {
    2: (("channels", "steps"),),
    3: (("samples", "channels", "steps"), ("taxels", "polarities", "steps")),
    4: (("samples", "taxels", "polarities", "steps"),),
}
"""Number of axes -> the orders in which arrays are read if none is stated, the usual one first."""


def parse_axes(text: str, where: str) -> Order:
    """Return the order that a text names, such as ``samples,steps,channels``; ``InputError`` for other texts."""
    order = tuple(text.replace(",", " ").split())
    # In the order of AXES, so that one comparison finds the set of axes in any order.
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
    """Return an array as (samples, steps, channels), where channel = polarities * taxel + polarity.

    The axes of ``array`` are in the stated ``order``. Without one, they are in one of the usual orders
    of files: (samples, taxels, polarities, steps) or (samples, channels, steps), and for a single
    recording (channels, steps) or (taxels, polarities, steps). Three axes are taken for a single
    recording if the middle one counts two polarities and the first counts taxels: those of a sensor
    of ``channels``, or of whole NeuTouch fingertips (39 each) if its ``channels`` are unknown. Raises
    ``InputError`` for other numbers of axes, and for sizes that reveal another order: see
    :func:`check_axes`.
    """
    order = order_of(array, where, channels, order)
    if "samples" not in order:
        array = array[np.newaxis]
        order = ("samples", *order)
    # AXES begins with samples and steps, and ends with polarities: they become the fastest.
    array = array.transpose([order.index(axis) for axis in AXES if axis in order])
    return array.reshape(*array.shape[:2], int(np.prod(array.shape[2:])))


def pixels_of(
    array: AnyArray, where: str, channels: int | None = None, order: Order | None = None
) -> Channels | None:
    """Return the pixels that the channels returned by :func:`to_step_major` are.

    None if a single axis counts channels, because it does not say which pixel a channel is, and for
    an array without values.
    """
    sizes = dict(zip(order_of(array, where, channels, order), array.shape, strict=True))
    if "channels" in sizes or 0 in sizes.values():
        return None
    columns = sizes.get("columns", sizes.get("taxels", 1))
    return Channels(columns, sizes.get("rows", 1), sizes.get("polarities", 1))


def order_of(array: AnyArray, where: str, channels: int | None, order: Order | None) -> Order:
    """Return the order of an array's axes, given the stated ``order`` if any; see :func:`to_step_major`."""
    # A tensor with strides of 0 may claim any size with few stored values. Reshaping it, as callers
    # do next, would allocate all of it.
    if array.size > MAX_ELEMENTS:
        measured = f"{array.size} values against {MAX_ELEMENTS}"
        values_of_one = array.size // len(array) if array.ndim > 2 else array.size
        fix = fewer_recordings(values_of_one)
        raise InputError(where, "it is too large", measured=measured, fix=fix)
    if order is None:
        check_axes(array, where, channels)
        accepted = _READ.get(array.ndim, ((),))
        # The last accepted order is that of a single recording.
        order = accepted[-1] if is_one(array.shape, channels) else accepted[0]
    if not order or array.ndim != len(order):
        measured = f"{counted(array.ndim, 'axis', 'axes')} against {len(order) or '2 to 4'}"
        expected = "(samples, channels, steps) or (samples, taxels, polarities, steps)"
        if order:
            expected = f"({', '.join(order)})"
        fix = f"Give {expected}."
        raise InputError(where, "its shape is not one of recordings", measured=measured, fix=fix)
    return order


def is_one(shape: tuple[int, ...], channels: int | None = None) -> bool:
    """Return whether an array of this shape, in a usual order of files, is a single recording.

    See :func:`to_step_major`.
    """
    return len(shape) == 2 or (len(shape) == 3 and _fits(_READ[3][1], shape, channels))


def check_axes(array: AnyArray, where: str, channels: int | None = None) -> None:
    """Refuse an array whose sizes reveal that its axes are not in one of the usual orders of files.

    They do so if the axis that counts the sensor's ``channels`` (or the two axes that count its taxels
    and its two polarities) can be recognised by its size, and lies where no usual order has it. If
    ``channels`` is None, an axis counts channels if its size is that of whole NeuTouch fingertips.
    """
    revealed = _other_order(array.shape, channels)
    if revealed is None:
        return
    order, accepted = revealed
    what = f"its axes look like ({', '.join(order)})"
    measured = f"{' x '.join(map(str, array.shape))} values"
    fix = (
        f"Give --axes {','.join(order)}, or transpose it to ({', '.join(accepted)}), "
        "as files have it."
    )
    raise InputError(where, what, measured=measured, fix=fix)


def is_clear(shape: tuple[int, ...]) -> bool:
    """Return whether an array (samples, channels, steps) or (channels, steps) is read in this order.

    Its sizes may look like another order. Writers then state the order in the file, because readers
    may not know the sensor.
    """
    return _other_order(shape) is None and not (len(shape) == 3 and is_one(shape))


def _other_order(shape: tuple[int, ...], channels: int | None = None) -> tuple[Order, Order] | None:
    """Return (the order that the sizes of axes reveal, the usual order of the same axes).

    None if the sizes fit a usual order, or none at all.
    """
    accepted = _READ.get(len(shape), ())
    if any(_fits(order, shape, channels) for order in accepted):
        return None
    for names in accepted:
        for order in permutations(names):
            # Where taxels and polarities are axes of their own, 39 or 2 samples look like these. So
            # an order is only suspected if samples stay in front.
            may_move = not {"samples", "taxels"} <= set(order)
            if (may_move or order[0] == "samples") and _fits(order, shape, channels):
                return order, names
    return None


def _fits(order: Order, shape: tuple[int, ...], channels: int | None) -> bool:
    """Return whether the axes that count channels have the sizes of the sensor.

    Those are its ``channels``, or the channels of any number of whole NeuTouch fingertips if None.
    """
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
