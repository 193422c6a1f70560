"""The vocabulary of the report: it has words for every stage of the compiler, and shows unknown keys as they are."""

import pytest

from locsnn_compile.report.words import (
    STAGES,
    share_of,
    words,
)
from locsnn_compile.verification.error_budget.budget import STAGES as STAGES_OF_COMPILER
from locsnn_compile.verification.error_budget.budget import TAILS


def test_stages_are_those_of_the_compiler_in_its_order():
    assert tuple(STAGES) == (*STAGES_OF_COMPILER, TAILS)


@pytest.mark.parametrize(
    ("value", "whole", "share"),
    [
        pytest.param(0.1 + 0.2, 0.3, 1.0, id="0.30000000000000004 of 0.3"),
        pytest.param(1, 4, 0.25, id="a quarter"),
        pytest.param(0, 0, 0.0, id="nothing of nothing"),
        pytest.param(1, 1e9, 1e-9, id="a small share"),
    ],
)
def test_a_share_does_not_depend_on_the_order_of_a_sum(value, whole, share):
    assert share_of(value, whole) == share


def test_a_key_without_words_is_shown_with_spaces():
    assert words("hops_x") == "mesh hops, east or west"
    assert words("no_such_key") == "no such key"


def test_parts_of_the_document_have_the_names_of_their_sections():
    titles = {name: words(name).capitalize() for name in ("ann_comparison", "quantization")}
    assert titles == {
        "ann_comparison": "Conventional networks",
        "quantization": "Quantisation",
    }
