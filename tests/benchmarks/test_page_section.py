"""Sections of a page that scripts of their own write."""

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
def test_a_section_is_put_where_it_was(page: str, found: str) -> None:
    assert with_section(page, "speed", "fast\n") == found
    assert with_section(found, "speed", "fast") == found
    assert section_of(found, "speed") == SECTION


def test_a_page_without_the_section_has_none() -> None:
    assert section_of("text <!-- other: begin --><!-- other: end -->", "speed") is None
