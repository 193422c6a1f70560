"""Read untrusted YAML: values that would be deep, endless or exponentially large are refused before they are built.

PyYAML's safe loader runs no code. But with aliases of aliases, a few lines can stand for billions of values, or for a
list that contains itself. Deep nesting crashes the interpreter, and the loader in Python takes seconds for a large
file. If a mapping has a key twice, every loader silently keeps the second value. So the text is first parsed into
events, which are counted and checked; only then are values built.

People write chip files, configurations and files of options; programs are written by this project, and are larger.
"""

import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml

from hw_model.errors import InputError, check_most
from hw_model.io.files import read_bytes

MAX_DEPTH = 50
"""The deepest nesting. Chosen by hand: files that we read have a handful of levels."""
MAX_NODES = 100_000
"""The most values, keys and containers in a file that people write. To read so many takes about two seconds."""
MAX_BYTES = 1_000_000
"""The size of the largest file that people write. Chosen by hand: our longest chip file has 11,000 bytes."""

#: PyYAML's safe loader in C (libyaml) if it is installed, or else the one in Python. For texts of bounded depth both
#: build the same values, the one in C many times faster. Neither reads ``1e-3`` as a number, as :class:`_Loader` does.
FAST_LOADER: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
WRITE_A_MAPPING = "Write one 'key: value' per line."
"""The way out for a file that is not YAML, or not a mapping."""


class _Loader(yaml.SafeLoader):
    """The safe loader, which in addition reads ``1e-3`` as a number.

    YAML 1.1 requires ``1.0e-3`` and takes ``1e-3`` for a text, which surprises people.
    """


_Loader.add_implicit_resolver(
    "tag:yaml.org,2002:float",
    re.compile(r"[-+]?(\d+\.?\d*|\.\d+)[eE][-+]?\d+$"),
    list("-+.0123456789"),
)


def load_yaml(
    text: str | bytes,
    where: str,
    fault: str = "it is not a YAML file",
    fix: str = WRITE_A_MAPPING,
    *,
    loader: Any = _Loader,
    most_nodes: int = MAX_NODES,
) -> object:
    """Return the values of a YAML text as plain Python objects, mappings as dicts.

    Raises ``InputError`` for keys given twice, aliases, deep nesting and too many values. For a text that is not YAML,
    the error says ``fault``, in which ``{line}`` is replaced by the place, and ``fix``. ``where`` names the text in
    errors.
    """
    try:
        _check_events(text, where, most_nodes)
        return yaml.load(text, Loader=loader)
    # The loader does not check explicit tags: `!!int ''` and `!!bool x` raise exceptions that it does not document.
    except (
        yaml.YAMLError,
        ValueError,
        LookupError,
        AttributeError,
        TypeError,
        ArithmeticError,
        RecursionError,
    ) as error:
        # libyaml 0.2.6 and later read ahead of the events that they deliver, and stop by themselves at 1,000 levels.
        if "maximum nesting depth" in str(error):
            raise _too_deep(where) from error
        line = getattr(getattr(error, "problem_mark", None), "line", None)
        # Lines are counted from 0 in marks.
        place = "" if line is None else f" at line {line + 1}"
        raise InputError(where, fault.format(line=place), fix=fix) from error


def _check_events(text: str | bytes, where: str, most_nodes: int) -> None:
    """Raise InputError for a text whose values would be deep, endless or too many, before any value is built."""
    nodes = 0
    # The lists and mappings that have begun and not ended, the innermost last.
    containers: list[_Container] = []
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
            if containers:
                _count_in(containers[-1], event, where)
        if isinstance(event, yaml.CollectionStartEvent):
            containers.append(_Container(isinstance(event, yaml.MappingStartEvent)))
        elif isinstance(event, yaml.CollectionEndEvent):
            containers.pop()
        if len(containers) > MAX_DEPTH:
            raise _too_deep(where)
        check_most(
            nodes, most_nodes, where, "it holds too much", unit="values", fix="Give a smaller file."
        )


def _too_deep(where: str) -> InputError:
    """Return the error for a text that is nested more deeply than :data:`MAX_DEPTH`."""
    what = "it is nested too deeply"
    return InputError(
        where, what, measured=f"more than {MAX_DEPTH} levels", fix="Correct its brackets."
    )


def read_mapping(path: Path, where: str, fix: str) -> dict[Any, Any]:
    """Return the mapping in a YAML file that a person wrote.

    Raises ``InputError`` for any other file; ``fix`` is the way out if it is too large or cannot be read.
    """
    values = load_yaml(read_bytes(path, where, MAX_BYTES, fix), where)
    if not isinstance(values, dict):
        what = "it is not a mapping"
        raise InputError(where, what, measured=type(values).__name__, fix=WRITE_A_MAPPING)
    return values


@dataclass
class _Container:
    """A list or mapping that has begun: the number of its own ``nodes`` so far, and the texts of its keys."""

    is_mapping: bool
    nodes: int = 0
    keys: set[str] = field(default_factory=set)


def _count_in(container: _Container, event: Any, where: str) -> None:
    """Count a node in its container; raise ``InputError`` for a key that the mapping already has."""
    container.nodes += 1
    # Keys and values alternate, beginning with a key. Keys that are lists or mappings are left to the loader, which
    # refuses them.
    is_key = container.is_mapping and container.nodes % 2 == 1
    if not is_key or not isinstance(event, yaml.ScalarEvent):
        return
    # Keys are compared as they are written, so `1` and `'1'` count as the same key, though YAML reads a number and a
    # text: who writes both has made a mistake. `1` and `0x1` count as two.
    if event.value in container.keys:
        fix = "Keep one."
        raise InputError(
            where, f"the key {event.value!r} is given twice, again at line {_line(event)}", fix=fix
        )
    container.keys.add(event.value)


def _line(event: Any) -> int:
    """Return the line at which an event begins, counted from 1."""
    return int(event.start_mark.line) + 1
