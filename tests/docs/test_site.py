"""The documentation builds without a warning, its navigation holds every page, and no page loads from the network."""

from __future__ import annotations

import re
import subprocess
import sys
from html.parser import HTMLParser

import pytest

from tests.support.fences import ROOT

pytestmark = pytest.mark.minutes


class Requests(HTMLParser):
    """Collects the addresses that a browser loads to show a page, and the pages that it links to."""

    def __init__(self):
        super().__init__()
        self.loaded = set()
        self.linked = set()

    def handle_starttag(self, tag, attrs):
        values = dict(attrs)
        if tag in ("img", "script", "iframe", "source", "video", "audio"):
            self.loaded.add(values.get("src") or "")
        elif tag == "link" and values.get("rel") not in (
            "index",
            "search",
            "next",
            "prev",
            "canonical",
        ):
            self.loaded.add(values.get("href") or "")
        elif tag == "a":
            self.linked.add((values.get("href") or "").split("#")[0])


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """Build the documentation with Sphinx, every warning an error; return the folder of its pages."""
    site = tmp_path_factory.mktemp("site")
    command = [
        sys.executable,
        "-m",
        "sphinx",
        "--fail-on-warning",
        "--keep-going",
        "--quiet",
        "docs",
        str(site),
    ]
    process = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert process.returncode == 0
    assert process.stderr == ""
    return site


def requests_of(page):
    """Return what a page loads and links to."""
    requests = Requests()
    requests.feed(page.read_text("utf-8"))
    return requests


def test_pages_and_style_sheets_load_nothing_from_the_network(site):
    for page in site.rglob("*.html"):
        loaded = requests_of(page).loaded
        assert not [address for address in loaded if re.match(r"[a-z+]+:|//", address)], page.name
    for sheet in site.rglob("*.css"):
        assert not re.search(r"url\(['\"]?(https?:)?//|@import", sheet.read_text("utf-8")), (
            sheet.name
        )


def test_every_page_is_in_the_navigation(site):
    pages = {
        path.relative_to(ROOT / "docs").with_suffix(".html").as_posix()
        for path in (ROOT / "docs").rglob("*.md")
    }
    assert pages - {"index.html"} <= requests_of(site / "index.html").linked
