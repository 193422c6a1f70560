"""The options of all commands, declared in ``options.txt`` as their help shows them, and checks that several share."""

import argparse
import math
import re
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from locsnn_compile.errors import InputError
from locsnn_compile.texts.templates import sections

if TYPE_CHECKING:
    from locsnn_compile.data.recordings import Recordings


def part(text: str) -> float:
    """Read a share of the weights: ``none``, ``all`` or a number."""
    named = {"none": 0.0, "all": 1.0}
    return named[text] if text in named else number(text)


def number(text: str) -> float:
    """Read a number other than nan: a gate with that bound would never fail."""
    value = float(text)
    if math.isnan(value):
        raise ValueError(text)
    return value


def numbers(text: str) -> tuple[float, ...]:
    """Read numbers separated by commas."""
    return tuple(map(float, text.split(",")))


KINDS: Mapping[str, Mapping[str, Any]] = {
    **{kind.__name__.lower(): {"type": kind} for kind in (int, float, str, number, numbers, part, Path)},
    "flag": {"action": "store_true"},
    "yes or no": {"action": argparse.BooleanOptionalAction},
    "required": {"required": True},
    "any": {"nargs": "*"},
    "several": {"nargs": "+"},
    "repeated": {"action": "append", "default": []},
    "extended": {"action": "extend", "nargs": "+", "default": []},
}
"""Kinds of options, as arguments of argparse; there are also ``default VALUE``, and ``dest NAME`` for the attribute."""


def add_options(parser: argparse.ArgumentParser, command: str, words: Mapping[str, str]) -> None:
    """Add the options of a command; ``words`` fill the placeholders in its section that do not name another section."""
    found = sections(__package__, "options.txt")
    declared = found[command].format_map({**found, **words})
    for line, said in re.findall(r"^(\S.*)((?:\n    .*)+)", declared, re.MULTILINE):
        named, *kinds = line.split(", ")
        *names, last = named.split()
        asked: dict[str, Any] = {"metavar": last} if names else {}
        for kind in kinds:
            key, _, value = kind.partition(" ")
            asked |= KINDS.get(kind) or {key: value}
        parser.add_argument(*(names or [last]), help=" ".join(said.split()), **asked)


def given(args: argparse.Namespace, options: Iterable[str]) -> dict[str, Any]:
    """Return the values of the options that were given, by the option as it is typed."""
    values = {option: getattr(args, option.strip("-").replace("-", "_")) for option in options}
    return {option: value for option, value in values.items() if value is not None}


def check_number(option: str, value: float | None, what: str, holds: Callable[[float], bool], fix: str) -> None:
    """Refuse a number that is not finite, or for which ``holds`` is false."""
    if value is not None and not (math.isfinite(value) and holds(value)):
        raise InputError(option, what, measured=f"got {value:g}", fix=fix)


def check_psi(psi: float | None) -> None:
    """Refuse a rate below 0."""
    check_number("--psi", psi, "it is not a valid rate", lambda x: x >= 0, "Give 0 or more, such as 10.")


def recording_of(asked: int | None, recordings: "Recordings") -> int:
    """Return the number of the recording asked for, by default the first; refuse one that does not exist."""
    number = asked or 0
    if not 0 <= number < len(recordings):
        measured = f"{len(recordings)} in {recordings.source}"
        fix = f"Count from 0 to {len(recordings) - 1}."
        raise InputError(f"--recording {number}", "there is no such recording", measured=measured, fix=fix)
    return number
