"""The site: built without a warning, every page in its navigation, and nothing in it that asks the network."""

from __future__ import annotations

import re
import subprocess
import sys
from html.parser import HTMLParser

import pytest

from tests.support.fences import ROOT

pytestmark = pytest.mark.minutes


class Requests(HTMLParser):
    """Collects what a browser loads to show a page, and the pages that it links to."""

    def __init__(self):
        super().__init__()
        self.loaded, self.linked = set(), set()

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
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0
    assert done.stderr == ""
    return site


def test_nothing_asks_the_network(site):
    for page in site.rglob("*.html"):
        found = Requests()
        found.feed(page.read_text("utf-8"))
        assert not [address for address in found.loaded if re.match(r"[a-z+]+:|//", address)], (
            page.name
        )
    for sheet in site.rglob("*.css"):
        assert not re.search(r"url\(['\"]?(https?:)?//|@import", sheet.read_text("utf-8")), (
            sheet.name
        )


def test_every_page_is_in_the_navigation(site):
    found = Requests()
    found.feed((site / "index.html").read_text("utf-8"))
    pages = {
        path.relative_to(ROOT / "docs").with_suffix(".html").as_posix()
        for path in (ROOT / "docs").rglob("*.md")
    }
    assert pages - {"index.html"} <= found.linked
