"""Names for formats that allow few characters, and names of the user's in Markdown."""

import re
from collections.abc import Iterable


def unique_names(texts: Iterable[str]) -> dict[str, str]:
    """Return a name of letters, digits and underscores for every text, no two alike."""
    names: dict[str, str] = {}
    for text in texts:
        base = "_" * text[:1].isdigit() + re.sub(r"[^A-Za-z0-9_]", "_", text) or "_"
        name, number = base, 2
        while name in names.values():
            name, number = f"{base}_{number}", number + 1
        names[text] = name
    return names


def code_span(text: str) -> str:
    """Return a text as a code span of Markdown, on one line and with nothing in it that means anything."""
    return f"`{' '.join(text.replace('`', chr(39)).split())}`"
