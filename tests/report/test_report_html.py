"""report.html: well-formed, self-contained, accessible, and with every string escaped.

The pages are parsed with Python's HTML parser. ``test_blocks.py`` compares the markup of each kind of block, and
``test_report_browser.py`` opens pages in a browser.
"""

from __future__ import annotations

import itertools
import re
from dataclasses import replace
from html.parser import HTMLParser
from typing import Any

import pytest

from locsnn_compile.report.compose import compose
from locsnn_compile.report.renderers.html import prose, render_html
from locsnn_compile.verification.excerpt import Excerpt
from tests.support.small_report import figures

VOID = {"meta", "link", "br", "img", "hr", "input", "wbr"}
"""Elements that have no end tag."""


class Page(HTMLParser):
    """A page that was parsed: its tags with their attributes, and its text without styles.

    Parsing fails unless every start tag has its end tag, in order.
    """

    def __init__(self, page: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.text = ""
        self.feed(page)
        self.close()
        assert self.open == []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        assert len({name for name, _ in attrs}) == len(attrs)
        self.tags.append((tag, dict(attrs)))
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        if "style" not in self.open:
            self.text += f" {data}".replace("\u00a0", " ")

    def named(self, tag: str) -> list[dict[str, str | None]]:
        """Return the attributes of every element with this tag."""
        return [attributes for name, attributes in self.tags if name == tag]


def test_key_figures_are_on_the_page(document: dict[str, Any]) -> None:
    text = Page(render_html(compose(figures(document)))).text
    for figure in (
        "two-branches on loihi-sim",
        "in 19 of 20 recordings",
        "85.0 % on the chip, 90.0 % float (−5.00 points)",  # noqa: RUF001
        "90.0 % at the same neuron and step",
        "in 20 recordings; clips are 0.025 % of updates",
        "100 nJ",
        "dynamic energy per recording, profile davies2018",
        "800 pJ to 1.20 µJ, median 90.0 nJ",
        "136 nJ with sanafe",
        "1.40 ms, 5,000 times faster than the 7.00 s recorded (profile davies2018)",
        "2 of 128 cores",
        "synapse formats of a core, 3 of 16 (18.8 %)",
        "10.0 times fewer than CNN-3D and 2.00 times more than GRU-MLP (the trained network, by the published method)",
        "9.25 times fewer than CNN-3D and 2.16 times more than GRU-MLP (synaptic operations of the program)",
        "What was assumed:",
        "A step lasts 0.7 s, like the bins of the recordings, because the model does not say.",
        "The float potential 10.00000002 reaches the threshold 10 and fires",
        "host input and output (not published)",
        "ab" * 32,
        "Joined compartments (dendrites) are an assumption about the chip",
    ):
        assert figure in text


def test_verdicts_come_first_then_sections_in_their_order(document: dict[str, Any]) -> None:
    text = Page(render_html(compose(figures(document)))).text
    order = [
        "Does it match?",
        "Are registers wide enough?",
        "Does it fit?",
        "How fast at worst?",
        "What does it cost?",
        "What is not known?",
        "What was assumed:",
        "bars: spikes that differ",
        "the fullest first",
        "Time per recording",
        "Where the energy goes",
        "Each stage alone, over",
        "Accuracy after each step",
        "Distance of potentials",
        "2 of 128 cores in use",
        "model sha256",
    ]
    places = [text.index(name) for name in order]
    assert places == sorted(places)


def test_lines_break_neither_before_a_unit_nor_within_an_option() -> None:
    assert prose("15.3 µJ of 3 % in 5 steps; <give> others with --max-cores.") == (
        "15.3&nbsp;µJ of 3&nbsp;% in 5 steps; &lt;give&gt; others with <code>--max-cores</code>."
    )


def test_the_page_loads_nothing(document: dict[str, Any]) -> None:
    html = render_html(compose(figures(document)))
    page = Page(html)
    assert {tag for tag, _ in page.tags} & {
        "script",
        "link",
        "img",
        "iframe",
        "object",
        "embed",
        "form",
    } == set()
    for _, attributes in page.tags:
        assert not {"src", "srcset", "data", "style", "onload"} & attributes.keys()
        assert (attributes.get("href") or "#").startswith("#")
    assert all(target.startswith("#") for target in re.findall(r"url\(([^)]*)\)", html))
    assert "@import" not in html
    assert "://" not in html
    assert len(html.encode()) < 90_000


def test_structure_for_readers_without_sight_or_mouse(
    document: dict[str, Any], excerpt: Excerpt
) -> None:
    page = Page(render_html(compose(figures(document), excerpt)))
    assert page.named("html") == [{"lang": "en"}]
    assert [len(page.named(tag)) for tag in ("h1", "main", "nav", "header", "footer")] == [1] * 5
    levels = [int(tag[1]) for tag, _ in page.tags if re.fullmatch("h[1-6]", tag)]
    assert all(after <= before + 1 for before, after in itertools.pairwise(levels))
    assert len(page.named("caption")) == len(page.named("table"))
    assert all(cell.get("scope") in ("row", "col") for cell in page.named("th"))
    drawings = [drawing for drawing in page.named("svg") if drawing.get("aria-hidden") != "true"]
    assert all(drawing["role"] == "img" for drawing in drawings)
    named = [drawing for drawing in drawings if "aria-label" not in drawing]
    assert len(page.named("title")) == 1 + len(named)
    assert len(page.named("desc")) == len(named)
    ids = [attributes["id"] for _, attributes in page.tags if attributes.get("id")]
    assert len(ids) == len(set(ids))
    assert {link["href"] for link in page.named("a")} <= {f"#{name}" for name in ids}
    assert {section["aria-labelledby"] for section in page.named("section")} <= set(ids)
    patterns = {f"url(#{pattern['id']})" for pattern in page.named("pattern")}
    assert {part["fill"] for part in page.named("rect") if part.get("fill")} <= patterns


HOSTILE = '</title><script>alert("1")</script>\'&\n`|\x1b[31m'


def _hostile(value: Any) -> Any:
    """Return a part of a document with the hostile string in front of every string."""
    if isinstance(value, dict):
        return {key: _hostile(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_hostile(item) for item in value]
    return HOSTILE + value if isinstance(value, str) else value


def test_every_string_is_escaped(document: dict[str, Any], excerpt: Excerpt) -> None:
    def tags_of(page: Page) -> list[str]:
        """Return the tags of a page, without the places at which long names may break."""
        return sorted(tag for tag, _ in page.tags if tag != "wbr")

    tags = tags_of(Page(render_html(compose(figures(document), excerpt))))
    usual = document
    document = _hostile(document)
    # These values are one of a few words, and no other text is read.
    for key in ("reference", "events_origin"):
        document["match"][key] = usual["match"][key]
    document["match"]["readout"]["by"] = usual["match"]["readout"]["by"]
    document["over_time"]["right_is"] = usual["over_time"]["right_is"]
    document["overflows"]["matters"] = usual["overflows"]["matters"]
    names = [f"{HOSTILE}{item.name}" for item in (*excerpt.inputs, *excerpt.populations)]
    excerpt = replace(
        excerpt,
        inputs=(replace(excerpt.inputs[0], name=names[0]),),
        first=replace(excerpt.first, population=names[1]),
        populations=(replace(excerpt.populations[0], name=names[1]),),
        potential=replace(excerpt.potential, population=names[1]),
    )
    # Keys that are names.
    for entries in (
        document["match"]["by_population"],
        document["quantization"],
        document["energy"]["breakdown_pj"],
    ):
        entries[HOSTILE] = entries.pop(next(iter(entries)))
    html = render_html(compose(figures(document), excerpt))
    page = Page(html)
    assert "<script" not in html
    assert "\x1b" not in html
    assert tags_of(page) == tags
    assert '</title><script>alert("1")</script>\'&\\n`|\\x1b[31mtwo-branches on' in page.text


@pytest.mark.parametrize(
    ("path", "value", "text"),
    [
        pytest.param(
            ("accuracy",), None, "not known, because the recordings have no labels", id="no-labels"
        ),
        pytest.param(
            ("match", "events_origin"),
            "made up",
            "accuracy not known, because the recordings are made up",
            id="made-up",
        ),
        pytest.param(("assumptions",), [], "Does it match?", id="no-assumptions"),
        pytest.param(
            ("match", "first_divergence"),
            None,
            "First difference: none, every spike is equal.",
            id="equal",
        ),
        pytest.param(
            ("ann_comparison",), {}, "No comparison: the published networks", id="no-comparison"
        ),
        pytest.param(
            ("ann_comparison",),
            {
                name: {"operations": None, "ratio": None, "chip_ratio": None}
                for name in ("cnn-3d", "gru-mlp")
            },
            "No comparison: the published networks",
            id="none-is-defined",
        ),
        pytest.param(
            ("ann_comparison", "cnn-3d", "ratio"),
            None,
            "paper operations nothing to compare: there were none (the trained",
            id="no-ratio",
        ),
        pytest.param(
            ("ann_comparison", "gru-mlp", "chip_ratio"),
            None,
            "chip operations nothing to compare: there were none (syn",
            id="no-chip-ratio",
        ),
        pytest.param(
            ("latency", "recording_ns"),
            None,
            "How long a step lasts is not known, so",
            id="no-duration",
        ),
        pytest.param(("energy", "other_profiles_pj"), {}, "range 800 pJ", id="one-profile"),
        pytest.param(("energy", "not_included"), [], "Energy by operation", id="nothing-missing"),
        pytest.param(
            ("error_budget",),
            None,
            "Nothing was rounded: every number of the network is an integer of the chip.",
            id="nothing-rounded",
        ),
        pytest.param(("quantization",), {}, "Numbers of the chip", id="no-quantisation"),
        pytest.param(("model", "sha256"), None, "model sha256 –", id="no-checksum"),  # noqa: RUF001
    ],
)
def test_a_page_says_what_is_missing(
    document: dict[str, Any], path: tuple[str, ...], value: Any, text: str
) -> None:
    *outer_keys, last_key = path
    entry = document
    for key in outer_keys:
        entry = entry[key]
    entry[last_key] = value
    page = Page(render_html(compose(figures(document))))
    assert text in " ".join(page.text.split())


def test_tables_of_many_cores_are_folded_and_cut(document: dict[str, Any]) -> None:
    page = Page(render_html(compose(figures(document))))
    classes = [attributes.get("class") for attributes in page.named("details")]
    # Only the tables of constants, one per profile, are folded in a small report.
    assert classes.count("long") == len(document["energy"]["profiles"])
    row = document["resources"]["by_core"][0]
    document["resources"]["by_core"] = [{**row, "core": i} for i in range(128)]
    html = render_html(compose(figures(document)))
    assert "<summary>Core by core (128 rows)</summary>" in html
    assert len(html.encode()) < 200_000
    # 5,000 cores on 40 chips of 8 by 4 tiles, with 4 cores on each tile.
    document["resources"]["mesh"]["chips"] = 40
    tiles = [[i // 128 * 8 + i % 32 // 4, i % 128 // 32] for i in range(5000)]
    document["resources"]["by_core"] = [
        {**row, "core": i, "slot": i, "tile": tile} for i, tile in enumerate(tiles)
    ]
    html = render_html(compose(figures(document)))
    assert (
        "<summary>Core by core (5000 rows, 201 of them shown here, all in report.json)</summary>"
        in html
    )
    assert len(html.encode()) < 500_000


def test_margins_are_drawn_with_the_error_where_there_is_any(document: dict[str, Any]) -> None:
    nearer = "neurons and steps nearer to the threshold than that"
    larger = "neurons and steps with a larger error than that"
    page = Page(render_html(compose(figures(document))))
    # For each of two populations, once in the description of the drawing and once below it.
    assert page.text.count(nearer) == page.text.count(larger) == 4
    # Four curves of margins, four of predictions over time, and four of energy and time over the steps.
    assert len(page.named("polyline")) == 4 + 4 + 4
    curves = [str(curve["points"]).split(" ") for curve in page.named("polyline")]
    # Shares on a logarithmic axis of five decades, upwards from the edges of the bins: 0.1 %, 2 %, 50 % and all.
    distances = curves.index(["25,60", "50,33.98", "75,6.021", "100,0"])
    errors = curves[distances + 1]
    assert [point.split(",")[0] for point in errors] == ["0", "25", "50", "75"]
    document["margins"]["by_population"]["time_output"]["error_histogram"] = [0, 0, 0, 0]
    page = Page(render_html(compose(figures(document))))
    assert (page.text.count(nearer), page.text.count(larger)) == (4, 2)


def test_many_populations_are_not_all_drawn(document: dict[str, Any]) -> None:
    population = document["margins"]["by_population"]["time_output"]
    document["margins"]["by_population"] = {f"layer{i}": population for i in range(40)}
    page = Page(render_html(compose(figures(document))))
    plots = [drawing for drawing in page.named("svg") if drawing.get("class") == "plot"]
    # Margins of 8 populations, predictions over time, and energy and time over the steps.
    assert len(plots) == 8 + 3


def test_the_same_document_gives_the_same_bytes(document: dict[str, Any]) -> None:
    assert render_html(compose(figures(document))) == render_html(compose(figures(document)))


@pytest.mark.parametrize(
    ("strategy", "words"),
    [("reset", "strategy reset"), ("delay-line, native", "strategies delay-line and native")],
    ids=["one", "two"],
)
def test_the_header_names_every_strategy(
    document: dict[str, Any], strategy: str, words: str
) -> None:
    report = compose(figures(document | {"strategy": strategy}))
    assert report.subtitle == f"8-bit weights, {words}, 20 recordings of touches.npz"
