"""What the report says: words for the keys of the document, and content in the words of ``words.yaml``.

Sections, facts, verdicts, notices and tables leave out what is empty.
"""

from collections.abc import Callable, Iterable, Mapping
from typing import Any

from hw_model.errors import listed as listed
from hw_model.texts.templates import Filler, yaml_table
from locsnn_compile.report import format as numbers
from locsnn_compile.report.content import (
    Bar,
    Block,
    Fact,
    Facts,
    Notice,
    Section,
    Status,
    Table,
    Verdict,
)
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


def sentence(name: str, /, **given: Any) -> str:
    """Return one of the longer sentences, with its placeholders filled."""
    return fill(texts("sentences", name), given)


def stage_words(stage: str) -> str:
    """Return a stage of the error budget in words."""
    return STAGES.get(stage, stage)


def no_spikes(match: Mapping[str, Any], population: str) -> str:
    """Return the word for the equal spikes of a population without any spikes."""
    readout = match["readout"]
    by_potential = readout.get(
        "potentials_of", readout["populations"] if readout["by"] == "potentials" else ()
    )
    return "read by potential" if population in by_potential else SILENT


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


def core_words(row: Mapping[str, Any]) -> str:
    """Return the name of a core: its number and its branch."""
    return f"core {row['core']}, {words(row['phase'])}"


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


def section(key: str, *blocks: Block | None, called: str | None = None, **given: Any) -> Section:
    """Return a section with the blocks that are not None or empty, in the words for its key, or for ``called``."""
    said = texts("sections", called or key)
    return Section(
        key, said["title"], fill(said["lead"], given), tuple(block for block in blocks if block)
    )


def facts(name: str, /, **given: Any) -> Facts:
    """Return facts in the words of ``words.yaml``, with placeholders filled; empty ones are left out."""
    found = ((label, fill(text, given)) for label, text in texts("facts", name).items())
    return Facts(tuple(Fact(label, value) for label, value in found if value))


def verdict(name: str, status: Status, answer: str, facts: Facts, /, **given: Any) -> Verdict:
    """Return a verdict in the words of ``words.yaml``, with placeholders filled."""
    said = {key: fill(text, given) for key, text in texts("verdicts", name).items()}
    return Verdict(status=status, answer=answer, facts=facts.facts, **said)


def notice(name: str, /, **given: Any) -> Notice:
    """Return a notice in the words of ``words.yaml``, with placeholders filled."""
    said = texts("notices", name)
    return Notice(said["title"], fill(said["text"], given))


def table(
    name: str,
    rows: Mapping[str, Any] | Iterable[Mapping[str, Any]],
    /,
    *,
    columns: Mapping[str, str] | None = None,
    total: bool = False,
    folded: bool = False,
    **given: Any,
) -> Table:
    """Return a table of ``words.yaml``: each row fills the texts under the headings with the values of its keys.

    A row given by name has that as ``name``; a row that is not a mapping is its ``value``. The column without a heading
    draws a share, the row's ``drawn``. ``columns`` replace the heading ``*``.
    """
    said = texts("tables", name)
    if isinstance(rows, Mapping):
        rows = (
            {"name": name, **(row if isinstance(row, Mapping) else {"value": row})}
            for name, row in rows.items()
        )
    named: dict[str, str] = {}
    for heading, text in said["columns"].items():
        named |= columns or {} if heading == "*" else {fill(heading, given): text}
    made = (
        tuple(
            fill(text, row) if head else Bar(row["drawn"], fill(text, row))
            for head, text in named.items()
        )
        for row in rows
    )
    return Table(fill(said["caption"], given), tuple(named), tuple(made), total, folded)


def share_of(value: float, whole: float) -> float:
    """Return a part as a share of its whole, without what summing in another order changes; 0 if the whole is 0."""
    return round(value / whole, 12) if whole else 0.0
