"""Entries of report.json as types, with one writer for all of them.

The fields of an entry are keys of the document, in its order. Annotations say where a key differs
from its field: :class:`Inlined`, :class:`LeftOut` and :data:`NULLS`.
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
    """A part of report.json; entries of equal figures are equal."""

    def __init_subclass__(cls, **options: bool) -> None:
        super().__init_subclass__(**{"eq": True, **options})


class LeftOut(NamedTuple):
    """The key is absent where the field is None; ``without``: only if that field is None as well."""

    without: str = ""


class Inlined(NamedTuple):
    """The keys of the field's own entry stand in its place; ``renamed`` are pairs of its and theirs."""

    renamed: tuple[tuple[str, str], ...] = ()

    def name(self, key: str) -> str:
        """Return the key in the document for a key of the entry."""
        return dict(self.renamed).get(key, key)


INLINED: Final = Inlined()
NULLS: Final = "nulls"
"""Where the field is None, the document has all keys of the entry, and each is null."""
IfKnown = Annotated[T | None, LeftOut()]
"""A field whose key is absent where it is None."""


class Field(Frozen):
    """A field of an entry, its key in the document, and what its annotation says.

    ``kinds`` are the types that its value may have, without None.
    """

    name: str
    hint: Any
    kinds: tuple[Any, ...]
    said: tuple[Any, ...]

    @property
    def key(self) -> str:
        """The key in the document: a name that is a word of Python ends in an underscore."""
        return self.name.removesuffix("_")

    @property
    def left_out(self) -> LeftOut | None:
        """Whether the key may be absent."""
        return next((word for word in self.said if isinstance(word, LeftOut)), None)

    @property
    def inlined(self) -> Inlined | None:
        """Whether the keys of its entry stand in its place."""
        return next((word for word in self.said if isinstance(word, Inlined)), None)

    @property
    def keys(self) -> list[str]:
        """The keys that the field has in the document."""
        if self.inlined is None:
            return [self.key]
        return [self.inlined.name(key) for key in keys_of(self.kinds[0])]


def fields_of(kind: Any) -> tuple[Field, ...]:
    """Return the fields of a type of entry, in order."""
    return _fields_of(kind)


@cache
def _fields_of(kind: Any) -> tuple[Field, ...]:
    hints = get_type_hints(kind, include_extras=True)
    return tuple(_field(item.name, hints[item.name]) for item in fields(kind))


def _field(name: str, hint: Any) -> Field:
    metadata = getattr(hint, "__metadata__", ())
    bare = get_args(hint)[0] if metadata else hint
    return Field(name, hint, tuple(k for k in alternatives(bare) if k is not NoneType), metadata)


def alternatives(hint: Any) -> tuple[Any, ...]:
    """Return the types of a union, or the only type."""
    return get_args(hint) if get_origin(hint) in (UnionType, Union) else (hint,)


def keys_of(kind: Any) -> list[str]:
    """Return the keys that an entry of this type may have in the document, in order."""
    return [key for field in fields_of(kind) for key in field.keys]


def plain(value: Any) -> Any:
    """Return a value as the document has it: entries and mappings as dictionaries, tuples as lists."""
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
        if value is None and NULLS in field.said:
            value = dict.fromkeys(keys_of(field.kinds[0]))
        if field.inlined is None:
            yield field.key, plain(value)
            continue
        for key, item in plain(value).items():
            yield field.inlined.name(key), item


def _is_absent(field: Field, entry: Any) -> bool:
    if field.left_out is None:
        return False
    return not field.left_out.without or getattr(entry, field.left_out.without) is None
