"""The words of the report: each is said somewhere, and the stages are those of the compiler, in its order."""

from pathlib import Path

import pytest
import yaml

import locsnn_compile
from locsnn_compile.report.content import Fact, Facts, Table
from locsnn_compile.report.words import (
    STAGES,
    facts,
    fill,
    notice,
    section,
    sentence,
    share_of,
    table,
    words,
)
from locsnn_compile.verification.error_budget.budget import STAGES as COMPILED
from locsnn_compile.verification.error_budget.budget import TAILS

REPORT = Path(locsnn_compile.__file__).parent / "report"
TEXTS = yaml.safe_load((REPORT / "words.yaml").read_text("utf-8"))


def test_nothing_is_left_over():
    targets = REPORT.parents[1] / "hw_model/targets"
    rooms = (REPORT, REPORT.parent / "cli", REPORT.parent / "explore", targets)
    code = "\n".join(path.read_text("utf-8") for room in rooms for path in room.rglob("*.py"))
    names = [
        name
        for kind in ("sections", "sentences", "verdicts", "facts", "tables", "notices", "figures")
        for name in TEXTS[kind]
    ]
    assert [name for name in names if f'"{name}"' not in code and f"'{name}'" not in code] == []


def test_stages_are_those_of_the_compiler():
    assert tuple(STAGES) == (*COMPILED, TAILS)


@pytest.mark.parametrize(
    ("value", "whole", "share"), [(0.1 + 0.2, 0.3, 1.0), (1, 4, 0.25), (0, 0, 0.0), (1, 1e9, 1e-9)]
)
def test_a_share_is_that_of_the_sum_in_any_order(value, whole, share):
    assert share_of(value, whole) == share


def test_places_are_filled():
    made = section("resources", target="tiny-sim")
    assert (made.title, made.lead) == ("Resources", "How much of tiny-sim the program uses.")
    assert notice("wraps", times="2 times").text.startswith(
        "A register overflowed 2 times and its value wrapped"
    )
    assert sentence("polarity", rising=0.25, falling=0.75) == "25.0 % rising, 75.0 % falling"


@pytest.mark.parametrize(
    ("text", "value", "filled"),
    [
        pytest.param("{x:share}", 0.5, "50.0 %", id="shown"),
        pytest.param("{x:share or silent}", None, "silent", id="or"),
        pytest.param("{x:share or silent}", 1.0, "100 %", id="or-not"),
        pytest.param("{x}", None, "", id="nothing"),
        pytest.param("{x:plural core}", 1, "1 core", id="argument"),
        pytest.param("{x:plural class classes}", 2, "2 classes", id="arguments"),
        pytest.param("{x:.1f or none}", 0.25, "0.2", id="usual"),
        pytest.param("{x[a][0]:words}", {"a": ["hops_x"]}, "mesh hops, east or west", id="within"),
    ],
)
def test_a_place_says_how_its_value_is_shown(text, value, filled):
    assert fill(text, {"x": value}) == filled


def test_a_row_without_a_mapping_is_a_value_and_facts_of_nothing_are_left_out():
    found = table("static energy", {"at rest": 5.0, "at work": None})
    assert found == Table(
        "Static energy per recording",
        ("how long", "energy"),
        (("at rest", "5.00 pJ"), ("at work", "not known")),
    )
    given = dict.fromkeys(("accuracy", "equal", "mismatches", "scores"))
    assert facts("matches compared", overflows="2", **given) == Facts(
        (Fact("wraps and clips", "2"),)
    )


def test_what_has_no_words_is_said_as_it_is():
    assert (words("hops_x"), words("no_such_key")) == ("mesh hops, east or west", "no such key")


def test_parts_of_the_document_have_the_names_of_their_sections():
    titles = {name: words(name).capitalize() for name in ("ann_comparison", "quantization")}
    assert titles == {
        "ann_comparison": TEXTS["sections"]["comparison"]["title"],
        "quantization": "Quantisation",
    }
