"""A plugin of pytest: the compiled loops run as the Python that they are written in, so that nothing has to be compiled.

Their integers are the same: numpy's scalars wrap as the machine's do. A place beyond an array is an error here. It takes a
hundred times as long, so that few examples are drawn.
"""

from contextlib import nullcontext

import numpy as np
import pytest
from hypothesis import settings

from hw_model.engine import compiled, packed

EXAMPLES = 4

np.seterr(over="ignore")
for name in ("compiled", "shared", "inner", "absorbed"):
    setattr(compiled, name, lambda given: given)
compiled.entry = compiled.address = lambda function, *arguments: function
packed.pack = lambda record: record
compiled.call_at = lambda function, arguments: function(*arguments)

from hw_model.engine import lanes, private_numba  # noqa: E402
from hw_model.engine.layout import LANES  # noqa: E402


class Place:
    """What a kernel is given in place of an array and the index of its first element."""

    def __init__(self, array, *at, lanes=LANES):
        self.flat, self.first = (
            array.reshape(-1),
            int(np.ravel_multi_index([int(i) for i in at], array.shape)),
        )
        self.row_size, self.lanes = array.size // len(array), lanes

    def of(self, lanes):
        return Place(self.flat, self.first, lanes=lanes)

    def _of(self, field):
        return slice(self.first + field * self.lanes, self.first + (field + 1) * self.lanes)

    def __getitem__(self, field):
        return self.flat[self._of(field)].copy()

    def __setitem__(self, field, values):
        self.flat[self._of(field)] = values

    def each(self, number):
        return np.full(LANES, number, self.flat.dtype)

    def numbers(self):
        return np.arange(LANES, dtype=self.flat.dtype)

    def after(self, fields):
        return Place(self.flat, self.first + fields * LANES)

    def row(self, number):
        return Place(self.flat, self.first + number * self.row_size)

    def bits(self):
        return lanes.mask_of(self, self.flat[self.first])

    def put_bits(self, mask):
        self.flat[self.first] = lanes.bits(mask)


def kernel(given, returns):
    def made(function):
        def call(*values):
            rest, places = list(values), []
            while rest:
                value = rest.pop(0)
                if isinstance(value, np.ndarray):
                    at, rest = rest[: value.ndim], rest[value.ndim :]
                    value = Place(value, *at)
                places.append(value)
            return function(*places)

        return call

    return made


def put(place, mask, numbers):
    found = numbers[mask]
    place.flat[place.first : place.first + len(found)] = found
    return np.int32(len(found))


def of_numbers(given, returns):
    def made(function):
        return lambda *numbers: tuple(map(np.int32, function(*map(np.int32, numbers))))

    return made


private_numba.kernel, private_numba.of_numbers = kernel, of_numbers
lanes.put = put
lanes.put_numbers = lambda place, mask, first: put(place, mask, first + np.arange(len(mask)))
lanes.first_lanes = lambda mask, many: mask & (np.arange(len(mask)) < many)
lanes.mask_of = lambda place, number: (int(number) >> np.arange(LANES)) & 1 != 0
lanes.where = lambda mask, one, other: np.where(mask, one, other).astype(np.asarray(other).dtype)
lanes.select = lambda mask, one, other: np.where(mask, one, other).astype(
    np.asarray(one if isinstance(other, int) else other).dtype
)
lanes.bits = lambda mask: np.int32(sum(1 << i for i in np.flatnonzero(mask).tolist()))
lanes.count = lambda mask: np.int32(mask.sum())
lanes.halves = lambda place, widths: widths or (None, None)
lanes.seldom = lambda mask: nullcontext()
lanes.short = lambda values: values
lanes.held = lambda values: Place(values.copy(), 0)
lanes.each_row = lambda place, many: range(many)
lanes.before = lambda values, many: np.where(values < 0, (1 << many) - 1, 0).astype(values.dtype)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    for item in items:
        given = getattr(item.obj, "_hypothesis_internal_use_settings", None)
        if given is not None and given.max_examples > EXAMPLES:
            item.obj._hypothesis_internal_use_settings = settings(given, max_examples=EXAMPLES)
