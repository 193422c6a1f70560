"""Entries of report.json as types, with one writer and one reader for all of them.

The fields of an entry are keys of the document, in its order. Annotations say where a key differs
from its field: :class:`Inlined`, :class:`LeftOut`, :data:`NULLS` and :class:`EarlierVersions`.
"""

from collections.abc import Iterator, Mapping
from dataclasses import fields, is_dataclass
from functools import cache
from types import NoneType, UnionType
from typing import (
    Annotated,
    Any,
    Final,
    Literal,
    NamedTuple,
    TypeVar,
    Union,
    get_args,
    get_origin,
    get_type_hints,
)

from hw_model.errors import InputError
from hw_model.io.records import RecordReader, check_value
from hw_model.values import Frozen, Shown

T = TypeVar("T")


class Entry(Shown):
    """A part of report.json; entries of equal figures are equal."""

    def __init_subclass__(cls, **options: bool) -> None:
        super().__init_subclass__(**{"eq": True, **options})


class LeftOut(NamedTuple):
    """The key is absent where the field is None; ``without``: only if that field is None as well."""

    without: str = ""


class EarlierVersions(NamedTuple):
    """Earlier versions did not write the key: they meant this value of the document."""

    meant: Any


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


class _Field(Frozen):
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
    def earlier(self) -> EarlierVersions | None:
        """What the absence of the key meant in earlier versions."""
        return next((word for word in self.said if isinstance(word, EarlierVersions)), None)

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


def _fields(kind: Any) -> tuple[_Field, ...]:
    return _fields_of(kind)


@cache
def _fields_of(kind: Any) -> tuple[_Field, ...]:
    hints = get_type_hints(kind, include_extras=True)
    return tuple(_field(item.name, hints[item.name]) for item in fields(kind))


def _field(name: str, hint: Any) -> _Field:
    said = getattr(hint, "__metadata__", ())
    bare = get_args(hint)[0] if said else hint
    return _Field(name, hint, tuple(k for k in _alternatives(bare) if k is not NoneType), said)


def _alternatives(hint: Any) -> tuple[Any, ...]:
    """Return the types of a union, or the only one."""
    return get_args(hint) if get_origin(hint) in (UnionType, Union) else (hint,)


def keys_of(kind: Any) -> list[str]:
    """Return the keys that an entry of this type may have in the document, in order."""
    return [key for field in _fields(kind) for key in field.keys]


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
    for field in _fields(type(entry)):
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


def _is_absent(field: _Field, entry: Any) -> bool:
    if field.left_out is None:
        return False
    return not field.left_out.without or getattr(entry, field.left_out.without) is None


def typed(kind: type[T], document: Any) -> T:
    """Return the entry that a plain document describes; ``InputError`` names what it cannot be."""
    return _EntryReader("report.json", "Compile it again with this version.").record(kind, document)


class _EntryReader(RecordReader):
    """Reads entries: of several types that a value may have, the first one that fits."""

    def record(self, kind: type[T], value: Any, key: str = "", **given: object) -> T:
        """Return the entry that a mapping describes."""
        own = _fields(kind)
        required = {name: _is_required(field) for field in own for name in field.keys}
        items = self.entries(value, key, required)
        return kind(**given, **{field.name: self._value_of(field, items, key) for field in own})

    def _value_of(self, field: _Field, items: Mapping[str, Any], key: str) -> Any:
        if field.inlined is not None:
            names = {key: field.inlined.name(key) for key in keys_of(field.kinds[0])}
            own = {key: items[name] for key, name in names.items() if name in items}
            if NULLS in field.said and _only_nulls(own):
                return None
            return self.record(field.kinds[0], own, key)
        place = f"{key}.{field.key}" if key else field.key
        if field.key in items:
            value = items[field.key]
        elif field.earlier is not None:
            value = field.earlier.meant
        else:
            return None
        if NULLS in field.said and _only_nulls(value):
            return None
        return self.value(field.hint, value, place)

    def value(self, hint: Any, value: Any, key: str) -> Any:
        """Return a value as its annotation asks."""
        bare = get_args(hint)[0] if getattr(hint, "__metadata__", ()) else hint
        if get_origin(bare) is Literal:
            check_value(self.place(key), value, (str,), (get_args(bare),), self.fix)
            return value
        kinds = _alternatives(bare)
        if NoneType in kinds and value is None:
            return None
        kinds = tuple(kind for kind in kinds if kind is not NoneType)
        if len(kinds) == 1:
            return super().value(hint if kinds == (bare,) else kinds[0], value, key)
        refusals = []
        for kind in kinds:
            try:
                return self.value(kind, value, key)
            except InputError as refused:
                refusals.append(refused)
        raise refusals[0]


def _is_required(field: _Field) -> bool:
    return field.left_out is None and field.earlier is None and field.inlined is None


def _only_nulls(value: Any) -> bool:
    return isinstance(value, dict) and all(item is None for item in value.values())
