"""Events in the rows of a table without column names: which column is which.

Tables of (events, 3) or (events, 4) are common, in several orders: SLAYER and lava-dl write x, y, p, t; Tonic's readers
and v2e t, x, y, p; others x, y, t, p. The column of times is found because it never falls, and in all of these orders
its position decides what the other columns are.
"""

import numpy as np

from hw_model.values import AnyArray
from locsnn_compile.errors import InputError, listed

_ORDERS = {
    (4, 0): "txyp",
    (4, 2): "xytp",
    (4, 3): "xypt",
    (3, 0): "txp",
    (3, 1): "xtp",
    (3, 2): "xpt",
}
"""(Number of columns, index of the column of times) -> the names of the columns."""
_CALLED = {"p": "polarity"}
"""Names of columns in sentences, where they are not the names of fields."""


def is_table(array: AnyArray) -> bool:
    """Return whether an array may be a table of events: of three or four columns, and not of 0 and 1 alone.

    An array of 0 and 1 holds bins.
    """
    if array.ndim != 2 or array.shape[1] not in (3, 4) or array.dtype.kind not in "iuf":
        return False
    return bool(((array != 0) & (array != 1)).any())


def columns_of(table: AnyArray, where: str) -> dict[str, AnyArray]:
    """Return the columns of a table by the names of fields; ``InputError`` if no column can be the times."""
    order = _ORDERS.get((table.shape[1], _column_of_times(table)))
    if order is None:
        raise _unclear(where, "no column t that rises, in order x y p t, x y t p or t x y p")
    columns = {name: table[:, index] for index, name in enumerate(order)}
    odd = ~np.isin(columns["p"], (-1, 0, 1))
    if odd.any():
        raise _unclear(where, f"{columns['p'][odd][0]:g} in the column of polarities")
    return columns


def order_words(columns: dict[str, AnyArray]) -> str:
    """Return the order of columns in words, such as ``t, x, y and polarity``."""
    return listed([_CALLED.get(name, name) for name in columns])


def _column_of_times(table: AnyArray) -> int:
    """Return the index of the column of times; -1 if every column falls somewhere.

    If several columns never fall (x and y may happen to be sorted too), it is the one with the most
    different numbers, and then the one with the largest number.
    """
    rising = [
        column for column in range(table.shape[1]) if bool((np.diff(table[:, column]) >= 0).all())
    ]

    def likeness_to_times(column: int) -> tuple[int, float]:
        return len(np.unique(table[:, column])), float(table[:, column].max())

    return max(rising, key=likeness_to_times, default=-1)


def _unclear(where: str, measured: str) -> InputError:
    what = "it is neither an array of 0 and 1 nor a table of events"
    fix = "Give the fields t, x, y and p, sorted by time."
    return InputError(where, what, measured=measured, fix=fix)
