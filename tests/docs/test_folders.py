"""Every page of the documentation can be reached from the table of contents, ``docs/index.md``."""

from __future__ import annotations

import pytest

from tests.support.fences import ROOT, links, name

DOCS = ROOT / "docs"
LISTED = ("start", "how-to", "reference", "explanation")
PAGES_OF_MANUAL = sorted(
    [page for folder in LISTED for page in (DOCS / folder).rglob("*.md")]
    + [*(DOCS / "development").glob("*.md")]
)
STUDIES = sorted(set((DOCS / "research").rglob("*.md")) - {DOCS / "research/studies.md"})


def targets(page):
    """Return the files that the links of a page lead to."""
    return {(page.parent / link.partition("#")[0]).resolve() for link in links(page)}


def test_all_pages_but_the_table_of_contents_lie_in_folders():
    assert {path.name for path in DOCS.iterdir() if path.is_file()} == {"conf.py", "index.md"}


@pytest.mark.parametrize("page", PAGES_OF_MANUAL, ids=name)
def test_the_table_of_contents_names_the_page(page):
    assert page in targets(DOCS / "index.md")


@pytest.mark.parametrize("page", STUDIES, ids=name)
def test_a_study_is_linked_from_the_list_of_studies_or_the_table_of_contents(page):
    assert page in targets(DOCS / "research/studies.md") | targets(DOCS / "index.md")
