"""A plugin of pytest that runs the compiled loops as plain Python, so that a planted fault need not be compiled.

It replaces the decorators that compile loops, and the functions on lanes (the compartments that one vector instruction
handles together) by functions on numpy arrays. Integers are the same, because numpy's scalars wrap as the machine's do. An
index beyond an array is an error here. Tests take about a hundred times as long, so few examples are drawn.
"""

from contextlib import nullcontext

import numpy as np
import pytest
from hypothesis import settings

from hw_model.engine import compiled, packed

EXAMPLES = 4
"""Examples that Hypothesis draws for a test; chosen by hand."""

np.seterr(over="ignore")  # wrapping integers are meant to wrap
for name in ("compiled", "shared", "inner", "absorbed"):
    setattr(compiled, name, lambda function: function)
compiled.entry = compiled.address = lambda function, *arguments: function
packed.pack = lambda record: record
compiled.call_at = lambda function, arguments: function(*arguments)

# These modules compile their loops while they are imported, so the decorators are replaced before.
from hw_model.engine import lanes, private_numba  # noqa: E402
from hw_model.engine.layout import LANES  # noqa: E402


class Place:
    """A position in an array, where the compiled loops have a pointer.

    A field is a group of as many elements as there are lanes; field 0 begins at the position.
    """

    def __init__(self, array, *indices, lanes=LANES):
        self.flat = array.reshape(-1)
        self.first = int(np.ravel_multi_index([int(index) for index in indices], array.shape))
        self.row_size = array.size // len(array)
        self.lanes = lanes

    def of(self, lanes):
        """Return the same position with fields of another number of lanes."""
        return Place(self.flat, self.first, lanes=lanes)

    def _elements_of(self, field):
        return slice(self.first + field * self.lanes, self.first + (field + 1) * self.lanes)

    def __getitem__(self, field):
        return self.flat[self._elements_of(field)].copy()

    def __setitem__(self, field, values):
        self.flat[self._elements_of(field)] = values

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
    """Stand in for the decorator of kernels: calls pass each array with its indices, the function gets a place."""

    def decorate(function):
        def call(*values):
            remaining = list(values)
            arguments = []
            while remaining:
                value = remaining.pop(0)
                if isinstance(value, np.ndarray):
                    # The indices of an element follow its array, one for each axis.
                    indices = remaining[: value.ndim]
                    remaining = remaining[value.ndim :]
                    value = Place(value, *indices)
                arguments.append(value)
            return function(*arguments)

        return call

    return decorate


def put_side_by_side(place, mask, numbers):
    """Write the numbers of the lanes in a mask one after the other; return how many."""
    chosen = numbers[mask]
    place.flat[place.first : place.first + len(chosen)] = chosen
    return np.int32(len(chosen))


def of_numbers(given, returns):
    """Stand in for the decorator of functions of 32-bit integers."""

    def decorate(function):
        return lambda *numbers: tuple(map(np.int32, function(*map(np.int32, numbers))))

    return decorate


private_numba.kernel, private_numba.of_numbers = kernel, of_numbers


def select(mask, chosen, otherwise):
    """Choose by a mask, in the type of the lanes; one of the two choices may be an integer."""
    of_type = chosen if isinstance(otherwise, int) else otherwise
    return np.where(mask, chosen, otherwise).astype(np.asarray(of_type).dtype)


def first_bits(values, bits_kept):
    """Return the highest bits of each number, shifted down without its sign."""
    unsigned = values.view(f"u{values.itemsize}")
    return (unsigned >> (8 * values.itemsize - bits_kept)).astype(values.dtype)


ON_NUMPY = {
    "put_side_by_side": put_side_by_side,
    "put_lane_numbers": lambda place, mask, first: put_side_by_side(
        place, mask, first + np.arange(len(mask))
    ),
    "first_lanes": lambda mask, many: mask & (np.arange(len(mask)) < many),
    "mask_of": lambda place, number: (int(number) >> np.arange(LANES)) & 1 != 0,
    "where": select,
    "select": select,
    "bits": lambda mask: np.int32(sum(1 << i for i in np.flatnonzero(mask).tolist())),
    "count": lambda mask: np.int32(mask.sum()),
    "halves_of_ranges": lambda place, widths: widths or (None, None),
    "seldom": lambda mask: nullcontext(),
    "as_factor": lambda values: values,
    "variable": lambda values: Place(values.copy(), 0),
    "each_row": lambda place, many: range(many),
    "first_bits": first_bits,
}
"""By the name of a function of :mod:`hw_model.engine.lanes`, the function that takes its place."""
for name, function in ON_NUMPY.items():
    # A function that was renamed there would silently not be replaced.
    assert hasattr(lanes, name), f"hw_model.engine.lanes has no {name}"
    setattr(lanes, name, function)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Draw few examples, also in tests that ask for more: a profile would not change those."""
    for item in items:
        of_test = getattr(item.obj, "_hypothesis_internal_use_settings", None)
        if of_test is not None and of_test.max_examples > EXAMPLES:
            item.obj._hypothesis_internal_use_settings = settings(of_test, max_examples=EXAMPLES)
