"""``--options FILE``: a YAML file with options of a command; options on the command line take precedence."""

import argparse
from pathlib import Path
from typing import Any

from locsnn_compile.errors import InputError, check_known

_NOT_IN_A_FILE = ("help", "options", "version")
"""Options that a file cannot set: they say what to do instead of the command, or which file to read."""


def read_options(parser: argparse.ArgumentParser, path: str) -> dict[str, Any]:
    """Return the values that a file gives to the options of a parser, by attribute; ``InputError`` for all else."""
    from hw_model.io.yaml_text import read_mapping

    where = f"options {path!r}"
    values = read_mapping(Path(path), where, "Give the YAML file of a command's options.")
    actions = _actions_by_name(parser)
    options: dict[str, Any] = {}
    for name in values:
        check_known(where, f"key {str(name)[:60]!r} is not known", str(name), actions)
    for name, value in values.items():
        action = actions[name]
        options[action.dest] = _value(action, value, f"{where}, {name}")
    return options


def _actions_by_name(parser: argparse.ArgumentParser) -> dict[str, argparse.Action]:
    """Return the options of a parser that a file may set, by their names without dashes."""
    actions: dict[str, argparse.Action] = {}
    for option, action in parser._option_string_actions.items():
        name = option.removeprefix("--")
        if option.startswith("--") and name not in _NOT_IN_A_FILE:
            actions[name] = action
    return actions


def _value(action: argparse.Action, value: Any, where: str) -> Any:
    """Return a value as the command line would give it: of the option's type, or a list of such values.

    An option that may be given again and again takes a list, or a single value.
    """
    if action.nargs == 0:
        if isinstance(value, bool):
            return value
        raise InputError(
            where, "it must be true or false", measured=f"got {value!r}", fix="Correct the value."
        )
    is_repeatable = isinstance(action, argparse._AppendAction)
    items = [value]
    if is_repeatable and isinstance(value, list):
        items = value
    read: Any = action.type or str
    try:
        types = {type(item) for item in items}
        # True, a date or a list would have a text as well, but the command line has none of them.
        if not types <= {str, int, float}:
            raise ValueError(value)
        read_values = [read(str(item)) for item in items]
    except ValueError:
        got = f"got {value!r}"
        raise InputError(
            where, "it is not a value of this option", measured=got, fix="Correct the value."
        ) from None
    except InputError as error:
        raise InputError(where, error.what, measured=f"got {value!r}", fix=error.fix) from None
    return read_values if is_repeatable else read_values[0]
