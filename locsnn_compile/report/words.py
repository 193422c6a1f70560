"""The vocabulary of reports: English for the keys of report.json, their units, and the stages of the error budget.

The words lie in ``words.yaml``. The sections of the report look them up here, so that a key such as
``hops_x`` is called the same in every table.
"""

from hw_model.errors import listed as listed
from hw_model.texts.templates import yaml_table

ASSUMED = "What was assumed:"
"""The heading of the assumptions, in every form of the report."""
SIGNS = {"yes": "✓", "nearly": "≈", "no": "✗", "unknown": "?", "modelled": "~"}
"""The sign in front of a verdict's answer, by the status of the verdict."""
_VOCABULARY: dict[str, dict[str, str]] = yaml_table(__package__, "words.yaml")
STAGES = _VOCABULARY["stages"]
"""The stages of compiling that may change spikes, with their names in words, in the order of the compiler."""
UNITS = _VOCABULARY["units"]
"""The unit of a figure by the last word of its key: ``energy_pj`` is in pJ."""


def stage_words(stage: str) -> str:
    """Return the name of a stage of the error budget in words."""
    return STAGES.get(stage, stage)


def words(key: str) -> str:
    """Return a key of report.json in words; an unknown key gets spaces for its underscores."""
    return str(_VOCABULARY["words"].get(key, key.replace("_", " ")))


def limit_words(name: str, *, of_cores: bool) -> str:
    """Return the name of a limit of the chip in words.

    ``of_cores``: the limits hold for each core, as on a mesh of cores, and not for the whole chip, as
    on the open core.
    """
    if name == "synapses" and not of_cores:
        return "places for synapses, two in a word"
    if name == "cores" or not of_cores:
        return words(name)
    return f"{words(name)} of a core"


def share_of(value: float, whole: float) -> float:
    """Return ``value / whole``, or 0 if ``whole`` is 0."""
    if not whole:
        return 0.0
    # Summing floats in another order changes their last digits. Rounding keeps these out of the
    # report, so that equal builds give equal bytes.
    return round(value / whole, 12)
