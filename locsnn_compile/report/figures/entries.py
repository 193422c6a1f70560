"""Types for the parts of report.json, called entries, and the function that writes any of them as plain JSON values.

An entry is a frozen dataclass. Its fields, in their order, are the keys of a JSON object. An annotation
says where the object differs from the fields:

- :class:`Inlined`: the keys of a nested entry stand next to those of the outer one, without nesting
- :class:`LeftOut`: a key is absent, rather than null, where the field is None
- :data:`NULLS`: where a nested entry is None, all its keys are null

``figures/typed.py`` reads the objects back.
"""

from collections.abc import Iterator, Mapping
from dataclasses import fields, is_dataclass
from functools import cache
from types import NoneType, UnionType
from typing import (
    Annotated,
    Any,
    Final,
    NamedTuple,
    TypeVar,
    Union,
    get_args,
    get_origin,
    get_type_hints,
)

from hw_model.values import Frozen, Shown

T = TypeVar("T")


class Entry(Shown):
    """A part of report.json; entries with equal figures are equal, although ``Shown`` compares by identity."""

    def __init_subclass__(cls, **options: bool) -> None:
        super().__init_subclass__(**{"eq": True, **options})


class LeftOut(NamedTuple):
    """Marks a field whose key is absent where the field is None.

    ``without`` names another field of the entry: the key is absent only if that field is None as well.
    """

    without: str = ""


class Inlined(NamedTuple):
    """Marks a field that holds an entry whose keys stand among those of the outer entry.

    ``renamed`` are pairs: a key of the inner entry, and what the document calls it.
    """

    renamed: tuple[tuple[str, str], ...] = ()

    def name(self, key: str) -> str:
        """Return the key in the document for a key of the entry."""
        return dict(self.renamed).get(key, key)


INLINED: Final = Inlined()
NULLS: Final = "nulls"
"""Marks a field that holds an entry or None: where it is None, the document has all keys of the entry, each null."""
IfKnown = Annotated[T | None, LeftOut()]
"""The type of a field whose key is absent where the field is None."""


class Field(Frozen):
    """A field of an entry, with what its annotation says.

    - ``hint``: the annotation as it stands in the class
    - ``kinds``: the types that a value may have, without None
    - ``marks``: what ``Annotated`` adds to the type, such as :data:`INLINED`
    """

    name: str
    hint: Any
    kinds: tuple[Any, ...]
    marks: tuple[Any, ...]

    @property
    def key(self) -> str:
        """The key in the document. Keys such as ``class`` are keywords of Python, so their field is ``class_``."""
        return self.name.removesuffix("_")

    @property
    def left_out(self) -> LeftOut | None:
        """The mark that the key may be absent, None if it may not."""
        return next((mark for mark in self.marks if isinstance(mark, LeftOut)), None)

    @property
    def inlined(self) -> Inlined | None:
        """The mark that the keys of the field's entry stand in its place, None if they do not."""
        return next((mark for mark in self.marks if isinstance(mark, Inlined)), None)

    @property
    def keys(self) -> list[str]:
        """The keys that the field has in the document."""
        if self.inlined is None:
            return [self.key]
        return [self.inlined.name(key) for key in keys_of(self.kinds[0])]


def fields_of(kind: Any) -> tuple[Field, ...]:
    """Return the fields of a type of entry, in order."""
    # Not cached itself: mypy takes a class as an argument here, but not as a key of a cache.
    return _fields_of(kind)


@cache
def _fields_of(kind: Any) -> tuple[Field, ...]:
    hints = get_type_hints(kind, include_extras=True)
    return tuple(_field(field.name, hints[field.name]) for field in fields(kind))


def _field(name: str, hint: Any) -> Field:
    # ``Annotated[T, mark]`` has the marks in __metadata__, and T as its first argument.
    marks = getattr(hint, "__metadata__", ())
    bare_type = get_args(hint)[0] if marks else hint
    kinds = tuple(kind for kind in alternatives(bare_type) if kind is not NoneType)
    return Field(name, hint, kinds, marks)


def alternatives(hint: Any) -> tuple[Any, ...]:
    """Return the types of a union such as ``int | None``; of any other type, the type itself."""
    return get_args(hint) if get_origin(hint) in (UnionType, Union) else (hint,)


def keys_of(kind: Any) -> list[str]:
    """Return the keys that an entry of this type may have in the document, in order."""
    return [key for field in fields_of(kind) for key in field.keys]


def plain(value: Any) -> Any:
    """Return a value as plain JSON values: entries and mappings become dictionaries, tuples become lists."""
    if is_dataclass(value) and not isinstance(value, type):
        return dict(_items(value))
    if isinstance(value, Mapping):
        return {key: plain(item) for key, item in value.items()}
    if isinstance(value, tuple | list):
        return [plain(item) for item in value]
    return value


def _items(entry: Any) -> Iterator[tuple[str, Any]]:
    """Yield the keys of an entry with their values in the document."""
    for field in fields_of(type(entry)):
        value = getattr(entry, field.name)
        if value is None and _is_absent(field, entry):
            continue
        if value is None and NULLS in field.marks:
            value = dict.fromkeys(keys_of(field.kinds[0]))  # every key null
        if field.inlined is None:
            yield field.key, plain(value)
            continue
        for key, item in plain(value).items():
            yield field.inlined.name(key), item


def _is_absent(field: Field, entry: Any) -> bool:
    """Whether the document has no key for a field that is None."""
    if field.left_out is None:
        return False
    other_field = field.left_out.without
    return not other_field or getattr(entry, other_field) is None
