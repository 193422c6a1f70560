"""What the report says: its words for the document's keys, its titles and longer sentences, all of ``words.yaml``."""

from collections.abc import Callable, Mapping
from typing import Any

import yaml

from hw_model.errors import listed as listed
from hw_model.io.yaml_text import FAST_LOADER
from locsnn_compile.report import format as numbers
from locsnn_compile.report.format import SILENT, time
from locsnn_compile.texts.templates import Filler, filled

ASSUMED = "What was assumed:"
"""Stands above the assumptions wherever they are shown."""
SIGNS = {"yes": "✓", "nearly": "≈", "no": "✗", "unknown": "?", "modelled": "~"}
"""Stand before the answers of verdicts."""
_TEXTS: dict[str, Any] = yaml.load(filled(__package__, "words.yaml"), FAST_LOADER)
STAGES: dict[str, str] = _TEXTS["stages"]
"""Stages of the error budget in words, in the order of the compiler."""
UNITS: dict[str, str] = _TEXTS["units"]
"""What a key's last word says of its unit."""
OPERATIONS: dict[str, str] = _TEXTS["operations"]
"""Operations that a profile may give a time, as a timeline calls them."""


def texts(kind: str, name: str | None = None) -> Any:
    """Return what ``words.yaml`` has of a kind under a name, or all of that kind."""
    return _TEXTS[kind] if name is None else _TEXTS[kind][name]


def section_words(name: str, /, **given: Any) -> tuple[str, str]:
    """Return the title of a section and what is said above it."""
    found = texts("sections", name)
    return found["title"], fill(found["lead"], given)


def sentence(name: str, /, **given: Any) -> str:
    """Return one of the longer sentences, its places filled."""
    return fill(texts("sentences", name), given)


def stage_words(stage: str) -> str:
    """Return a stage of the error budget in words."""
    return STAGES.get(stage, stage)


def no_spikes(match: Mapping[str, Any], population: str) -> str:
    """Return what stands for the equal spikes of a population that has none."""
    readout = match["readout"]
    by_potential = readout.get("potentials_of", readout["populations"] if readout["by"] == "potentials" else ())
    return "read by potential" if population in by_potential else SILENT


def percent(value: float, decimals: str) -> str:
    """Return a share as a percentage of so many decimals."""
    return f"{100 * value:.{decimals}f} %"


def seconds(value: float) -> str:
    """Return a time given in seconds."""
    return time(1e9 * value)


def words(key: str) -> str:
    """Return a key of the document in words; one that is not known here, with its underscores as spaces."""
    return str(_TEXTS["words"].get(key, key.replace("_", " ")))


def limit_words(name: str) -> str:
    """Return a limit of the chip in words."""
    return words(name) if name == "cores" else f"{words(name)} of a core"


def core_words(row: Mapping[str, Any]) -> str:
    """Return a core of the document by its number and its branch."""
    return f"core {row['core']}, {words(row['phase'])}"


_OF_NUMBERS = ("any_value", "count", "energy", "memory", "plural", "points", "ratio", "share", "short", "time")
SHOWN: Mapping[str, Callable[..., str]] = {name: getattr(numbers, name) for name in _OF_NUMBERS} | {
    "percent": percent,
    "seconds": seconds,
    "words": words,
}
fill = Filler(SHOWN).fill
"""Fills the places of a text; a format is the name of a function that shows numbers, or a usual one."""
