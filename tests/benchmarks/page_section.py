"""Sections of a page that a script writes, between two HTML comments; the rest of the page is written by hand or another script."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path

NETWORKS = ("objects", "containers")
"""Data sets of the example networks."""


def markers(name: str) -> tuple[str, str]:
    """Return the lines that a section lies between."""
    return f"<!-- {name}: begin -->", f"<!-- {name}: end -->"


def section_of(page: str, name: str) -> str | None:
    """Return a section with its markers, or None if the page does not have it."""
    begin, end = markers(name)
    if begin not in page or end not in page:
        return None
    return page[page.index(begin) : page.index(end) + len(end)]


def with_section(page: str, name: str, text: str) -> str:
    """Return the page with the section in the place of the old one, or at the end if it has none."""
    begin, end = markers(name)
    new = f"{begin}\n{text.strip()}\n{end}"
    old = section_of(page, name)
    return page.replace(old, new) if old is not None else f"{page.rstrip()}\n\n{new}\n"


def put_section(path: Path, name: str, text: str) -> None:
    """Write a section into the page at ``path``."""
    path.write_text(with_section(path.read_text(encoding="utf-8"), name, text), encoding="utf-8")


def write_by_network(about: str | None, name: str, section: Callable[[Path, str], str]) -> None:
    """Write ``section(data, network)`` of every example network, one below the other, into the page of the command line."""
    parser = argparse.ArgumentParser(
        description=about, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--data", type=Path, required=True)
    parser.add_argument("--page", type=Path, required=True)
    args = parser.parse_args()
    put_section(args.page, name, "\n\n".join(section(args.data, network) for network in NETWORKS))
