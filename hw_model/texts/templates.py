"""Read text files that lie in a package next to its code, and fill their placeholders ``@@name@@``.

Braces, as in f-strings, would have to be doubled in every line of CSS or SystemVerilog; ``@@`` is rare in these.
"""

import re
from importlib import import_module
from pathlib import Path
from typing import Any


def filled(package: str, name: str, **values: str) -> str:
    """Return the text file ``name`` of a package with its placeholders filled.

    ``@@title@@`` becomes ``values["title"]`` or, without such a value, the text of the file ``title`` of the package.
    """
    folder = Path(import_module(package).__path__[0])

    def text_of(placeholder: re.Match[str]) -> str:
        key = placeholder[1]
        if key in values:
            return values[key]
        return folder.joinpath(key).read_text("utf-8")

    return re.sub("@@(.+?)@@", text_of, folder.joinpath(name).read_text("utf-8"))


def yaml_table(package: str, name: str, **values: str) -> Any:
    """Return the values in a YAML file of a package, after its placeholders are filled as :func:`filled` does."""
    # Imported here, so that commands which need no table start faster.
    import yaml

    from hw_model.io.yaml_text import FAST_LOADER

    return yaml.load(filled(package, name, **values), FAST_LOADER)
