"""The vocabulary of the report: its stages are those of the compiler, in its order, and what has no words is said as it is."""

import pytest

from locsnn_compile.report.words import (
    STAGES,
    share_of,
    words,
)
from locsnn_compile.verification.error_budget.budget import STAGES as COMPILED
from locsnn_compile.verification.error_budget.budget import TAILS


def test_stages_are_those_of_the_compiler():
    assert tuple(STAGES) == (*COMPILED, TAILS)


@pytest.mark.parametrize(
    ("value", "whole", "share"), [(0.1 + 0.2, 0.3, 1.0), (1, 4, 0.25), (0, 0, 0.0), (1, 1e9, 1e-9)]
)
def test_a_share_is_that_of_the_sum_in_any_order(value, whole, share):
    assert share_of(value, whole) == share


def test_what_has_no_words_is_said_as_it_is():
    assert (words("hops_x"), words("no_such_key")) == ("mesh hops, east or west", "no such key")


def test_parts_of_the_document_have_the_names_of_their_sections():
    titles = {name: words(name).capitalize() for name in ("ann_comparison", "quantization")}
    assert titles == {
        "ann_comparison": "Conventional networks",
        "quantization": "Quantisation",
    }
