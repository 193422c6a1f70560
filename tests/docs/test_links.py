"""Every link within the project leads somewhere: to a file that is there, and to a heading that it has."""

from __future__ import annotations

import re
from pathlib import Path
from urllib.parse import unquote

import pytest

from tests.support.fences import PAGES, ROOT, links, name


def anchors(page: Path) -> set[str]:
    """Return the anchors of a page's headings, as code hosts and MyST make them."""
    found: set[str] = set()
    text = re.sub(
        r"^(`{3,}).*?^\1\s*$", "", page.read_text("utf-8"), flags=re.DOTALL | re.MULTILINE
    )
    for heading in re.findall(r"^#{1,6} +(.*?) *#*$", text, flags=re.MULTILINE):
        words = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", heading)
        slug = re.sub(r"[^\w\- ]", "", words.lower()).replace(" ", "-")
        count = sum(1 for anchor in found if re.fullmatch(rf"{re.escape(slug)}(-\d+)?", anchor))
        found.add(f"{slug}-{count}" if count else slug)
    return found | set(re.findall(r"^\(([a-z0-9-]+)\)=$", text, flags=re.MULTILINE))


@pytest.mark.parametrize("page", [page for page in PAGES if links(page)], ids=name)
def test_links_lead_somewhere(page):
    for link in links(page):
        path, _, anchor = link.partition("#")
        target = (page.parent / unquote(path)).resolve() if path else page
        assert target.exists(), link
        assert target.is_relative_to(ROOT), link
        if anchor:
            assert target.suffix == ".md", link
            assert anchor in anchors(target), link


def test_links_are_found():
    assert sum(len(links(page)) for page in PAGES) > 40


@pytest.mark.parametrize("page", PAGES, ids=name)
def test_a_page_begins_with_its_title(page):
    """Or it is another page, with its title."""
    assert re.match(r"# \S|```\{include\}", page.read_text("utf-8"))
