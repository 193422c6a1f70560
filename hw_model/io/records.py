"""Records: frozen dataclasses whose annotations say which values each field may have.

An example is ``Annotated[int, between(1, 8)]``. The same annotations are checked in two places: when a record is made
in Python (:class:`Checked`), and when it is read from plain values such as those of a YAML file
(:class:`RecordReader`).
Chips, cost profiles, sensor layouts and checkpoints are records. *Plain* values are numbers, texts, lists and
dictionaries.
"""

import sys
from collections.abc import Callable, Mapping
from dataclasses import MISSING, fields
from functools import cache
from numbers import Real
from types import NoneType, UnionType
from typing import (
    Annotated,
    Any,
    ClassVar,
    Literal,
    NamedTuple,
    TypeVar,
    get_args,
    get_origin,
    get_type_hints,
)

from hw_model.errors import InputError, did_you_mean
from hw_model.io.arguments import check_argument, classes_of, kinds_of
from hw_model.values import Frozen

T = TypeVar("T")
KIND_WORDS: dict[type, str] = {
    str: "text",
    int: "a whole number",
    float: "a number",
    bool: "true or false",
    dict: "a mapping of names",
    list: "a list",
    tuple: "a list",
    NoneType: "nothing",
}
"""How error messages name a type."""
_PLAIN_TYPES: dict[type, tuple[type, ...]] = {
    float: (float, int),
    tuple: (list, tuple),
    Mapping: (dict,),
}
"""The types of plain values that are accepted for a field's type, where they are not just that type."""


class Must(NamedTuple):
    """A rule for the values of a field: a function that returns whether a value obeys it, and its words in errors."""

    holds: Callable[[Any], Any]
    words: str


POSITIVE = Must(lambda v: v > 0, "above 0")
AT_LEAST_ONE = Must(lambda v: v >= 1, "at least 1")
NOT_NEGATIVE = Must(lambda v: v >= 0, "at least 0")


def between(low: float, high: float) -> Must:
    """Return the rule that a number is from ``low`` to ``high``, both included."""
    # `&`, not `and`: it works for arrays, too.
    return Must(lambda v: (v >= low) & (v <= high), f"from {low:.16g} to {high:.16g}")


@cache
def field_kinds(record: type) -> dict[str, tuple[type, ...]]:
    """Return the types of plain values that each field of a record accepts."""
    hints = get_type_hints(record)
    return {item.name: _plain_types(hints[item.name]) for item in fields(record)}


def said_of(record: type) -> dict[str, tuple[Any, ...]]:
    """Return what ``Annotated`` says about each field in addition to its type: rules, choices and notes."""
    return {name: getattr(hint, "__metadata__", ()) for name, hint in _hints(record).items()}


@cache
def _hints(record: type) -> dict[str, Any]:
    return get_type_hints(record, include_extras=True)


def _plain_types(hint: Any) -> tuple[type, ...]:
    """Return the types of plain values that a type hint accepts."""
    accepted: list[type] = []
    for kind in classes_of(hint):
        accepted += _PLAIN_TYPES.get(kind, (kind,))
    return tuple(accepted)


def check_value(
    where: str,
    value: Any,
    kinds: tuple[type, ...],
    annotations: tuple[Any, ...] = (),
    fix: str = "Correct it.",
) -> None:
    """Raise InputError for a value of a wrong type, a value that breaks a rule, and one that is not among its choices.

    ``annotations`` are those of the field, see :func:`said_of`. Rules (:class:`Must`) and tuples of choices are
    checked, everything else is ignored. Numbers must be finite.
    """
    rules = [rule for rule in annotations if isinstance(rule, Must)]
    # In this order: a rule compares numbers, so it is asked only about a finite value of the right type.
    if not (
        _is_of_types(value, kinds)
        and _is_finite(value)
        and (value is None or all(rule.holds(value) for rule in rules))
    ):
        raise _wrong_value(where, value, kinds, rules, fix)
    for choices in annotations:
        # None is the missing value, which is always a choice.
        if type(choices) is tuple and value not in (None, *choices):
            raise InputError(
                where, f"{value!r} is not known", fix=did_you_mean(value, map(str, choices))
            )


def _is_of_types(value: Any, kinds: tuple[type, ...]) -> bool:
    """Return whether a value is of one of these types; True and False are not numbers here."""
    if isinstance(value, bool) and bool not in kinds:
        return False
    return isinstance(value, kinds)


def _is_finite(value: Any) -> bool:
    """Return whether a value, if it is a number, is finite and not an integer too large for a float."""
    return not isinstance(value, int | float) or abs(value) <= sys.float_info.max


def _wrong_value(
    where: str, value: Any, kinds: tuple[type, ...], rules: list[Must], fix: str
) -> InputError:
    """Return the error for a value that is of none of the types or breaks a rule."""
    words = [KIND_WORDS.get(kinds[0], f"a {kinds[0].__name__.lower()}")]
    for rule in rules:
        words.append(f"of {rule.words}" if rule.words.startswith("at least") else rule.words)
    is_short = isinstance(value, str | int | float | None)
    measured = f"got {value!r}" if is_short else f"got {type(value).__name__}"
    if kinds == (str,) and isinstance(value, int | float):
        # In YAML, a name such as 12 is a number unless it is quoted.
        fix = "Put it in quotes."
    return InputError(where, f"it must be {' '.join(words)}", measured=measured[:80], fix=fix)


class Checked(Frozen):
    """Base of records that check their fields when they are made. ``called`` names the record in errors."""

    called: ClassVar[str] = "field"

    def __post_init__(self) -> None:
        own: type = type(self)
        for name, kinds in field_kinds(own).items():
            check_value(f"{self.called} {name!r}", getattr(self, name), kinds, said_of(own)[name])


def check_fields(record: object) -> None:
    """Check the fields of a dataclass that a user made in Python, and that does not check itself.

    Raises ``InputError`` for a field, or an item of a tuple, that is not as annotated. A list may stand for a tuple,
    and the contents of arrays are not checked. Numbers of numpy are replaced by Python's. Errors name the record by
    its field ``where`` if it has one, else by its type.
    """
    own: type = type(record)
    try:
        called = getattr(record, "where", own.__name__)
        hints = get_type_hints(own)
        annotations = said_of(own)
    except NameError:
        # A user's type, whose annotations may use names that are imported only for type checkers: check nothing.
        return
    for name in (item.name for item in fields(record)):  # type: ignore[arg-type]
        value = getattr(record, name)
        if isinstance(value, Real) and not isinstance(value, int | float):
            # The files that records are written to hold Python's numbers.
            value = value.item()  # type: ignore[attr-defined]
            object.__setattr__(record, name, value)
        if annotations[name]:
            check_value(f"{called}, {name}", value, field_kinds(own)[name], annotations[name])
        else:
            _check_by_hint(called, name, value, hints[name])


def _check_by_hint(called: str, name: str, value: Any, hint: Any) -> None:
    """Check a field that has a type, but no rules; ``called`` names its record."""
    choices = get_args(hint) if get_origin(hint) is Literal else ()
    if hint is bool:
        # `kinds_of` accepts anything for a bool.
        kinds: tuple[Any, ...] = (bool,)
    elif choices:
        kinds = (str,)
    else:
        kinds = kinds_of(hint)
    is_list_for_tuple = isinstance(value, list) and tuple in kinds
    check_argument(called, name, tuple(value) if is_list_for_tuple else value, kinds)
    if choices and value not in choices:
        raise InputError(
            f"{called}, {name}", f"there is no {value!r}"[:80], fix=did_you_mean(value, choices)
        )
    if not isinstance(value, tuple | list):
        return
    # The hint may be `tuple[int, ...]` itself, or a union that contains it.
    for option in (hint, *get_args(hint)):
        if get_origin(option) is tuple and get_args(option)[-1] is ...:
            item_kinds = kinds_of(get_args(option)[0])
            for item in value:
                check_argument(called, name, item, item_kinds)


class RecordReader(Frozen):
    """Reads records from plain values.

    Errors name the file, ``where``, and the path of the value in it, such as ``chip.limits.cores``. ``fix`` is the way
    out of most errors; if it is empty, each error has its own.
    """

    where: str
    fix: str = ""
    may_omit_defaults: bool = True
    """Whether an entry may be missing if its field has a default."""

    def place(self, key: str) -> str:
        """Return how errors name the value at the path ``key``."""
        return f"{self.where}: {key}" if key else self.where

    def entries(self, value: Any, key: str, required: Mapping[str, bool]) -> Mapping[str, Any]:
        """Return the mapping ``value`` after checking its names.

        ``required`` has all names that it may contain, and whether each must be there. Raises ``InputError`` for a
        value that is not a mapping, an unknown name, and a missing one.
        """
        check_value(self.place(key), value, (dict,), fix=self.fix or "Correct it.")
        for name in value:
            if name not in required:
                shown = str(name)[:60]
                fix = did_you_mean(shown, required) if required else "Leave it out."
                raise InputError(self.place(key), f"unknown key {shown!r}", fix=fix)
        for name, needed in required.items():
            if needed and name not in value:
                raise InputError(
                    self.place(key), f"the key {name!r} is missing", fix=self.fix or "Add it."
                )
        return dict(value)

    def record(self, kind: type[T], value: Any, key: str = "", **given: object) -> T:
        """Return the record of type ``kind`` that the mapping ``value`` describes.

        The fields ``given`` are set by the caller and must not be in the mapping.
        """
        own: type = kind
        hints = _hints(own)
        required: dict[str, bool] = {}
        for item in fields(kind):  # type: ignore[arg-type]
            if item.name not in given:
                has_default = item.default is not MISSING or item.default_factory is not MISSING
                required[item.name] = not (self.may_omit_defaults and has_default)
        # A record can accept a shorter form in files, which its `from_plain` turns into a mapping.
        expand = getattr(kind, "from_plain", None)
        mapping = value if expand is None else expand(value)
        prefix = f"{key}." if key else ""
        values = {
            name: self.value(hints[name], entry, prefix + name)
            for name, entry in self.entries(mapping, key, required).items()
        }
        return kind(**given, **values)

    def value(self, hint: Any, value: Any, key: str) -> Any:
        """Return a plain value converted to its annotated type.

        Mappings become records, lists tuples, and whole numbers floats.
        """
        annotations = getattr(hint, "__metadata__", ())
        # Annotated[T, ...] becomes T.
        hint = get_args(hint)[0] if annotations else hint
        if isinstance(hint, UnionType):
            return self._value_of_union(hint, annotations, value, key)
        origin = get_origin(hint) or hint
        if hasattr(origin, "__dataclass_fields__"):
            return self.record(origin, value, key)
        check_value(self.place(key), value, _plain_types(hint), annotations, self._way_out)
        if origin is Mapping:
            _, value_hint = get_args(hint)
            return {
                name: self.value(value_hint, entry, f"{key}.{name}")
                for name, entry in value.items()
            }
        if origin is tuple:
            return self._tuple(get_args(hint), value, key)
        return float(value) if origin is float else value

    @property
    def _way_out(self) -> str:
        return self.fix or "Correct it."

    def _tuple(self, hints: tuple[Any, ...], value: Any, key: str) -> tuple[Any, ...]:
        """Return a list as a tuple; ``hints`` is a hint per item, or one for all items followed by ``...``."""
        if hints[-1] is ...:
            item_hints = hints[:1] * len(value)
        elif len(hints) == len(value):
            item_hints = hints
        else:
            what = f"it must be a list of {len(hints)}"
            raise InputError(self.place(key), what, measured=f"got {len(value)}", fix=self._way_out)
        return tuple(
            self.value(hint, entry, key) for hint, entry in zip(item_hints, value, strict=True)
        )

    def _value_of_union(
        self, hint: UnionType, annotations: tuple[Any, ...], value: Any, key: str
    ) -> Any:
        """Return a value whose annotation is a union such as ``int | None``; None is a missing value."""
        if value is None:
            return None
        first, *others = [part for part in get_args(hint) if part is not NoneType]
        if not others:
            return self.value(_annotated(first, annotations), value, key)
        check_value(self.place(key), value, _plain_types(hint), annotations, self._way_out)
        return float(value) if isinstance(value, int) and first is float else value


def _annotated(hint: Any, annotations: tuple[Any, ...]) -> Any:
    """Return a hint with these annotations, in addition to its own."""
    return Annotated[(hint, *annotations)] if annotations else hint
