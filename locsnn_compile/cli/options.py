"""The options of all commands, declared in ``options.txt`` as their help shows them, and checks that several share."""

import argparse
import math
import re
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hw_model.description.boards import BOARDS
from hw_model.texts.templates import sections
from locsnn_compile.cli.completion import chips
from locsnn_compile.data.formats import EVENT_FORMATS
from locsnn_compile.emitters import EMIT_KINDS
from locsnn_compile.errors import InputError, did_you_mean, listed
from locsnn_compile.frontends.formats import FORMAT_OPTIONS, models_in_words
from locsnn_compile.models.architectures import ARCHITECTURES
from locsnn_compile.settings import DIALS, TRAINABLE

if TYPE_CHECKING:
    from locsnn_compile.data.recordings import Recordings


def part(text: str) -> float:
    """Read a share of the weights: ``none``, ``all`` or a number."""
    named = {"none": 0.0, "all": 1.0}
    return named[text] if text in named else float(text)


def start(text: str) -> float | str:
    """Read the start of recordings: ``first``, or seconds."""
    return text if text == "first" else float(text)


def numbers(text: str) -> tuple[float, ...]:
    """Read numbers separated by commas."""
    return tuple(map(float, text.split(",")))


KINDS: Mapping[str, Mapping[str, Any]] = {
    **{
        kind.__name__.lower(): {"type": kind}
        for kind in (int, float, str, numbers, part, start, Path)
    },
    "flag": {"action": "store_true"},
    "switch": {"action": "store_true", "default": None},
    "yes or no": {"action": argparse.BooleanOptionalAction},
    "required": {"required": True},
    "any": {"nargs": "*"},
    "several": {"nargs": "+"},
    "repeated": {"action": "append", "default": []},
    "extended": {"action": "extend", "nargs": "+", "default": []},
}
"""Kinds of options, as arguments of argparse. There are also ``default VALUE``, ``dest NAME`` for the attribute,
``one of A|B|C`` for names, and after the type of a number its range, in the words of :data:`RANGE`.
A value called ``CHIP`` is completed by the chips that ship.
"""
RANGE = re.compile(r"a finite number|a number (from|above) (\S+)(?: up| to (\S+))?")
"""``a number from 0 to 1``, ``from 0 up`` or ``above 0``; it is always finite."""


_FIRST_DIAL, *_OTHER_DIALS = DIALS
OF_MODELS = {
    "models": models_in_words(),
    "reading": "\n".join(option.declaration for option in FORMAT_OPTIONS),
}
"""What fills the placeholders of commands that read models."""
WORDS: dict[str, Mapping[str, str]] = {
    "compile": {
        "first_dial": _FIRST_DIAL.declaration,
        "other_dials": "\n".join(
            dial.declaration for dial in sorted(_OTHER_DIALS, key=lambda dial: dial.name)
        ),
        "kinds": ", ".join(EMIT_KINDS),
        "emitted": "|".join(EMIT_KINDS),
    },
    "train": {
        "architectures": ", ".join(ARCHITECTURES),
        "strategies": listed([f"{TRAINABLE[0]} (default)", *TRAINABLE[1:]], "or"),
        "trainable": "|".join(TRAINABLE),
    },
    "events": {
        "event_files": ", ".join(row.suffix for row in EVENT_FORMATS if row.write),
    },
    "explore": {"dials": "\n".join(dial.explored for dial in DIALS)},
    "fit": {"boards": ", ".join(BOARDS), "names": "|".join(BOARDS)},
}
"""By command, what fills the placeholders in its section that do not name another section."""


def add_options(parser: argparse.ArgumentParser, command: str) -> None:
    """Add the options of a command."""
    found = sections(__package__, "options.txt") | OF_MODELS
    lines = found[command].format_map({**found, **WORDS.get(command, {})})
    for line, said in re.findall(r"^(\S.*)((?:\n    .*)+)", lines, re.MULTILINE):
        named, *kinds = line.split(", ")
        *names, last = named.split()
        asked: dict[str, Any] = {"metavar": last} if names else {}
        for kind in kinds:
            key, _, value = kind.partition(" ")
            if key == "a":
                asked["type"] = _in_range(names[0], asked["type"], kind)
            elif key == "one":
                asked |= _one_of(
                    names[0], asked.get("type", str), kind.removeprefix("one of ").split("|")
                )
            else:
                asked |= KINDS.get(kind) or {key: value}
        action = parser.add_argument(*(names or [last]), help=" ".join(said.split()), **asked)
        if last == "CHIP":
            action.completer = chips  # type: ignore[attr-defined]


def _in_range(option: str, read: Callable[[str], float], asked: str) -> Callable[[str], float]:
    """Return what reads the number of an option, and raises ``InputError`` if it is not what is ``asked`` for."""
    kind, least, most = RANGE.fullmatch(asked).groups()  # type: ignore[union-attr]
    low, high = float(least or "-inf"), float(most or "inf")

    def checked(text: str) -> float:
        value = read(text)
        if not (math.isfinite(value) and low <= value <= high) or (
            kind == "above" and value == low
        ):
            raise InputError(f"{option} {text}", "it is out of range", fix=f"Give {asked}.")
        return value

    # argparse shows this name if the text is not a number.
    checked.__name__ = read.__name__
    return checked


def _one_of(option: str, read: Callable[[str], Any], known: list[str]) -> dict[str, Any]:
    """Return what reads names, or numbers of some kind, and refuses unknown ones; argcomplete completes ``choices``."""

    def checked(text: str) -> Any:
        value = read(text)
        if str(value) not in known:
            fix = did_you_mean(text, known) if read is str else f"Choose from {', '.join(known)}."
            raise InputError(f"{option} {text}", "it is not known", fix=fix)
        return value

    checked.__name__ = read.__name__
    return {"type": checked, "choices": [*map(read, known)]}


def given(args: argparse.Namespace, options: Iterable[str]) -> dict[str, Any]:
    """Return the values of the options that were given, by the option as it is typed."""
    values = {option: getattr(args, option.strip("-").replace("-", "_")) for option in options}
    return {option: value for option, value in values.items() if value is not None}


def recording_of(asked: int | None, recordings: "Recordings") -> int:
    """Return the number of the recording asked for, by default the first; refuse one that does not exist."""
    number = asked or 0
    if not 0 <= number < len(recordings):
        measured = f"{len(recordings)} in {recordings.source}"
        fix = f"Count from 0 to {len(recordings) - 1}."
        raise InputError(
            f"--recording {number}", "there is no such recording", measured=measured, fix=fix
        )
    return number
