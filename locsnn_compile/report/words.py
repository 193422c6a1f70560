"""What the report says: words for the keys of the document, and content in the words of ``words.yaml``.

Sections, facts, verdicts, notices and tables leave out what is empty.
"""

from collections.abc import Callable, Mapping
from typing import Any

from hw_model.errors import listed as listed
from hw_model.texts.templates import Filler, yaml_table
from locsnn_compile.report import format as numbers
from locsnn_compile.report.content import (
    Fact,
    Facts,
)
from locsnn_compile.report.format import time

ASSUMED = "What was assumed:"
"""Stands above the assumptions wherever they are shown."""
SIGNS = {"yes": "✓", "nearly": "≈", "no": "✗", "unknown": "?", "modelled": "~"}
"""Stand before the answers of verdicts."""
_TEXTS: dict[str, Any] = yaml_table(__package__, "words.yaml")
STAGES: dict[str, str] = _TEXTS["stages"]
"""Stages of the error budget in words, in the order of the compiler."""
UNITS: dict[str, str] = _TEXTS["units"]
"""The unit that the last word of a key stands for."""


def texts(kind: str, name: str | None = None) -> Any:
    """Return an entry of ``words.yaml`` by its kind and name, or all entries of a kind."""
    return _TEXTS[kind] if name is None else _TEXTS[kind][name]


def sentence(name: str, /, **given: Any) -> str:
    """Return one of the longer sentences, with its placeholders filled."""
    return fill(texts("sentences", name), given)


def stage_words(stage: str) -> str:
    """Return a stage of the error budget in words."""
    return STAGES.get(stage, stage)


def percent(value: float, decimals: str) -> str:
    """Return a share as a percentage with ``decimals`` decimals."""
    return f"{100 * value:.{decimals}f} %"


def seconds(value: float) -> str:
    """Return a time given in seconds."""
    return time(1e9 * value)


def words(key: str) -> str:
    """Return a key of the document in words; an unknown key with spaces for underscores."""
    return str(_TEXTS["words"].get(key, key.replace("_", " ")))


def limit_words(name: str) -> str:
    """Return a limit of the chip in words."""
    return words(name) if name == "cores" else f"{words(name)} of a core"


_OF_NUMBERS = (
    "any_value",
    "count",
    "energy",
    "memory",
    "plural",
    "points",
    "ratio",
    "share",
    "short",
    "time",
)
SHOWN: Mapping[str, Callable[..., str]] = {name: getattr(numbers, name) for name in _OF_NUMBERS} | {
    "percent": percent,
    "seconds": seconds,
    "words": words,
}
fill = Filler(SHOWN).fill
"""Fills the placeholders of a text; a format is one of :data:`SHOWN`, or a format of Python."""


def facts(name: str, /, **given: Any) -> Facts:
    """Return facts in the words of ``words.yaml``, with placeholders filled; empty ones are left out."""
    found = ((label, fill(text, given)) for label, text in texts("facts", name).items())
    return Facts(tuple(Fact(label, value) for label, value in found if value))


def share_of(value: float, whole: float) -> float:
    """Return a part as a share of its whole, without what summing in another order changes; 0 if the whole is 0."""
    return round(value / whole, 12) if whole else 0.0
