"""Pages, texts and tables in files next to the code, with placeholders ``@@name@@`` or ``{name}``."""

import re
import string
from collections.abc import Callable, Mapping
from importlib import import_module
from pathlib import Path
from typing import Any


def filled(package: str, name: str, **given: str) -> str:
    """Return a text file of a package, each placeholder filled with the value given or with the file that it names."""
    folder = Path(import_module(package).__path__[0])

    def part(place: re.Match[str]) -> str:
        return (
            given[place[1]] if place[1] in given else folder.joinpath(place[1]).read_text("utf-8")
        )

    return re.sub("@@(.+?)@@", part, folder.joinpath(name).read_text("utf-8"))


def yaml_table(package: str, name: str, **given: str) -> Any:
    """Return what a YAML file of a package holds."""
    import yaml  # commands whose help has no table do not wait for it

    from hw_model.io.yaml_text import FAST_LOADER

    return yaml.load(filled(package, name, **given), FAST_LOADER)


class Filler(string.Formatter):
    """Fills placeholders ``{key:shown}`` of texts with a value as the function ``shown`` writes it.

    Further words are further arguments of the function: ``{cores:plural core}``. The words after ``or`` stand for None:
    ``{share:share or silent}``; without them None leaves nothing. Other formats are those of Python.
    """

    def __init__(self, shown: Mapping[str, Callable[..., str]]) -> None:
        self._shown = shown

    def format_field(self, value: Any, format_spec: str) -> str:
        """Return the text for a placeholder."""
        asked, _, otherwise = format_spec.partition(" or ")
        if value is None:
            return otherwise
        name, *more = asked.split(" ")
        return self._shown[name](value, *more) if name in self._shown else format(value, asked)

    def fill(self, text: str, given: Mapping[str, Any]) -> str:
        """Return a text with its placeholders filled."""
        return self.vformat(text, (), given)
