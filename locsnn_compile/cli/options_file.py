"""``--options FILE``: a YAML file with options of a command; options on the command line take precedence."""

import argparse
from pathlib import Path
from typing import Any

from locsnn_compile.errors import InputError, check_known

_OTHERS = ("help", "options", "version")


def read_options(parser: argparse.ArgumentParser, path: str) -> dict[str, Any]:
    """Return the values that a file gives to the options of a parser, by attribute; ``InputError`` for all else."""
    from hw_model.io.yaml_text import read_mapping

    where = f"options {path!r}"
    values = read_mapping(Path(path), where, "Give the YAML file of a command's options.")
    options = {
        name[2:]: action
        for name, action in parser._option_string_actions.items()
        if name.startswith("--")
    }
    known = {name: action for name, action in options.items() if name not in _OTHERS}
    for name in values:
        check_known(where, f"key {str(name)[:60]!r} is not known", str(name), known)
    return {
        known[name].dest: _value(known[name], value, f"{where}, {name}")
        for name, value in values.items()
    }


def _value(action: argparse.Action, value: Any, where: str) -> Any:
    """Return a value as the command line would give it: of the option's type, or a list of such values."""
    if action.nargs == 0:
        if isinstance(value, bool):
            return value
        raise InputError(
            where, "it must be true or false", measured=f"got {value!r}", fix="Correct the value."
        )
    several = isinstance(action, argparse._AppendAction)
    items = value if several and isinstance(value, list) else [value]
    kind: Any = action.type or str
    try:
        if not {type(one) for one in items} <= {str, int, float}:
            raise ValueError(value)
        found = [kind(str(one)) for one in items]
    except ValueError:
        got = f"got {value!r}"
        raise InputError(
            where, "it is not a value of this option", measured=got, fix="Correct the value."
        ) from None
    except InputError as error:
        raise InputError(where, error.what, measured=f"got {value!r}", fix=error.fix) from None
    return found if several else found[0]
