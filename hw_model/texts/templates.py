"""Pages, texts and tables in files next to the code, with placeholders ``@@name@@``."""

import re
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
