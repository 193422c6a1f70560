"""Convert the small report, a document by hand, to the types that the report's sections take."""

from __future__ import annotations

from typing import Any

from locsnn_compile.report.content import Verdict
from locsnn_compile.report.figures.document import ReportFigures
from locsnn_compile.report.figures.typed import typed
from locsnn_compile.report.sections.verdict import costs


def figures(document: dict[str, Any]) -> ReportFigures:
    """Return a report.json as its type."""
    return typed(ReportFigures, document)


def costs_of(document: dict[str, Any]) -> Verdict:
    """Return the verdict on the cost of a report whose energy is known."""
    report = figures(document)
    assert report.energy is not None
    return costs(report, report.energy)
