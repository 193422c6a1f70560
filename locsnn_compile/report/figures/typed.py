"""Read plain JSON values as entries, the types of ``figures/entries.py``: the inverse of ``entries.plain``.

So a command can read report.json of an earlier build, and gets the same figures as the command that
wrote it.
"""

from collections.abc import Mapping
from types import NoneType
from typing import Any, Literal, TypeVar, get_args, get_origin

from hw_model.errors import InputError
from hw_model.io.records import RecordReader, check_value
from locsnn_compile.report.figures.entries import NULLS, Field, alternatives, fields_of, keys_of

T = TypeVar("T")


def typed(kind: type[T], document: Any) -> T:
    """Return the entry of type ``kind`` that the content of a report.json describes.

    Raise InputError, with the path of the value in the file, if the document does not have this type.
    """
    return _EntryReader("report.json", "Compile it again with this version.").record(kind, document)


class _EntryReader(RecordReader):
    """Reads entries from plain values.

    A :class:`RecordReader` takes one key per field. An entry may lack keys or have them inlined, as the
    marks of its fields say, and a value may be of one of several types. ``key`` is the path of a value
    in the file, such as ``match.first_divergence``, for messages.
    """

    def record(self, kind: type[T], value: Any, key: str = "", **given: object) -> T:
        """Return the entry of type ``kind`` that the mapping ``value`` describes."""
        fields = fields_of(kind)
        # ``entries`` refuses a key that is not in ``required``, and the lack of one that is true there.
        required = {name: _is_required(field) for field in fields for name in field.keys}
        items = self.entries(value, key, required)
        values = {field.name: self._field_value(field, items, key) for field in fields}
        return kind(**given, **values)

    def _field_value(self, field: Field, items: Mapping[str, Any], key: str) -> Any:
        """Return the value of a field of an entry, of which ``items`` are the keys in the file."""
        if field.inlined is not None:
            return self._inlined_entry(field, items, key)
        if field.key not in items:
            return None
        value = items[field.key]
        if NULLS in field.marks and _has_only_nulls(value):
            return None
        path = f"{key}.{field.key}" if key else field.key
        return self.value(field.hint, value, path)

    def _inlined_entry(self, field: Field, items: Mapping[str, Any], key: str) -> Any:
        """Return the entry of an inlined field, whose keys stand among those of the outer entry."""
        assert field.inlined is not None
        inner = {}
        for inner_key in keys_of(field.kinds[0]):
            name = field.inlined.name(inner_key)
            if name in items:
                inner[inner_key] = items[name]
        if NULLS in field.marks and _has_only_nulls(inner):
            return None
        return self.record(field.kinds[0], inner, key)

    def value(self, hint: Any, value: Any, key: str) -> Any:
        """Return ``value`` as the type that the annotation ``hint`` asks for; of several, the first that fits."""
        bare_type = get_args(hint)[0] if getattr(hint, "__metadata__", ()) else hint
        if get_origin(bare_type) is Literal:
            choices = get_args(bare_type)
            check_value(self.place(key), value, (str,), (choices,), self.fix)
            return value
        kinds = alternatives(bare_type)
        if NoneType in kinds and value is None:
            return None
        kinds = tuple(kind for kind in kinds if kind is not NoneType)
        if len(kinds) == 1:
            # The annotation itself where it allows no None, because it may hold rules for the value.
            is_whole_hint = kinds == (bare_type,)
            return super().value(hint if is_whole_hint else kinds[0], value, key)
        refusals = []
        for kind in kinds:
            try:
                return self.value(kind, value, key)
            except InputError as refusal:
                refusals.append(refusal)
        # The first type is the usual one, so its message says best what is wrong.
        raise refusals[0]


def _is_required(field: Field) -> bool:
    """Whether the keys of a field must be in the file; those of an inlined entry are checked with that entry."""
    return field.left_out is None and field.inlined is None


def _has_only_nulls(value: Any) -> bool:
    return isinstance(value, dict) and all(item is None for item in value.values())
