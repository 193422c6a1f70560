"""``--options FILE``: a YAML file with options of a command.

A line ``weight-bits: 4`` of the file stands for ``--weight-bits 4``. The parser of the command
(``shell.py``) reads the file and lets options on the command line take precedence.
"""

import argparse
from pathlib import Path
from typing import Any

from locsnn_compile.errors import InputError, check_known

_NOT_IN_A_FILE = ("help", "options", "version")
"""Options that a file cannot set: they say what to do instead of the command, or which file to read."""


def read_options(parser: argparse.ArgumentParser, path: str) -> dict[str, Any]:
    """Return the values of a file's options, by the attribute in which argparse stores each option.

    Raises ``InputError`` for a key that is not an option, and for a value that the option refuses.
    """
    # Only here, because few command lines have this option and YAML takes time to import.
    from hw_model.io.yaml_text import read_mapping

    where = f"options {path!r}"
    values = read_mapping(Path(path), where, "Give the YAML file of a command's options.")
    actions = _actions_by_name(parser)
    # All names before any value: a misspelled name is the more likely mistake.
    for name in values:
        check_known(where, f"key {str(name)[:60]!r} is not known", str(name), actions)
    options: dict[str, Any] = {}
    for name, value in values.items():
        action = actions[name]
        options[action.dest] = _parsed_value(action, value, f"{where}, {name}")
    return options


def _actions_by_name(parser: argparse.ArgumentParser) -> dict[str, argparse.Action]:
    """Return the options of a parser that a file may set, by their names without the two dashes."""
    actions: dict[str, argparse.Action] = {}
    # argparse offers no public list of its options.
    for option, action in parser._option_string_actions.items():
        name = option.removeprefix("--")
        if option.startswith("--") and name not in _NOT_IN_A_FILE:
            actions[name] = action
    return actions


def _parsed_value(action: argparse.Action, value: Any, where: str) -> Any:
    """Return a value as the command line would give it: of the option's type, or a list of such values.

    An option that can be given several times takes a list or a single value.
    """
    if action.nargs == 0:  # a flag, such as --json
        if isinstance(value, bool):
            return value
        raise InputError(
            where, "it must be true or false", measured=f"got {value!r}", fix="Correct the value."
        )
    is_repeatable = isinstance(action, argparse._AppendAction)
    items = [value]
    if is_repeatable and isinstance(value, list):
        items = value
    parse: Any = action.type or str
    measured = f"got {value!r}"
    try:
        # YAML also knows booleans, dates and nested lists. str() would turn them into texts that
        # nobody typed, such as "True", so they are refused.
        if any(type(item) not in (str, int, float) for item in items):
            raise ValueError(value)
        parsed_values = [parse(str(item)) for item in items]
    except ValueError:
        raise InputError(
            where, "it is not a value of this option", measured=measured, fix="Correct the value."
        ) from None
    except InputError as error:
        # The option's own error, but at the place of the value in the file.
        raise InputError(where, error.what, measured=measured, fix=error.fix) from None
    return parsed_values if is_repeatable else parsed_values[0]
