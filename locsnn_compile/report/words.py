"""What the report says: words for the keys of the document, titles, and longer sentences, all in ``words.yaml``."""

from collections.abc import Callable, Mapping
from typing import Any

from hw_model.errors import listed as listed
from hw_model.texts.templates import Filler, yaml_table
from locsnn_compile.report import format as numbers
from locsnn_compile.report.format import SILENT, time

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


def section_words(name: str, /, **given: Any) -> tuple[str, str]:
    """Return the title of a section and its lead."""
    found = texts("sections", name)
    return found["title"], fill(found["lead"], given)


def sentence(name: str, /, **given: Any) -> str:
    """Return one of the longer sentences, with its placeholders filled."""
    return fill(texts("sentences", name), given)


def stage_words(stage: str) -> str:
    """Return a stage of the error budget in words."""
    return STAGES.get(stage, stage)


def no_spikes(match: Mapping[str, Any], population: str) -> str:
    """Return the word for the equal spikes of a population without any spikes."""
    readout = match["readout"]
    by_potential = readout.get("potentials_of", readout["populations"] if readout["by"] == "potentials" else ())
    return "read by potential" if population in by_potential else SILENT


def percent(value: float, decimals: str) -> str:
    """Return a share as a percentage with so many decimals."""
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


def core_words(row: Mapping[str, Any]) -> str:
    """Return the name of a core: its number and its branch."""
    return f"core {row['core']}, {words(row['phase'])}"


_OF_NUMBERS = ("any_value", "count", "energy", "memory", "plural", "points", "ratio", "share", "short", "time")
SHOWN: Mapping[str, Callable[..., str]] = {name: getattr(numbers, name) for name in _OF_NUMBERS} | {
    "percent": percent,
    "seconds": seconds,
    "words": words,
}
fill = Filler(SHOWN).fill
"""Fills the placeholders of a text; a format is one of :data:`SHOWN`, or a format of Python."""
