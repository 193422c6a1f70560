"""A plugin of pytest: the compiled loops run as the Python that they are written in, so that nothing has to be compiled.

Their integers are the same: numpy's scalars wrap as the machine's do. A place beyond an array is an error here. It takes a
hundred times as long, so that few examples are drawn.
"""

import numpy as np
import pytest
from hypothesis import settings

from hw_model.engine import compiled

EXAMPLES = 4

np.seterr(over="ignore")
for name in ("compiled", "inner", "absorbed"):
    setattr(compiled, name, lambda given: given)
compiled.entry = lambda function, *arguments: function
compiled.trailing_zeros = lambda word: (int(word) & -int(word)).bit_length() - 1

from hw_model.engine import lane_arithmetic  # noqa: E402

lane_arithmetic.fit = lambda value, like: like.dtype.type(np.int64(value))


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    for item in items:
        given = getattr(item.obj, "_hypothesis_internal_use_settings", None)
        if given is not None and given.max_examples > EXAMPLES:
            item.obj._hypothesis_internal_use_settings = settings(given, max_examples=EXAMPLES)
