"""Content in the words of ``words.yaml``: sections, facts, verdicts, notices and tables, leaving out what is empty."""

from collections.abc import Iterable, Mapping
from typing import Any

from locsnn_compile.report.content import Block, Fact, Facts, Notice, Section, Status, Table, Verdict
from locsnn_compile.report.words import fill, section_words, texts


def section(key: str, *blocks: Block | None, called: str | None = None, **given: Any) -> Section:
    """Return a section with the blocks that are not None or empty, in the words for its key, or for ``called``."""
    return Section(key, *section_words(called or key, **given), tuple(block for block in blocks if block))


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
    holds the row's ``bar``. ``columns`` replace the heading ``*``.
    """
    said = texts("tables", name)
    if isinstance(rows, Mapping):
        rows = ({"name": name, **(row if isinstance(row, Mapping) else {"value": row})} for name, row in rows.items())
    named: dict[str, str] = {}
    for heading, text in said["columns"].items():
        named |= columns or {} if heading == "*" else {fill(heading, given): text}
    made = (tuple(fill(text, row) if head else row["bar"] for head, text in named.items()) for row in rows)
    return Table(fill(said["caption"], given), tuple(named), tuple(made), total, folded)


def share_of(value: float, whole: float) -> float:
    """Return a part as a share of its whole, without what summing in another order changes; 0 if the whole is 0."""
    return round(value / whole, 12) if whole else 0.0
