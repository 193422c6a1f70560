"""Records: frozen values whose annotations say what each field may be, as in ``Annotated[int, between(1, 8)]``.

The same annotations are checked where a record is made in Python (:class:`Checked`) and where it is read from a file of
plain values (:class:`RecordReader`): a chip, a profile, the layout of a sensor, a checkpoint.
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
from hw_model.io.given import check_argument, classes_of, kinds_of
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
"""What messages call a type."""
_HELD: dict[type, tuple[type, ...]] = {float: (float, int), tuple: (list, tuple), Mapping: (dict,)}
"""Type of a field -> those that a file may have for it, if they are others."""


class Must(NamedTuple):
    """What every number of a field must be, and the words that say it."""

    holds: Callable[[Any], Any]
    words: str


POSITIVE = Must(lambda v: v > 0, "above 0")
AT_LEAST_ONE = Must(lambda v: v >= 1, "at least 1")
NOT_NEGATIVE = Must(lambda v: v >= 0, "at least 0")


def between(low: float, high: float) -> Must:
    """Return the rule of numbers from ``low`` to ``high``, both included."""
    return Must(lambda v: (v >= low) & (v <= high), f"from {low:.16g} to {high:.16g}")


@cache
def field_kinds(record: type) -> dict[str, tuple[type, ...]]:
    """Return the types that a file may have for each field of a record."""
    hints = get_type_hints(record)
    return {item.name: _kinds(hints[item.name]) for item in fields(record)}


def said_of(record: type) -> dict[str, tuple[Any, ...]]:
    """Return what the annotation of each field says in addition to its type."""
    return {name: getattr(hint, "__metadata__", ()) for name, hint in _hints(record).items()}


@cache
def _hints(record: type) -> dict[str, Any]:
    return get_type_hints(record, include_extras=True)


def _kinds(hint: Any) -> tuple[type, ...]:
    return tuple(kind for part in classes_of(hint) for kind in _HELD.get(part, (part,)))


def check_value(
    where: str,
    value: Any,
    kinds: tuple[type, ...],
    said: tuple[Any, ...] = (),
    fix: str = "Correct it.",
) -> None:
    """Refuse a value of another type, a value that breaks a rule, and one that is not among its choices.

    ``said`` may hold rules and tuples of choices; everything else in it is ignored. Numbers must be finite.
    """
    rules = [rule for rule in said if isinstance(rule, Must)]
    finite = not isinstance(value, int | float) or abs(value) <= sys.float_info.max
    fits = isinstance(value, kinds) and (
        bool in kinds or not isinstance(value, bool)
    )  # True and False are not numbers
    if not (fits and finite and (value is None or all(rule.holds(value) for rule in rules))):
        kind = KIND_WORDS.get(kinds[0], f"a {kinds[0].__name__.lower()}")
        words = [
            f"of {rule.words}" if rule.words.startswith("at least") else rule.words
            for rule in rules
        ]
        measured = (
            f"got {value!r}"
            if isinstance(value, str | int | float | None)
            else f"got {type(value).__name__}"
        )
        fix = "Put it in quotes." if kinds == (str,) and isinstance(value, int | float) else fix
        raise InputError(
            where, f"it must be {' '.join([kind, *words])}", measured=measured[:80], fix=fix
        )
    for choices in said:
        if type(choices) is tuple and value not in (None, *choices):
            raise InputError(
                where, f"{value!r} is not known", fix=did_you_mean(value, map(str, choices))
            )


class Checked(Frozen):
    """A record that checks its fields when it is made; ``called`` names it in errors."""

    called: ClassVar[str] = "field"

    def __post_init__(self) -> None:
        own: type = type(self)
        for name, kinds in field_kinds(own).items():
            check_value(f"{self.called} {name!r}", getattr(self, name), kinds, said_of(own)[name])


def check_fields(record: object) -> None:
    """Refuse fields of a record that are not as annotated, and such items of tuples; numbers of numpy become Python's.

    ``record``: a dataclass that a user made, which itself takes what it is given. A list may stand for a tuple, and
    arrays are not looked into. Errors name it by its ``where`` if it has one, else by its type.
    """
    own: type = type(record)
    try:
        called = getattr(record, "where", own.__name__)
        hints = get_type_hints(own)
        said = said_of(own)
    except (
        NameError
    ):  # a type from elsewhere, whose annotations may name what only type checkers import
        return
    for name in (item.name for item in fields(record)):  # type: ignore[arg-type]
        value = getattr(record, name)
        hint = hints[name]
        if isinstance(value, Real) and not isinstance(value, int | float):
            value = value.item()  # type: ignore[attr-defined]  # files hold Python's numbers, not those of numpy
            object.__setattr__(record, name, value)
        if said[name]:
            check_value(f"{called}, {name}", value, field_kinds(own)[name], said[name])
            continue
        chosen = get_args(hint) if get_origin(hint) is Literal else ()
        kinds = (bool,) if hint is bool else (str,) if chosen else kinds_of(hint)
        check_argument(
            called,
            name,
            tuple(value) if isinstance(value, list) and tuple in kinds else value,
            kinds,
        )
        if chosen and value not in chosen:
            raise InputError(
                f"{called}, {name}", f"there is no {value!r}"[:80], fix=did_you_mean(value, chosen)
            )
        for option in (hints[name], *get_args(hints[name])):
            if (
                get_origin(option) is tuple
                and get_args(option)[-1] is ...
                and isinstance(value, tuple | list)
            ):
                for one in value:
                    check_argument(called, name, one, kinds_of(get_args(option)[0]))


class RecordReader(Frozen):
    """Reads records from plain values. Errors name the file, ``where``, and the path of the value in it."""

    where: str
    fix: str = ""
    lacks: bool = True
    """Whether a file may lack what has a default."""

    def place(self, key: str) -> str:
        """Return how errors name a value."""
        return f"{self.where}: {key}" if key else self.where

    def entries(self, value: Any, key: str, required: Mapping[str, bool]) -> Mapping[str, Any]:
        """Return a mapping; refuse other values, unknown names, and the lack of a ``required`` name."""
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
        """Return the record that a mapping describes, with the fields that are ``given``."""
        own: type = kind
        hints = _hints(own)
        wanted = [item for item in fields(kind) if item.name not in given]  # type: ignore[arg-type]
        required = {
            i.name: not self.lacks or (i.default is MISSING and i.default_factory is MISSING)
            for i in wanted
        }
        held = getattr(kind, "from_plain", lambda plain: plain)(value)
        entries = self.entries(held, key, required)
        inside = f"{key}." if key else ""
        return kind(
            **given,
            **{
                name: self.value(hints[name], entry, inside + name)
                for name, entry in entries.items()
            },
        )

    def value(self, hint: Any, value: Any, key: str) -> Any:
        """Return a value as its annotation asks: mappings become records, lists tuples, and whole numbers floats."""
        said = getattr(hint, "__metadata__", ())
        hint = get_args(hint)[0] if said else hint
        if isinstance(hint, UnionType):
            return self._one_of(hint, said, value, key)
        origin = get_origin(hint) or hint
        parts = get_args(hint)
        if hasattr(origin, "__dataclass_fields__"):
            return self.record(origin, value, key)
        check_value(self.place(key), value, _kinds(hint), said, self.fix or "Correct it.")
        if origin is Mapping:
            return {
                name: self.value(parts[1], entry, f"{key}.{name}") for name, entry in value.items()
            }
        if origin is tuple:
            if parts[-1] is not ... and len(parts) != len(value):
                what = f"it must be a list of {len(parts)}"
                raise InputError(
                    self.place(key),
                    what,
                    measured=f"got {len(value)}",
                    fix=self.fix or "Correct it.",
                )
            each = parts[:1] * len(value) if parts[-1] is ... else parts
            return tuple(
                self.value(part, entry, key) for part, entry in zip(each, value, strict=True)
            )
        return float(value) if origin is float else value

    def _one_of(self, hint: UnionType, said: tuple[Any, ...], value: Any, key: str) -> Any:
        """Return a value of one of several types, or None: a missing value."""
        if value is None:
            return None
        first, *others = [part for part in get_args(hint) if part is not NoneType]
        if not others:
            return self.value(_with(first, said), value, key)
        check_value(self.place(key), value, _kinds(hint), said, self.fix or "Correct it.")
        return float(value) if isinstance(value, int) and first is float else value


def _with(hint: Any, said: tuple[Any, ...]) -> Any:
    """Return a hint with these annotations, in addition to its own."""
    return Annotated[(hint, *said)] if said else hint
