"""report.html in a browser: it loads nothing, and can be read on a phone, in the dark, on paper and by keyboard.

Chromium opens the pages and runs small scripts in them; the tests are skipped where there is no Chromium.
"""

from __future__ import annotations

import copy
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from locsnn_compile.cli.compile import main
from locsnn_compile.report.compose import compose
from locsnn_compile.report.renderers.html import render_html
from locsnn_compile.report.sections.builds import Build
from locsnn_compile.report.sections.comparison import comparison
from locsnn_compile.verification.excerpt import Excerpt
from tests.support.chromium import Chromium, find_chromium, started
from tests.support.small_report import figures

ROOT = Path(__file__).parents[2]
ENTER = ("Enter", 13)
TAB = ("Tab", 9)
"""Keys, with their codes in the DevTools protocol."""
CONSOLE_EVENTS = ("Runtime.exceptionThrown", "Runtime.consoleAPICalled", "Log.entryAdded")
# Scripts that return the elements (the beginning of their markup) that break a rule.
TOO_WIDE = """
  [...document.querySelectorAll('body *')].filter(e => !e.closest('.scroll, .hidden, .skip, .defs')
    && e.getBoundingClientRect().right > document.documentElement.clientWidth + 1).map(e => e.outerHTML.slice(0, 80))
"""
"""Elements that stick out of the window to the right; tables in boxes that scroll may be wider."""
CUT = """
  [...document.querySelectorAll('.scroll:not(:has(.wide))')].filter(e => e.scrollWidth > e.clientWidth + 1)
    .map(e => e.querySelector('caption').textContent)
"""
"""Captions of tables that are wider than their box, except those of many columns."""
FIRST_SCREEN = 800
"""Pixels that the browser of a small laptop shows."""
FAINT = """
  (() => {
    const parts = colour => colour.match(/[\\d.]+/g).map(Number)
    const light = ([r, g, b]) => [r, g, b].map(v => v / 255).map(v => v <= .03928 ? v / 12.92 : ((v + .055) / 1.055) ** 2.4)
      .reduce((sum, v, i) => sum + v * [.2126, .7152, .0722][i], 0)
    const background = e => { for (; e; e = e.parentElement) {
      const [r, g, b, a = 1] = parts(getComputedStyle(e).backgroundColor); if (a > 0) return [r, g, b] } return [255, 255, 255] }
    const ratio = (a, b) => (Math.max(a, b) + .05) / (Math.min(a, b) + .05)
    return [...document.querySelectorAll('h1, h2, h3, p, dt, dd, th, td, li, a, caption, summary, figcaption, text')]
      .filter(e => e.textContent.trim()).filter(e => { const style = getComputedStyle(e)
        return ratio(light(parts(e.tagName == 'text' ? style.fill : style.color)), light(background(e.parentElement))) < 4.5 })
      .map(e => e.outerHTML.slice(0, 80))
  })()
"""
"""Texts whose contrast to the background is below 4.5, the least that WCAG 2 (level AA) allows."""


@pytest.fixture(scope="session")
def browser() -> Iterator[Chromium]:
    """A browser for all tests of this module."""
    path = find_chromium()
    if path is None:
        pytest.skip("no Chromium on this machine; Debian has it as the package chromium")
    with started(path) as chromium:
        yield chromium


@pytest.fixture
def page(document: dict[str, Any], excerpt: Excerpt, tmp_path: Path) -> Path:
    """A report of 20 cores in a row of tiles, as an HTML file."""
    row = document["resources"]["by_core"][0]
    document["resources"]["by_core"] = [
        {**row, "core": i, "slot": i, "tile": [i // 4, 0]} for i in range(20)
    ]
    path = tmp_path / "report.html"
    path.write_text(render_html(compose(figures(document), excerpt)), encoding="utf-8")
    return path


def _quiet_and_alone(browser: Chromium, page: Path) -> None:
    """Check that the page wrote nothing to the console, and that the browser loaded only the page itself."""
    assert [event for event in browser.events if event["method"] in CONSOLE_EVENTS] == []
    requests = [
        event["params"]["request"]["url"]
        for event in browser.events
        if event["method"] == "Network.requestWillBeSent"
    ]
    assert requests == [page.resolve().as_uri()]


def test_it_writes_nothing_to_the_console_and_loads_nothing(browser: Chromium, page: Path) -> None:
    browser.open(page)
    _quiet_and_alone(browser, page)
    text = browser.evaluate("document.body.innerText")
    for figure in (
        "two-branches on loihi-sim",
        "95.0 %",
        "100 nJ",
        "2 of 128 cores",
        "1 only on the chip",
    ):
        assert figure in text


@pytest.mark.parametrize("width", [320, 360, 768, 1280, 1920])
def test_it_is_never_wider_than_the_screen(browser: Chromium, page: Path, width: int) -> None:
    browser.open(page, width=width)
    assert browser.evaluate(TOO_WIDE) == []
    assert (
        browser.evaluate(
            "document.documentElement.scrollWidth - document.documentElement.clientWidth"
        )
        == 0
    )


def test_no_table_is_cut_on_a_laptop(browser: Chromium, page: Path) -> None:
    """A table that is cut must be scrolled to read its last column."""
    browser.open(page, width=1280)
    browser.evaluate("document.querySelectorAll('details').forEach(each => each.open = true)")
    assert browser.evaluate(CUT) == []


def test_a_laptop_shows_all_answers_at_once(browser: Chromium, page: Path) -> None:
    browser.open(page, width=1280)
    assert browser.evaluate("document.querySelectorAll('.verdict').length") == 6
    assert browser.evaluate(
        "document.querySelector('.verdicts').getBoundingClientRect().bottom"
    ) < (FIRST_SCREEN)


@pytest.mark.parametrize("dark", [False, True], ids=["light", "dark"])
def test_all_text_stands_out_from_its_background(browser: Chromium, page: Path, dark: bool) -> None:
    browser.open(page, dark=dark)
    background = browser.evaluate("getComputedStyle(document.body).backgroundColor")
    assert background == ("rgb(18, 21, 24)" if dark else "rgb(255, 255, 255)")
    assert browser.evaluate(FAINT) == []


def test_on_paper_the_page_is_white_and_nothing_is_folded(browser: Chromium, page: Path) -> None:
    browser.open(page, dark=True, media="print")
    assert (
        browser.evaluate("getComputedStyle(document.body).backgroundColor") == "rgb(255, 255, 255)"
    )
    assert browser.evaluate(FAINT) == []
    assert browser.evaluate(
        "document.querySelector('details table').checkVisibility({contentVisibilityAuto: true})"
    )
    pdf = browser.pdf()
    assert pdf.startswith(b"%PDF-")
    assert pdf.count(b"/Type /Page\n") > 3


@pytest.mark.slow
def test_the_keyboard_reaches_and_opens_everything(browser: Chromium, page: Path) -> None:
    browser.open(page, width=360)
    browser.press(*TAB)
    assert browser.evaluate("document.activeElement.textContent") == "Skip to the verdict"
    assert browser.evaluate("document.activeElement.getBoundingClientRect().left >= 0")
    browser.press(*ENTER)
    assert browser.evaluate("location.hash") == "#main"
    reached = []
    # More often than there are elements to reach.
    for _ in range(200):
        browser.press(*TAB)
        reached.append(browser.evaluate("document.activeElement.outerHTML.slice(0, 40)"))
        if "<summary" in reached[-1]:
            assert (
                browser.evaluate("getComputedStyle(document.activeElement).outlineStyle") == "solid"
            )
            browser.press(*ENTER)
            assert browser.evaluate("document.activeElement.parentElement.open")
        # The focus has gone round once.
        if reached[-1].startswith(("<body", '<a class="skip"')):
            reached.pop()
            break
    links = browser.evaluate("document.querySelectorAll('nav a').length")
    assert sum("<a " in element for element in reached) == links
    for start, selector in (
        ("<summary", "summary"),
        ('<div class="scroll" tabindex', ".scroll[tabindex]"),
    ):
        on_page = browser.evaluate(f"document.querySelectorAll('{selector}').length")
        assert sum(start in element for element in reached) == on_page > 0


def test_pictures_and_tables_have_names(browser: Chromium, page: Path) -> None:
    browser.open(page)
    nodes = [
        node for node in browser.call("Accessibility.getFullAXTree")["nodes"] if not node["ignored"]
    ]
    names = [
        (node["role"]["value"], node.get("name", {}).get("value", ""))
        for node in nodes
        if node["role"]["value"] in ("image", "table", "region")
    ]
    assert {"image", "table", "region"} == {role for role, _ in names}
    assert [entry for entry in names if not entry[1]] == []


def test_a_page_of_two_builds(browser: Chromium, document: dict[str, Any], tmp_path: Path) -> None:
    other = copy.deepcopy(document)
    other["energy"] |= {"per_sample_pj": 75_000.0, "source": "somewhere else " * 20}
    other["skipped"] = {f"figure{i}": i for i in range(40)}
    builds = (Build(name, report, {}) for name, report in (("one", document), ("two", other)))
    page = tmp_path / "diff.html"
    page.write_text(render_html(comparison(*builds)), encoding="utf-8")
    browser.open(page)
    _quiet_and_alone(browser, page)
    assert "Yes, 25.0 % less" in browser.evaluate("document.body.innerText")
    for dark in (False, True):
        browser.open(page, width=360, dark=dark)
        assert browser.evaluate(TOO_WIDE) == []
        assert browser.evaluate(FAINT) == []


@pytest.mark.parametrize(
    "name",
    [
        "<img src=x onerror='window.hurt = 1'><script>window.hurt = 1</script>\"",
        "two\nlines",
        "../../x",
        "n" * 10_000,
    ],
    ids=["script", "newline", "path", "long"],
)
def test_hostile_names_stay_text(
    browser: Chromium, document: dict[str, Any], excerpt: Excerpt, tmp_path: Path, name: str
) -> None:
    match = document["match"]
    document["model"]["name"] = match["events_source"] = match["first_divergence"]["population"] = (
        name
    )
    for entries in (
        match["by_population"],
        document["quantization"],
        document["energy"]["by_population_pj"],
    ):
        entries[name] = entries.pop("time_output")
    assert excerpt.first is not None
    excerpt = replace(
        excerpt,
        first=replace(excerpt.first, population=name),
        inputs=(replace(excerpt.inputs[0], name=name),),
        populations=(replace(excerpt.populations[0], name=name),),
        potential=replace(excerpt.potential, population=name),
    )
    page = tmp_path / "report.html"
    page.write_text(render_html(compose(figures(document), excerpt)), encoding="utf-8")
    browser.open(page, width=360)
    _quiet_and_alone(browser, page)
    assert browser.evaluate("window.hurt === undefined")
    assert browser.evaluate(TOO_WIDE) == []
    # A long name is cut in the title.
    beginning = name.replace("\n", "\\n")[:50]
    assert browser.evaluate("document.querySelector('h1').textContent").startswith(beginning)


@pytest.mark.minutes
@pytest.mark.parametrize(
    ("model", "events", "predictions"),
    [
        ("objects-hybrid", "touches.npz", "8 of 8"),
        ("containers-hybrid", "touches-long.npz", "4 of 4"),
    ],
    ids=["objects", "containers"],
)
def test_reports_of_the_shipped_examples_can_be_read(
    browser: Chromium, tmp_path: Path, model: str, events: str, predictions: str
) -> None:
    examples = ROOT / "examples"
    arguments = [
        str(examples / f"models/{model}.pt"),
        "--events",
        str(examples / "recordings" / events),
        "--quiet",
    ]
    assert main([*arguments, "-o", str(tmp_path / "build")]) == 0
    page = tmp_path / "build" / "report.html"
    assert page.stat().st_size < 2_000_000
    browser.open(page)
    _quiet_and_alone(browser, page)
    text = browser.evaluate("document.body.innerText")
    for figure in (
        f"{model} on loihi-sim",
        "of 128 cores",
        "µJ",
        f"{predictions} recordings",
        "location_output",
    ):
        assert figure in text
    for dark in (False, True):
        browser.open(page, width=360, dark=dark)
        assert browser.evaluate(TOO_WIDE) == []
        assert browser.evaluate(FAINT) == []
    assert browser.pdf().startswith(b"%PDF-")
