"""What a step is given in place of a bias, children or blocked steps where there are none."""

from typing import Any


class Always:
    """What holds of every compartment: to combine it with what holds of some takes no time."""

    __array_ufunc__ = None  # numpy then leaves it to this class

    def __and__(self, truth: Any) -> Any:
        return truth

    __rand__ = __and__


class Nothing:
    """A bias, what children pass, or blocked steps, where there are none: adding it takes no time."""

    __array_ufunc__ = None
    __hash__ = object.__hash__

    def __radd__(self, value: Any) -> Any:
        return value

    def __eq__(self, value: object) -> Any:
        return ALWAYS if isinstance(value, int) and value == 0 else value is self


ALWAYS = Always()
NOTHING = Nothing()
