"""Stand-ins for a bias, joined children or blocked steps, for compartments that have none.

The step of :mod:`hw_model.arithmetic.loihi` adds and compares such values whether they exist or
not. With :data:`NOTHING` in their place the sums and comparisons return at once, without a pass
over an array.
"""

from typing import Any


class Always:
    """A condition that is true of every compartment: ``&`` returns the other operand itself."""

    __array_ufunc__ = None  # makes numpy leave `array & ALWAYS` to this class

    def __and__(self, truth: Any) -> Any:
        return truth

    __rand__ = __and__


class Nothing:
    """A number that is 0 for every compartment: adding it returns the other operand itself."""

    __array_ufunc__ = None  # makes numpy leave `array + NOTHING` to this class
    __hash__ = object.__hash__

    def __radd__(self, value: Any) -> Any:
        return value

    def __eq__(self, value: object) -> Any:
        # The step asks `blocked == 0`, which is then true of every compartment.
        return ALWAYS if isinstance(value, int) and value == 0 else value is self


ALWAYS = Always()
NOTHING = Nothing()
