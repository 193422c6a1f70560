"""Every link from a page to another file of the project names a file that exists, and a heading of that file."""

from __future__ import annotations

import re
from pathlib import Path
from urllib.parse import unquote

import pytest

from tests.support.fences import PAGES, ROOT, links, name, without_fences


def anchors(page: Path) -> set[str]:
    """Return the anchors of a page's headings, as GitHub and MyST make them, and those written as ``(name)=``."""
    slugs: set[str] = set()
    text = without_fences(page.read_text("utf-8"))
    for heading in re.findall(r"^#{1,6} +(.*?) *#*$", text, flags=re.MULTILINE):
        words = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", heading)
        slug = re.sub(r"[^\w\- ]", "", words.lower()).replace(" ", "-")
        # The second heading of the same words gets -1, the third -2.
        count = sum(1 for anchor in slugs if re.fullmatch(rf"{re.escape(slug)}(-\d+)?", anchor))
        slugs.add(f"{slug}-{count}" if count else slug)
    return slugs | set(re.findall(r"^\(([a-z0-9-]+)\)=$", text, flags=re.MULTILINE))


@pytest.mark.parametrize("page", [page for page in PAGES if links(page)], ids=name)
def test_links_of_a_page_lead_to_files_and_headings(page):
    for link in links(page):
        path, _, anchor = link.partition("#")
        target = (page.parent / unquote(path)).resolve() if path else page
        assert target.exists(), link
        assert target.is_relative_to(ROOT), link
        if anchor:
            assert target.suffix == ".md", link
            assert anchor in anchors(target), link


def test_the_search_finds_links():
    # Pages hold far more than 40: a search that finds nothing would pass every other test.
    assert sum(len(links(page)) for page in PAGES) > 40


@pytest.mark.parametrize("page", PAGES, ids=name)
def test_a_page_begins_with_its_title_or_includes_another_page(page):
    assert re.match(r"# \S|```\{include\}", page.read_text("utf-8"))
