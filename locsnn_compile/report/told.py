"""Content in the words of ``words.yaml``: sections, facts, verdicts, notices and tables, without what there is not."""

from collections.abc import Iterable, Mapping
from typing import Any

from locsnn_compile.report.content import Block, Fact, Facts, Notice, Section, Status, Table, Verdict
from locsnn_compile.report.words import fill, section_words, texts


def section(key: str, *blocks: Block | None, called: str | None = None, **given: Any) -> Section:
    """Return a section of those of the blocks that there are, with the words for its key, or those ``called`` so."""
    return Section(key, *section_words(called or key, **given), tuple(block for block in blocks if block))


def facts(name: str, /, **given: Any) -> Facts:
    """Return names and values of ``words.yaml``, their places filled; a value with nothing in it is left out."""
    found = ((label, fill(text, given)) for label, text in texts("facts", name).items())
    return Facts(tuple(Fact(label, value) for label, value in found if value))


def verdict(name: str, status: Status, answer: str, facts: Facts, /, **given: Any) -> Verdict:
    """Return a verdict in the words of ``words.yaml``, their places filled."""
    said = {key: fill(text, given) for key, text in texts("verdicts", name).items()}
    return Verdict(status=status, answer=answer, facts=facts.facts, **said)


def notice(name: str, /, **given: Any) -> Notice:
    """Return a notice in the words of ``words.yaml``, their places filled."""
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
    """Return a table of ``words.yaml``: under each heading what stands there for a row, its places filled by its keys.

    Rows that are given by name have it as ``name``, and what is no mapping as ``value``. Under no heading stands the
    row's ``bar``. ``columns`` are more of them, in place of ``*``.
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
    """Return a part as a share of its whole, 0 of nothing."""
    return value / whole if whole else 0.0
