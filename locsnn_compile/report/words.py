"""The vocabulary of reports: words for keys of the document, units, and stages of the error budget."""

from hw_model.errors import listed as listed
from hw_model.texts.templates import yaml_table

ASSUMED = "What was assumed:"
"""Stands above the assumptions wherever they are shown."""
SIGNS = {"yes": "✓", "nearly": "≈", "no": "✗", "unknown": "?", "modelled": "~"}
"""Stand before the answers of verdicts."""
_VOCABULARY: dict[str, dict[str, str]] = yaml_table(__package__, "words.yaml")
STAGES = _VOCABULARY["stages"]
"""Stages of the error budget in words, in the order of the compiler."""
UNITS = _VOCABULARY["units"]
"""The unit that the last word of a key stands for."""


def stage_words(stage: str) -> str:
    """Return a stage of the error budget in words."""
    return STAGES.get(stage, stage)


def words(key: str) -> str:
    """Return a key of the document in words; an unknown key with spaces for underscores."""
    return str(_VOCABULARY["words"].get(key, key.replace("_", " ")))


def limit_words(name: str, *, of_cores: bool) -> str:
    """Return a limit of the chip in words; ``of_cores``: its cores have limits of their own."""
    if name == "synapses" and not of_cores:
        return "places for synapses, two in a word"
    if name == "cores" or not of_cores:
        return words(name)
    return f"{words(name)} of a core"


def share_of(value: float, whole: float) -> float:
    """Return a part as a share of its whole, without what summing in another order changes; 0 if the whole is 0."""
    return round(value / whole, 12) if whole else 0.0
