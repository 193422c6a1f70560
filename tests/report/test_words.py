"""The words of the report: each is said somewhere, and the stages are those of the compiler, in its order."""

from pathlib import Path

import pytest
import yaml

import locsnn_compile
from locsnn_compile.report.words import (
    STAGES,
    fill,
    share_of,
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
    names = [name for kind in ("sentences", "facts", "tables") for name in TEXTS[kind]]
    assert [name for name in names if f'"{name}"' not in code and f"'{name}'" not in code] == []


def test_stages_are_those_of_the_compiler():
    assert tuple(STAGES) == (*COMPILED, TAILS)


@pytest.mark.parametrize(
    ("value", "whole", "share"), [(0.1 + 0.2, 0.3, 1.0), (1, 4, 0.25), (0, 0, 0.0), (1, 1e9, 1e-9)]
)
def test_a_share_is_that_of_the_sum_in_any_order(value, whole, share):
    assert share_of(value, whole) == share


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


def test_what_has_no_words_is_said_as_it_is():
    assert (words("hops_x"), words("no_such_key")) == ("mesh hops, east or west", "no such key")


def test_parts_of_the_document_have_the_names_of_their_sections():
    titles = {name: words(name).capitalize() for name in ("ann_comparison", "quantization")}
    assert titles == {
        "ann_comparison": "Conventional networks",
        "quantization": "Quantisation",
    }
