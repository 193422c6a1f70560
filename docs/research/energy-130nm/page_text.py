"""Markdown of the page on energy: tables, and paragraphs wrapped to the width of a line."""

import re
import textwrap

WIDTH = 128
"""Characters of a line of text."""


def table(head: tuple[str, ...], rows: list[tuple[str, ...]]) -> str:
    """Return a table; all columns but the first are numbers and aligned to the right."""
    line = "| --- |" + " ---: |" * (len(head) - 1)
    return (
        "\n".join(
            ("| " + " | ".join(head) + " |", line, *("| " + " | ".join(row) + " |" for row in rows))
        )
        + "\n"
    )


def wrapped(page: str) -> str:
    """Return a page with its paragraphs wrapped; tables, lists, headings, pictures and code stay as they are."""
    paragraphs = page.split("\n\n")
    return "\n\n".join(
        text if re.match(r"[|#!]|- |    ", text) or "\n|" in text else _filled(text)
        for text in paragraphs
    )


def _filled(text: str) -> str:
    end = "\n" * text.endswith("\n")
    return textwrap.fill(text, WIDTH, break_long_words=False, break_on_hyphens=False) + end
