"""The report as Markdown and on the terminal, compared with golden files, and with hostile names and missing figures.

The golden files in ``golden/`` were read by hand: ``report/`` has a file per section, ``bare/`` the sections that differ
where everything optional is missing. To accept a change on purpose, run
``LOCSNN_GOLDEN=write python -m pytest tests/report``, then read the difference.
"""

from __future__ import annotations

import io
import os
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from rich.console import Console

from locsnn_compile.report.compose import compose
from locsnn_compile.report.content import Fact
from locsnn_compile.report.renderers.markdown import render_markdown, text
from locsnn_compile.report.renderers.terminal import render_terminal
from locsnn_compile.verification.excerpt import Excerpt
from tests.support.small_report import figures

GOLDEN = Path(__file__).parent / "golden"


def _terminal(document: dict[str, Any], width: int = 80, encoding: str = "utf-8") -> str:
    """Return what a terminal of ``width`` characters shows of a report."""
    raw = io.BytesIO()
    stream = io.TextIOWrapper(raw, encoding=encoding, write_through=True)
    render_terminal(compose(figures(document)), Console(file=stream, width=width))
    return raw.getvalue().decode(encoding)


def _check(text: str, name: str) -> None:
    """Compare a text with a golden file, or write it."""
    if os.environ.get("LOCSNN_GOLDEN") == "write":
        (GOLDEN / name).write_text(text, encoding="utf-8")
    assert text == (GOLDEN / name).read_text(encoding="utf-8")


def _check_sections(sections: dict[str, str], folder: str) -> None:
    """Compare each section with a golden file of its own; no file may be left over."""
    golden_folder = GOLDEN / folder
    if os.environ.get("LOCSNN_GOLDEN") == "write":
        for path in golden_folder.glob("*.md"):
            path.unlink()
    for name, section in sections.items():
        _check(section, f"{folder}/{name}.md")
    assert {path.stem for path in golden_folder.glob("*.md")} == {*sections}


def _sections(markdown: str) -> dict[str, str]:
    """Cut a report into sections, by names for files; the part above the first heading is ``verdicts``."""
    top, *parts = markdown.split("\n## ")
    sections = {"verdicts": f"{top}\n"}
    for part in parts:
        title = part.splitlines()[0]
        sections[title.lower().replace(" ", "-")] = f"## {part.rstrip()}\n"
    return sections


def _bare(document: dict[str, Any]) -> dict[str, Any]:
    """Take away everything that a document may lack, and return it."""
    document["accuracy"] = None
    document["ann_comparison"] = {}
    document["latency"] |= {"recording_ns": None, "real_time": None, "by_class": None, "links": []}
    document["energy"] |= {
        "other_profiles_pj": {},
        "other_profiles_by_branch_pj": {},
        "static": None,
        "by_class": None,
    }
    document["energy"] |= {"not_included": [], "not_included_bounds": []}
    for entry, unit in ((document["energy"], "pj"), (document["latency"], "ns")):
        entry[f"range_{unit}"] = [entry[f"per_sample_{unit}"]] * 2
        entry["worst_recording"]["class"] = None
    del document["error_budget"]
    del document["margins"]
    document["over_time"] = {
        "left_out": "the network is too large to be followed step by step within seconds"
    }
    match = document["match"]
    match |= {
        "first_divergence": None,
        "clips": 0,
        "wraps_and_clips_by_population": {},
        "spike_mismatches": 0,
    }
    match |= {
        "prediction_agreement": 1.0,
        "spike_agreement": 1.0,
        "events_source": "synthetic touches",
    }
    match["events_origin"] = "made up"
    del document["bounds"]
    document["overflows"] = {
        "matters": "nothing overflows",
        "recordings": 0,
        "not_known": None,
        "wide_registers": None,
        "settings": None,
    }
    document["assumptions"] = ["The recordings are made up.", "How long a step lasts is not known."]
    for population in match["by_population"].values():
        population |= {"spike_agreement": 1.0, "spike_mismatches": 0}
    return document


def test_markdown_is_that_of_the_golden_files(document: dict[str, Any], excerpt: Excerpt) -> None:
    _check_sections(_sections(render_markdown(compose(figures(document), excerpt))), "report")


def test_markdown_with_nothing_optional_is_that_of_the_golden_files(
    document: dict[str, Any],
) -> None:
    """Only the sections that differ from those of a document that has everything have files."""
    complete = _sections(render_markdown(compose(figures(document))))
    bare = _sections(render_markdown(compose(figures(_bare(document)))))
    different = {name: section for name, section in bare.items() if section != complete.get(name)}
    _check_sections(different, "bare")


def test_terminal_text_is_that_of_the_golden_file(document: dict[str, Any]) -> None:
    _check(_terminal(document), "terminal.txt")


def test_terminal_text_with_nothing_optional_is_that_of_the_golden_file(
    document: dict[str, Any],
) -> None:
    _check(_terminal(_bare(document), width=100), "terminal-bare.txt")


def test_terminal_text_in_ascii_is_that_of_the_golden_file(document: dict[str, Any]) -> None:
    document["model"]["name"] = "größe"
    _check(_terminal(document, encoding="ascii"), "terminal-ascii.txt")


@pytest.mark.parametrize("width", [10, 60, 80, 100, 200])
def test_terminal_lines_fit_and_end_in_no_blanks(document: dict[str, Any], width: int) -> None:
    lines = _terminal(document, width=width).splitlines()
    # A line is never narrower than twice its indent, that of the values next to labels of 22 characters.
    narrowest = 48
    assert max(len(line) for line in lines) <= max(width, narrowest)
    assert all(line == line.rstrip() for line in lines)
    assert "\x1b" not in "".join(lines)


def test_terminal_escapes_names(document: dict[str, Any]) -> None:
    document["model"]["name"] = "[red]x[/]\n\x1b[2J"
    assert _terminal(document).splitlines()[0] == r"[red]x[/]\n\x1b[2J on loihi-sim"


def test_values_are_aligned_next_to_long_labels(document: dict[str, Any]) -> None:
    report = compose(figures(document))
    facts = (Fact("spikes on one side only", "4,859"), Fact("x" * 40, "1"), Fact("latency", "1 ms"))
    stream = io.StringIO()
    render_terminal(
        replace(report, verdicts=(replace(report.verdicts[1], facts=facts),)),
        Console(file=stream, width=80),
    )
    for line in (
        f"  {'spikes on one side only':24}4,859",
        f"  {'x' * 22}… 1",
        f"  {'latency':24}1 ms",
    ):
        assert line in stream.getvalue().splitlines()


def test_numbered_populations_without_spikes_are_one_line(document: dict[str, Any]) -> None:
    match = document["match"]
    silent = {**match["by_population"]["time_output"], "spike_agreement": None}
    match["by_population"] |= {f"out_{number}": dict(silent) for number in range(1, 13)} | {
        "last": dict(silent)
    }
    match["readout"] |= {
        "by": "potentials",
        "populations": [f"out_{number}" for number in range(1, 13)],
    }
    lines = _terminal(document).splitlines()
    first = next(i for i, line in enumerate(lines) if "out_*" in line)
    assert lines[first : first + 2] == [
        "  out_*             12 populations, read by potential",
        "  last              silent",
    ]
    # A population with spikes in between has a line of its own.
    match["by_population"]["out_7"]["spike_agreement"] = 1.0
    assert [line.split()[0] for line in _terminal(document).splitlines() if "out_" in line] == [
        "out_*",
        "out_7",
        "out_*",
    ]


def test_terminal_counts_the_populations_that_are_left_out(document: dict[str, Any]) -> None:
    """Of 11 populations with spikes and 4 without, 8 have lines."""
    match = document["match"]
    population = match["by_population"]["time_output"]
    match["by_population"] = {f"layer_{number}": dict(population) for number in range(1, 12)}
    match["by_population"] |= {
        f"out_{number}": {**population, "spike_agreement": None} for number in range(1, 5)
    }
    assert (
        "  ...               and 7 more populations in the report"
        in _terminal(document).splitlines()
    )


def test_terminal_cuts_long_names(document: dict[str, Any]) -> None:
    document["model"]["name"] = "n" * 10_000
    assert _terminal(document).splitlines()[0] == "n" * 59 + "… on loihi-sim"


def test_terminal_shows_some_of_many_populations(document: dict[str, Any]) -> None:
    population = document["match"]["by_population"]["time_output"]
    document["match"]["by_population"] = {f"layer{i}": population for i in range(40)}
    text = _terminal(document)
    assert "layer7 " in text
    assert "layer8 " not in text
    assert "and 32 more populations in the report" in text


def test_terminal_tells_populations_of_members_apart(document: dict[str, Any]) -> None:
    population = document["match"]["by_population"]["time_output"]
    names = [
        f"{member}/{axis}_hidden"
        for member in ("objects-first", "objects-second")
        for axis in ("time", "location")
    ]
    document["match"]["by_population"] = dict.fromkeys(names, population)
    lines = _terminal(document).splitlines()
    # Long names lose their beginning, as their ends differ.
    assert [line.split()[0] for line in lines if "_hidden" in line] == [
        f"…{name[-16:]}" for name in names
    ]


def test_terminal_uses_colour_where_there_is_any(document: dict[str, Any]) -> None:
    stream = io.StringIO()
    render_terminal(
        compose(figures(document)),
        Console(file=stream, width=80, force_terminal=True, color_system="standard"),
    )
    assert "\x1b[1;32m✓ Does it fit? Yes.\x1b[0m" in stream.getvalue()


def _coloured(document: dict[str, Any], width: int) -> list[str]:
    """Return the words in bold or in bold colours, without line breaks."""
    stream = io.StringIO()
    render_terminal(
        compose(figures(document)),
        Console(file=stream, width=width, force_terminal=True, color_system="standard"),
    )
    # The escape codes of terminals: 1 is bold, 30 to 37 are colours, 0 ends both.
    bold = re.findall(r"\x1b\[(?:1|1;3\d)m(.*?)\x1b\[0m", stream.getvalue(), re.DOTALL)
    return " ".join(bold).split()


@pytest.mark.parametrize("width", [20, 30, 36, 40, 80])
def test_colour_ends_with_the_answer_however_it_is_wrapped(
    document: dict[str, Any], width: int
) -> None:
    without_wrapping = _coloured(document, width=200)
    assert _coloured(document, width) == without_wrapping


def test_bars_stay_next_to_their_labels_on_a_narrow_terminal(document: dict[str, Any]) -> None:
    lines = _terminal(document, width=40).splitlines()
    only_bars = [line for line in lines if line.strip() and set(line.strip()) <= set("█░")]
    assert only_bars == []
    assert max(len(line) for line in lines) <= 40


@pytest.mark.parametrize(
    ("name", "escaped"),
    [
        pytest.param("time_hidden", "time_hidden", id="underscore-in-a-word"),
        pytest.param("_x_", r"\_x\_", id="underscore-at-the-edge"),
        pytest.param("a|b", r"a\|b", id="pipe"),
        pytest.param("`a` *b* [c](d) ~e~", r"\`a\` \*b\* \[c\](d) \~e\~", id="markup"),
        pytest.param("a\nb", r"a\\nb", id="newline"),
        pytest.param("<script>&amp;", "&lt;script&gt;&amp;amp;", id="html"),
        pytest.param("# $x$ \\", r"\# \$x\$ \\", id="heading-formula-backslash"),
    ],
)
def test_markdown_escapes_markup_in_names(name: str, escaped: str) -> None:
    assert text(name) == escaped


def test_markdown_tables_stay_whole_with_hostile_names(document: dict[str, Any]) -> None:
    population = document["match"]["by_population"]["time_output"]
    document["match"]["by_population"] = {"a | b\n| c |": population}
    assert "\n| a \\| b\\\\n\\| c \\| | 90.0 % | 49 | 51 | 10 |\n" in render_markdown(
        compose(figures(document))
    )
