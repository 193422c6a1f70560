"""Every kind of block of a section, in HTML and in Markdown, compared with markup written out by hand.

A block is a piece of a section, such as a paragraph, a table or a picture (:mod:`locsnn_compile.report.content`).
HTML draws all of them. Markdown has no pictures, bars or folds: some blocks have no text there, and their section has
the same figures in a table.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any, get_args

import pytest

from locsnn_compile.report.compose import compose
from locsnn_compile.report.content import (
    Bar,
    Block,
    Bullets,
    Curve,
    Fact,
    Facts,
    Folded,
    Mesh,
    MeshCore,
    Plot,
    Raster,
    Section,
    Span,
    Stack,
    Strokes,
    Table,
)
from locsnn_compile.report.figures.document import ReportFigures
from locsnn_compile.report.figures.typed import typed
from locsnn_compile.report.pictures.axis import Axis
from locsnn_compile.report.renderers.html import render_html
from locsnn_compile.report.renderers.markdown import render_markdown

ENDS = Axis(low=0.0, high=4.0, ticks=(0.0, 2.0, 4.0), text="{:g}".format)
"""An axis from 0 to 4 with ticks at its ends and its middle."""
X_AXIS = (
    '<line class="axis" x1="0.00%" x2="0.00%" y1="{y}" y2="{end}"/>'
    '<text class="tick" text-anchor="start" x="0.00%" y="{below}">0</text>'
    '<line class="axis" x1="50.00%" x2="50.00%" y1="{y}" y2="{end}"/>'
    '<text class="tick" text-anchor="middle" x="50.00%" y="{below}">2</text>'
    '<line class="axis" x1="100.00%" x2="100.00%" y1="{y}" y2="{end}"/>'
    '<text class="tick" text-anchor="end" x="100.00%" y="{below}">4</text>'
    '<text class="tick" text-anchor="middle" x="50%" y="{label}">step</text>'
)
"""The markup of the axis ``ENDS`` below a plot or a raster; the fields are places in pixels from the top."""
MARK = '<svg class="mark" width="{}" height="14" aria-hidden="true" focusable="false">'
"""The beginning of a mark in a legend, by its width."""
END_MARK = f'{MARK.format(14)}<line class="end" x1="7" x2="7" y1="2" y2="12"/></svg>'
MEDIAN_MARK = f'{MARK.format(14)}<line class="median" x1="7" x2="7" y1="0" y2="14"/></svg>'
MEAN_MARK = f'{MARK.format(14)}<circle class="mean" cx="7" cy="7" r="4.5"/></svg>'

WIDE_HEADS = "".join(f'<th scope="col">{name}</th>' for name in "abcdefgh")
WIDE_CELLS = "".join(f"<td>{cell}</td>" for cell in "2345678")
"""The heads, and the cells after the first, of the table with eight columns."""

# For each case: a block, its markup on the page, and its text in Markdown.
CASES = [
    pytest.param(
        # HTML sets an option in <code>, and keeps a number and its unit on one line; Markdown leaves both as they are.
        "3 µJ <with> --max-cores",
        "<p>3&nbsp;µJ &lt;with&gt; <code>--max-cores</code></p>",
        "3 µJ &lt;with&gt; --max-cores",
        id="paragraph",
    ),
    pytest.param(
        Facts((Fact("energy & time", "3 µJ"), Fact("spikes", "none"))),
        '<div class="facts"><dl><div><dt>energy &amp; time</dt><dd>3&nbsp;µJ</dd></div>'
        "<div><dt>spikes</dt><dd>none</dd></div></dl></div>",
        "- energy &amp; time: 3 µJ\n- spikes: none",
        id="facts",
    ),
    pytest.param(
        Bullets("Not included", ("host", "input & output")),
        '<div class="bullets"><h3>Not included</h3>'
        "<ul><li>host</li><li>input &amp; output</li></ul></div>",
        "Not included:\n\n- host\n- input &amp; output",
        id="bullets",
    ),
    pytest.param(
        Table(
            "Energy",
            ("of", "", "share %"),
            (("time_a/b", Bar(0.5, "half"), "50"), ("all", Bar(None, "whole"), "100")),
            total=True,
        ),
        '<div class="scroll"><table class="barred"><caption><span>Energy</span></caption>'
        '<thead><tr><th scope="col">of</th>'
        '<th scope="col" class="drawn"><span class="hidden">drawn</span></th>'
        '<th scope="col">share&nbsp;%</th></tr></thead>'
        '<tbody><tr><th scope="row">time_<wbr>a/<wbr>b</th><td class="drawn">'
        '<svg class="bar" width="100%" height="10" role="img" aria-label="half">'
        '<rect class="track" width="100%" height="10"/>'
        '<rect class="part" x="0.00%" width="50.00%" height="10" fill="url(#p0)"/></svg></td>'
        "<td>50</td></tr>"
        '<tr class="total"><th scope="row">all</th><td class="drawn">'
        '<svg class="bar" width="100%" height="10" role="img" aria-label="whole">'
        '<rect class="track" width="100%" height="10"/></svg></td><td>100</td></tr></tbody>'
        "</table></div>",
        "**Energy**\n\n| of | share % |\n| --- | ---: |\n| time_a/b | 50 |\n| all | 100 |",
        id="table",
    ),
    pytest.param(
        # Eight columns are enough for the class `wide`, and for a box that is scrolled by keyboard.
        Table("Wide", columns=tuple("abcdefgh"), rows=(tuple("12345678"),), folded=True),
        '<details class="long"><summary>Wide (1 rows)</summary><div class="scroll" tabindex="0" role="region"'
        ' aria-label="Wide"><table class="plain wide"><caption><span>Wide</span></caption>'
        f"<thead><tr>{WIDE_HEADS}</tr></thead>"
        f'<tbody><tr><th scope="row">1</th>{WIDE_CELLS}'
        "</tr></tbody></table></div></details>",
        "**Wide**\n\n| a | b | c | d | e | f | g | h |\n"
        "| --- | ---: | ---: | ---: | ---: | ---: | ---: | ---: |\n"
        "| 1 | 2 | 3 | 4 | 5 | 6 | 7 | 8 |",
        id="wide-table-folded",
    ),
    pytest.param(
        # A bar of a table of equal shares is filled by what is lacking: with full_at=0.05, the 3 % that are lacking of 97 %
        # fill 3 / 5 of it.
        Table(
            "Spikes",
            ("of", "", "equal"),
            (
                ("output", Bar(0.97, "97 % equal", full_at=0.05), "97 %"),
                ("hidden", Bar(1.0, "all equal", full_at=0.05), "100 %"),
                ("input", Bar(None, "silent", full_at=0.05), "silent"),
            ),
        ),
        '<div class="scroll"><table class="barred"><caption><span>Spikes</span></caption>'
        '<thead><tr><th scope="col">of</th>'
        '<th scope="col" class="drawn"><span class="hidden">drawn</span></th>'
        '<th scope="col">equal</th></tr></thead><tbody>'
        '<tr><th scope="row">output</th><td class="drawn">'
        '<svg class="bar lack" width="100%" height="10" role="img" aria-label="97 % equal">'
        '<rect class="track" width="100%" height="10"/>'
        '<rect class="part" x="0.00%" width="60.00%" height="10" fill="url(#p0)"/></svg></td>'
        '<td>97 %</td></tr><tr><th scope="row">hidden</th><td class="drawn">'
        '<svg class="bar lack" width="100%" height="10" role="img" aria-label="all equal">'
        '<rect class="track" width="100%" height="10"/></svg></td><td>100 %</td></tr>'
        '<tr><th scope="row">input</th><td class="drawn">'
        '<svg class="bar lack" width="100%" height="10" role="img" aria-label="silent">'
        '<rect class="track" width="100%" height="10"/></svg></td><td>silent</td></tr></tbody>'
        "</table></div>",
        "**Spikes**\n\n| of | equal |\n| --- | ---: |\n| output | 97 % |\n| hidden | 100 % |\n"
        "| input | silent |",
        id="table-of-what-is-lacking",
    ),
    pytest.param(
        Folded("More & less", ("first", Facts((Fact("spikes", "none"),)))),
        '<details class="more"><summary>More &amp; less</summary><div class="blocks"><p>first</p>'
        '<div class="facts"><dl><div><dt>spikes</dt><dd>none</dd></div></dl></div></div></details>',
        "first\n\n- spikes: none",
        id="folded",
    ),
    pytest.param(
        # There are six hatchings, p0 to p5, so number 7 is p1 again.
        Stack(
            "Energy",
            (
                Bar(0.25, "a", pattern=0),
                Bar(None, "b", pattern=1),
                Bar(0.75, "c & d", pattern=7),
            ),
        ),
        "<figure><figcaption>Energy</figcaption>"
        '<svg class="stack" width="100%" height="28" role="img" aria-label="Energy: a; b; c &amp; d">'
        '<rect class="track" width="100%" height="28"/>'
        '<rect class="part" x="0.00%" width="25.00%" height="28" fill="url(#p0)"/>'
        '<rect class="part" x="25.00%" width="75.00%" height="28" fill="url(#p1)"/></svg></figure>',
        "",
        id="stack",
    ),
    pytest.param(
        Span(
            "Energy",
            tuple(
                Fact(name, f"{i} pJ") for i, name in enumerate(("least", "median", "mean", "most"))
            ),
            (0.0, 1.0, 2.0, 4.0),
            ENDS,
        ),
        "<figure><figcaption>Energy</figcaption>"
        '<svg class="span" width="100%" height="50" role="img" aria-label="Energy: least 0 pJ,'
        ' median 1 pJ, mean 2 pJ, most 3 pJ; drawn from 0">'
        '<line class="axis" x1="1%" x2="99%" y1="29" y2="29"/>'
        '<line class="axis" x1="1.00%" x2="1.00%" y1="29" y2="33"/>'
        '<text class="tick" text-anchor="start" x="1.00%" y="46">0</text>'
        '<line class="axis" x1="50.00%" x2="50.00%" y1="29" y2="33"/>'
        '<text class="tick" text-anchor="middle" x="50.00%" y="46">2</text>'
        '<line class="axis" x1="99.00%" x2="99.00%" y1="29" y2="33"/>'
        '<text class="tick" text-anchor="end" x="99.00%" y="46">4</text>'
        '<line class="band" x1="1.00%" x2="99.00%" y1="14" y2="14"/>'
        '<line class="end" x1="1.00%" x2="1.00%" y1="7" y2="21"/>'
        '<line class="end" x1="99.00%" x2="99.00%" y1="7" y2="21"/>'
        '<line class="median" x1="25.50%" x2="25.50%" y1="1" y2="27"/>'
        '<circle class="mean" cx="50.00%" cy="14" r="5.5"/></svg><dl class="stats">'
        f"<div><dt>{END_MARK}least</dt><dd>0 pJ</dd></div>"
        f"<div><dt>{MEDIAN_MARK}median</dt><dd>1 pJ</dd></div>"
        f"<div><dt>{MEAN_MARK}mean</dt><dd>2 pJ</dd></div>"
        f"<div><dt>{END_MARK}most</dt><dd>3 pJ</dd></div></dl></figure>",
        "Energy:\n\n- least: 0 pJ\n- median: 1 pJ\n- mean: 2 pJ\n- most: 3 pJ",
        id="span",
    ),
    pytest.param(
        Plot(
            "Error",
            x_label="step",
            x=ENDS,
            y=Axis(low=0.0, high=1.0, ticks=(1.0,), text="{:g}".format),
            curves=(Curve("chip", ((0.0, 0.0), (4.0, 1.0))), Curve("none", ())),
            marked=3.0,
        ),
        "<figure><figcaption>Error</figcaption>"
        '<svg class="plot" width="100%" height="204" role="img"><title>Error</title>'
        "<desc>chip; none</desc>"
        '<line class="grid" x1="0%" x2="100%" y1="16.0" y2="16.0"/>'
        '<line class="marked" x1="75.00%" x2="75.00%" y1="16" y2="166"/>'
        f"{X_AXIS.format(y=166, end=170, below=183, label=199)}"
        '<svg x="0%" y="16" width="100%" height="150" viewBox="0 0 100 100"'
        ' preserveAspectRatio="none" aria-hidden="true">'
        '<polyline class="curve c0" vector-effect="non-scaling-stroke" points="0,100 100,0"/>'
        '</svg><text class="tick" x="0%" y="13.0">1</text></svg><dl class="curves">'
        f'<div><dt>{MARK.format(26)}<line class="curve c0" x1="0" x2="26" y1="7" y2="7"/></svg></dt>'
        "<dd>chip</dd></div>"
        f'<div><dt>{MARK.format(26)}<line class="curve c1" x1="0" x2="26" y1="7" y2="7"/></svg></dt>'
        "<dd>none</dd></div></dl></figure>",
        "",
        id="plot",
    ),
    pytest.param(
        Raster(
            "Spikes",
            description="two spikes",
            columns=4,
            rows=2,
            x_label="step",
            x=ENDS,
            strokes=(Strokes("equal", "both", ((0, 0), (1, 1))), Strokes("chip", "none", ())),
            # Column and row of the neuron that the ring and the line point at.
            flag=(2, 1),
            flag_label="neuron <1>",
        ),
        "<figure><figcaption>Spikes</figcaption>"
        '<svg class="raster" width="100%" height="68" role="img"><title>Spikes</title>'
        '<desc>two spikes</desc><rect class="ground" x="0%" y="14" width="100%" height="16"/>'
        '<svg x="0%" y="14" width="100%" height="16" viewBox="-.5 0 4 16"'
        ' preserveAspectRatio="none" aria-hidden="true">'
        '<path class="stroke equal" vector-effect="non-scaling-stroke" d="M0 1v6M1 9v6"/></svg>'
        '<line class="marked" x1="62.50%" x2="62.50%" y1="4" y2="30"/>'
        '<circle class="ring" cx="62.50%" cy="26.0" r="7"/>'
        '<text class="tick" text-anchor="end" x="62.50%" dx="-6" y="10">neuron &lt;1&gt;</text>'
        f"{X_AXIS.format(y=30, end=34, below=47, label=63)}</svg>"
        '<dl class="curves">'
        f'<div><dt>{MARK.format(14)}<path class="grid" d="M0 2.5h14M0 11.5h14"/>'
        '<path class="stroke equal" d="M7 4v6"/></svg></dt><dd>both</dd></div>'
        f'<div><dt>{MARK.format(14)}<path class="grid" d="M0 2.5h14M0 11.5h14"/>'
        '<path class="stroke chip" d="M7 7v4"/></svg></dt><dd>none</dd></div></dl></figure>',
        "",
        id="raster",
    ),
    pytest.param(
        Mesh(
            "Mesh",
            description="one core",
            columns=2,
            rows=1,
            tile_columns=1,
            tile_rows=1,
            cores=(MeshCore(column=1, row=0, share=0.5, text="50"),),
        ),
        "<figure><figcaption>Mesh</figcaption>"
        '<svg class="mesh" width="100%" height="31" role="img"><title>Mesh</title>'
        '<desc>one core</desc><rect class="tile" x="2.00%" y="0" width="46.00%" height="26"/>'
        '<rect class="tile" x="52.00%" y="0" width="46.00%" height="26"/>'
        '<rect class="core" x="52.00%" y="0" width="46.00%" height="26"/>'
        '<rect class="fill" x="52.00%" y="13" width="46.00%" height="13"/>'
        '<text class="value" text-anchor="middle" x="75.00%" y="17">50</text></svg>'
        '<p class="said">one core</p></figure>',
        "Mesh: one core.",
        id="mesh",
    ),
]


@pytest.mark.parametrize(("block", "markup", "markdown"), CASES)
def test_a_block_is_drawn(
    document: dict[str, Any], block: Block, markup: str, markdown: str
) -> None:
    section = Section("key", "Title", "Lead & more", (block,))
    report = replace(compose(typed(ReportFigures, document)), sections=(section,))
    page = render_html(report)
    assert page[page.index("<main") : page.index("</main>")].endswith(
        '<section class="section" aria-labelledby="key"><div><h2 id="key">Title</h2>'
        f'<p class="lead">Lead &amp; more</p></div><div class="blocks">{markup}</div></section>\n'
    )
    # A block without text in Markdown leaves only the empty lines in front of it.
    text = render_markdown(report)
    assert text[text.index("## Title") :].rstrip("\n") == (
        f"## Title\n\nLead &amp; more\n\n{markdown}".rstrip("\n")
    )


def test_a_folded_section_is_opened_by_its_heading(document: dict[str, Any]) -> None:
    section = Section("key", "Title", "Lead", ("text",), folded=True)
    report = replace(compose(typed(ReportFigures, document)), sections=(section,))
    page = render_html(report)
    assert page[page.index("<main") : page.index("</main>")].endswith(
        '<section class="section folded" aria-labelledby="key"><details><summary>'
        '<h2 id="key">Title</h2></summary><p class="lead">Lead</p>'
        '<div class="blocks"><p>text</p></div></details></section>\n'
    )
    text = render_markdown(report)
    assert text[text.index("## Title") :] == "## Title\n\nLead\n\ntext\n"


def test_every_kind_of_block_is_drawn() -> None:
    assert {type(case.values[0]) for case in CASES} == set(get_args(Block))


def test_assumptions_stand_below_the_verdicts(document: dict[str, Any]) -> None:
    report = replace(
        compose(typed(ReportFigures, document)),
        assumptions=("A step lasts 1 ms.", "<b>"),
        sections=(),
    )
    assert (
        '</div><div class="notice" role="note"><strong>What was assumed:</strong>'
        "<ul><li>A step lasts 1&nbsp;ms.</li><li>&lt;b&gt;</li></ul></div></section>"
    ) in render_html(report)
    assert "\n\n**What was assumed:**\n\n- A step lasts 1 ms.\n- &lt;b&gt;\n" in (
        render_markdown(report)
    )
    without = replace(report, assumptions=())
    assert "assumed" not in render_html(without)
    assert "assumed" not in render_markdown(without)
