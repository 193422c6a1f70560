"""What a value is, in one line: arrays by their shape, long sequences by their number, texts cut."""

from collections.abc import Collection, Mapping
from dataclasses import fields, is_dataclass
from typing import Any

_PLAIN = (str, int, float, type(None))
_LONGEST, _LONGEST_TEXT, _MOST_ITEMS = 400, 40, 4


class Shown:
    """A dataclass, made without ``repr``, that says what it holds, except usual values, in at most 400 characters."""

    def __repr__(self) -> str:
        parts = ((field, getattr(self, field.name)) for field in fields(self) if field.repr)  # type: ignore[arg-type]
        said = (f"{f.name}={_part(part)}" for f, part in parts if not (isinstance(part, _PLAIN) and part == f.default))
        text = f"{type(self).__name__}({', '.join(said)}"
        return f"{_cut(text, _LONGEST)})"


def _part(value: Any) -> str:
    """Return a field's value: itself where that is short, else what it is."""
    if hasattr(value, "shape") and hasattr(value, "dtype"):
        return str(value) if value.shape == () else f"<{value.dtype} {value.shape}>"
    if is_dataclass(value):
        name = getattr(value, "name", None)
        return f"<{type(value).__name__}{f' {_part(name)}' if isinstance(name, str) else ''}>"
    if isinstance(value, str | bytes):
        return repr(value) if len(value) <= _LONGEST_TEXT else f"{value[:_LONGEST_TEXT]!r}..."
    if isinstance(value, Mapping):
        return f"<{len(value)} entries>"
    if isinstance(value, Collection) and not isinstance(value, range):
        few = len(value) <= _MOST_ITEMS
        return f"({', '.join(map(_part, value))})" if few else f"<{len(value)} items>"
    return _cut(repr(value), _LONGEST_TEXT)


def _cut(text: str, most: int) -> str:
    return text if len(text) <= most else f"{text[:most]}..."
