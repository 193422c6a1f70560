"""Sections of a page that a script writes between markers: the rest of the page stays as it is."""

from __future__ import annotations

import pytest
from page_section import section_of, with_section

SECTION = "<!-- speed: begin -->\nfast\n<!-- speed: end -->"


@pytest.mark.parametrize(
    ("page", "found"),
    [
        pytest.param("# Page\n\ntext\n", f"# Page\n\ntext\n\n{SECTION}\n", id="at its end"),
        pytest.param(
            "a\n<!-- speed: begin -->\nslow\n<!-- speed: end -->\nb\n",
            f"a\n{SECTION}\nb\n",
            id="in the old one's place",
        ),
    ],
)
def test_a_section_replaces_the_old_one_or_comes_last(page: str, found: str) -> None:
    assert with_section(page, "speed", "fast\n") == found
    assert with_section(found, "speed", "fast") == found
    assert section_of(found, "speed") == SECTION


def test_a_page_without_the_section_has_none() -> None:
    assert section_of("text <!-- other: begin --><!-- other: end -->", "speed") is None
