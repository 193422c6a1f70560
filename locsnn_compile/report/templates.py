"""Pages and texts that lie next to the code as files, with places ``@@name@@`` to fill."""

import re
from importlib.resources import files


def filled(package: str, name: str, **given: str) -> str:
    """Return a text file of a package, its places filled with what is given, or with the file that a place names."""
    folder = files(package)

    def part(place: re.Match[str]) -> str:
        return given[place[1]] if place[1] in given else folder.joinpath(place[1]).read_text("utf-8")

    return re.sub("@@(.+?)@@", part, folder.joinpath(name).read_text("utf-8"))
