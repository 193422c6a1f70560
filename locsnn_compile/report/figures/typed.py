"""Plain documents as entries: the inverse of the writer of report.json."""

from collections.abc import Mapping
from types import NoneType
from typing import Any, Literal, TypeVar, get_args, get_origin

from hw_model.errors import InputError
from hw_model.io.records import RecordReader, check_value
from locsnn_compile.report.figures.entries import NULLS, Field, alternatives, fields_of, keys_of

T = TypeVar("T")


def typed(kind: type[T], document: Any) -> T:
    """Return the entry that a plain document describes; ``InputError`` names what it cannot be."""
    return _EntryReader("report.json", "Compile it again with this version.").record(kind, document)


class _EntryReader(RecordReader):
    """Reads entries: of several types that a value may have, the first one that fits."""

    def record(self, kind: type[T], value: Any, key: str = "", **given: object) -> T:
        """Return the entry that a mapping describes."""
        own = fields_of(kind)
        required = {name: _is_required(field) for field in own for name in field.keys}
        items = self.entries(value, key, required)
        return kind(**given, **{field.name: self._value_of(field, items, key) for field in own})

    def _value_of(self, field: Field, items: Mapping[str, Any], key: str) -> Any:
        if field.inlined is not None:
            names = {key: field.inlined.name(key) for key in keys_of(field.kinds[0])}
            own = {key: items[name] for key, name in names.items() if name in items}
            if NULLS in field.said and _only_nulls(own):
                return None
            return self.record(field.kinds[0], own, key)
        place = f"{key}.{field.key}" if key else field.key
        if field.key in items:
            value = items[field.key]
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
        kinds = alternatives(bare)
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


def _is_required(field: Field) -> bool:
    return field.left_out is None and field.inlined is None


def _only_nulls(value: Any) -> bool:
    return isinstance(value, dict) and all(item is None for item in value.values())
