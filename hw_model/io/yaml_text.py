"""Untrusted YAML: values that would be deep, endless or exponentially large are refused before they are built.

The safe loader runs nothing. But a few lines can stand for billions of values (aliases of aliases) or for a list that
contains itself, deep nesting crashes the interpreter, and a loader in Python takes seconds for a large file. If a
mapping has a key twice, every loader silently keeps the second value.
"""

import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml

from hw_model.errors import InputError, check_most
from hw_model.io.files import read_bytes

MAX_DEPTH = 50
MAX_NODES = 100_000
"""Largest number of values, keys and containers in a file that people write; reading it takes about two seconds."""
MAX_BYTES = 1_000_000
"""Size of the largest such file."""

#: The loader in C, if available: with bounded depth it gives the same result, many times faster.
FAST_LOADER: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
SEAL = "# SHA-256 of all above: "
"""Begins the last line of a file that carries its own checksum; a file without that line is read as it is."""
WAY_ON = "Write one 'key: value' per line."


class _Loader(yaml.SafeLoader):
    """The safe loader, which reads ``1e-3`` as a number as well: YAML 1.1 wants ``1.0e-3``, and takes this for text."""


_Loader.add_implicit_resolver(
    "tag:yaml.org,2002:float",
    re.compile(r"[-+]?(\d+\.?\d*|\.\d+)[eE][-+]?\d+$"),
    list("-+.0123456789"),
)


def load_yaml(
    text: str | bytes,
    where: str,
    fault: str = "it is not a YAML file",
    fix: str = WAY_ON,
    *,
    loader: Any = _Loader,
    most_nodes: int = MAX_NODES,
) -> object:
    """Return what YAML text holds, plain values only.

    Raises ``InputError`` for keys given twice, aliases, deep nesting and too many values. For text that is not YAML,
    the error has the words ``fault``, in which ``{line}`` may stand for the place, and ``fix``.
    """
    try:
        _check_events(text, where, most_nodes)
        return yaml.load(text, Loader=loader)
    # The loader trusts explicit tags: `!!int ''` and `!!bool x` raise exceptions that it does not document.
    except (
        yaml.YAMLError,
        ValueError,
        LookupError,
        AttributeError,
        TypeError,
        ArithmeticError,
        RecursionError,
    ) as met:
        if "maximum nesting depth" in str(
            met
        ):  # libyaml 0.2.6 and later look ahead, and stop at 1,000 levels
            raise _too_deep(where) from met
        line = getattr(getattr(met, "problem_mark", None), "line", None)
        what = fault.format(line="" if line is None else f" at line {line + 1}")
        raise InputError(where, what, fix=fix) from met


def _check_events(text: str | bytes, where: str, most_nodes: int) -> None:
    """Refuse text whose value would be large or endless, before anything is built."""
    nodes = 0
    open_: list[_Container] = []
    for event in yaml.parse(text, Loader=FAST_LOADER):
        if isinstance(event, yaml.AliasEvent):
            raise InputError(
                where,
                "aliases are not read",
                measured=f"line {_line(event)}",
                fix="Write the value out.",
            )
        if isinstance(event, yaml.NodeEvent):
            nodes += 1
            if open_:
                _count_in(open_[-1], event, where)
        if isinstance(event, yaml.CollectionStartEvent):
            open_.append(_Container(isinstance(event, yaml.MappingStartEvent)))
        elif isinstance(event, yaml.CollectionEndEvent):
            open_.pop()
        if len(open_) > MAX_DEPTH:
            raise _too_deep(where)
        check_most(
            nodes, most_nodes, where, "it holds too much", unit="values", fix="Give a smaller file."
        )


def _too_deep(where: str) -> InputError:
    what = "it is nested too deeply"
    return InputError(
        where, what, measured=f"more than {MAX_DEPTH} levels", fix="Correct its brackets."
    )


def read_mapping(path: Path, where: str, fix: str) -> dict[Any, Any]:
    """Return the mapping in a YAML file; ``InputError`` for any other file, with ``fix`` if it is too large."""
    values = load_yaml(read_bytes(path, where, MAX_BYTES, fix), where)
    if not isinstance(values, dict):
        raise InputError(where, "it is not a mapping", measured=type(values).__name__, fix=WAY_ON)
    return values


@dataclass
class _Container:
    """A list or mapping that is being read; in a mapping, every second node is a key."""

    is_mapping: bool
    nodes: int = 0
    keys: set[str] = field(default_factory=set)


def _count_in(container: _Container, event: Any, where: str) -> None:
    """Count a node in its container; ``InputError`` for a key that the mapping already has."""
    container.nodes += 1
    if (
        not container.is_mapping
        or container.nodes % 2 == 0
        or not isinstance(event, yaml.ScalarEvent)
    ):
        return
    if event.value in container.keys:
        fix = "Keep one."
        raise InputError(
            where, f"the key {event.value!r} is given twice, again at line {_line(event)}", fix=fix
        )
    container.keys.add(event.value)


def _line(event: Any) -> int:
    return int(event.start_mark.line) + 1
