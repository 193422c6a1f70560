"""The words of the report: each is said somewhere, and the stages are those of the compiler, in its order."""

from pathlib import Path

import yaml

import locsnn_compile
from locsnn_compile.report.words import OPERATIONS, STAGES, section_words, sentence, words
from locsnn_compile.verification.error_budget.budget import STAGES as COMPILED

REPORT = Path(locsnn_compile.__file__).parent / "report"
TEXTS = yaml.safe_load((REPORT / "words.yaml").read_text("utf-8"))


def test_no_section_or_sentence_is_left_over():
    code = "\n".join(path.read_text("utf-8") for path in REPORT.rglob("*.py"))
    names = (*TEXTS["sections"], *TEXTS["sentences"])
    assert [name for name in names if f'"{name}"' not in code and f"'{name}'" not in code] == []


def test_stages_are_those_of_the_compiler():
    assert tuple(STAGES) == COMPILED


def test_places_are_filled():
    assert section_words("resources", target="tiny-sim") == ("Resources", "How much of tiny-sim the program uses.")
    assert sentence("wraps", times="2 times").startswith("A register overflowed 2 times and its value wrapped")


def test_what_has_no_words_is_said_as_it_is():
    assert (words("hops_x"), words("no_such_key")) == ("mesh hops, east or west", "no such key")
    assert OPERATIONS["axon_packets"] == "packets sent"
