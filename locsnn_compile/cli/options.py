"""The options of all commands, which ``options.txt`` declares as their help shows them."""

import argparse
import math
import re
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any


def part(text: str) -> float:
    """Read a share of the weights: none, all, or a number."""
    named = {"none": 0.0, "all": 1.0}
    return named[text] if text in named else number(text)


def number(text: str) -> float:
    """Read a bound; a gate whose bound is not a number would never fail."""
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
"""What an option may be, as argparse is told; besides these ``default VALUE``, and ``dest NAME`` of its attribute."""


@cache
def _sections() -> dict[str, str]:
    _, *found = re.split(r"^\[(.+)\]\n", Path(__file__).with_name("options.txt").read_text("utf-8"), flags=re.MULTILINE)
    return {name: text.strip() for name, text in zip(found[::2], found[1::2], strict=True)}


def add_options(parser: argparse.ArgumentParser, command: str, words: Mapping[str, str]) -> None:
    """Add the options of a command; ``words`` fill places in its section that name no other one."""
    declared = _sections()[command].format_map({**_sections(), **words})
    for line, said in re.findall(r"^(\S.*)((?:\n    .*)+)", declared, re.MULTILINE):
        named, *kinds = line.split(", ")
        *names, last = named.split()
        asked: dict[str, Any] = {"metavar": last} if names else {}
        for kind in kinds:
            key, _, value = kind.partition(" ")
            asked |= KINDS.get(kind) or {key: value}
        parser.add_argument(*(names or [last]), help=" ".join(said.split()), **asked)
