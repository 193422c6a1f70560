"""YAML of strangers: what would be deep, endless or exponential is refused before it is built.

The safe loader runs nothing. But a file of a few lines may stand for billions of values (aliases of aliases) or for a
list that holds itself, deep nesting ends the interpreter, and a loader in Python takes seconds for a large file.
"""

from __future__ import annotations

from typing import Any

import yaml

from hw_model.errors import InputError

MAX_DEPTH = 50
MAX_NODES = 100_000
"""Values, keys and containers of a file that people write; about two seconds."""

#: The loader in C where there is one: with bounded depth it is the same, and many times faster.
FAST_LOADER: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)


def load_yaml(text: str | bytes, where: str, *, loader: Any = yaml.SafeLoader, most_nodes: int = MAX_NODES) -> object:
    """Return what YAML text holds, plain values only.

    Raises ``InputError`` for aliases, deep nesting and too many values, and what the loader raises for text that is not
    YAML: ``yaml.YAMLError`` or ``ValueError``.
    """
    depth = nodes = 0
    for event in yaml.parse(text, Loader=FAST_LOADER):
        if isinstance(event, yaml.AliasEvent):
            line = "" if event.start_mark is None else f"line {event.start_mark.line + 1}"
            raise InputError(where, "aliases are not read", measured=line, fix="Write the value out.")
        nodes += isinstance(event, yaml.NodeEvent)
        depth += isinstance(event, yaml.CollectionStartEvent) - isinstance(event, yaml.CollectionEndEvent)
        if depth > MAX_DEPTH:
            raise InputError(
                where, "it is nested too deeply", measured=f"more than {MAX_DEPTH} levels", fix="Correct its brackets."
            )
        if nodes > most_nodes:
            raise InputError(
                where, "it holds too much", measured=f"more than {most_nodes} values", fix="Give a smaller file."
            )
    try:
        return yaml.load(text, Loader=loader)
    # The loader trusts explicit tags: `!!int ''` and `!!bool x` meet it unprepared.
    except (LookupError, AttributeError, TypeError, ArithmeticError, RecursionError) as error:
        raise yaml.YAMLError("a value is not what its tag says") from error
