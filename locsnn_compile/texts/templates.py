"""Pages and texts that lie next to the code as files, with places ``@@name@@`` or ``{name}`` to fill."""

import re
import string
from collections.abc import Callable, Mapping
from importlib import import_module
from pathlib import Path
from typing import Any


def filled(package: str, name: str, **given: str) -> str:
    """Return a text file of a package, its places filled with what is given, or with the file that a place names."""
    folder = Path(import_module(package).__path__[0])

    def part(place: re.Match[str]) -> str:
        return given[place[1]] if place[1] in given else folder.joinpath(place[1]).read_text("utf-8")

    return re.sub("@@(.+?)@@", part, folder.joinpath(name).read_text("utf-8"))


def sections(package: str, name: str, **given: str) -> dict[str, str]:
    """Return the parts of a text file of a package by the ``[names]`` that stand on lines of their own above them."""
    _, *found = re.split(r"\n?^\[(.+)\]\n", filled(package, name, **given), flags=re.MULTILINE)
    return dict(zip(found[::2], found[1::2], strict=True))


class Filler(string.Formatter):
    """Fills places ``{key:shown}`` of texts with what the function of that name makes of a value.

    Further words are its further arguments: ``{cores:plural core}``. What follows an ``or`` stands for None, nothing
    where there is no such word: ``{share:share or silent}``. Other formats are the usual ones.
    """

    def __init__(self, shown: Mapping[str, Callable[..., str]]) -> None:
        self._shown = shown

    def format_field(self, value: Any, format_spec: str) -> str:
        """Return what stands in a place."""
        asked, _, otherwise = format_spec.partition(" or ")
        if value is None:
            return otherwise
        name, *more = asked.split(" ")
        return self._shown[name](value, *more) if name in self._shown else format(value, asked)

    def fill(self, text: str, given: Mapping[str, Any]) -> str:
        """Return a text, its places filled."""
        return self.vformat(text, (), given)
