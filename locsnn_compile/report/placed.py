"""The report of a build, with what a device has left with the open core placed on it."""

import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Self

from hw_model.errors import InputError
from hw_model.values import Frozen
from locsnn_compile.report.compose import compose
from locsnn_compile.report.content import Document, Report, Section
from locsnn_compile.report.figures.document import ReportFigures
from locsnn_compile.report.figures.entries import plain
from locsnn_compile.report.figures.placed import PlacedFigures
from locsnn_compile.report.figures.typed import typed
from locsnn_compile.report.renderers.html import link_html, section_html, verdicts_html
from locsnn_compile.report.renderers.markdown import section_markdown, verdicts_markdown
from locsnn_compile.report.sections.placed import KEY

PAGES = ("report.md", "report.html")
_BEFORE = "resources"
"""The section after which that on the device stands."""


class WrittenReport(Frozen, eq=False):
    """A report as it was written: its document, the figures in it, and the texts of :data:`PAGES`, by name.

    Pictures of a recording are in the pages, but not among the figures. So the pages are not written
    again as a whole: the parts that a placement changes are replaced.
    """

    document: Document
    figures: ReportFigures
    pages: Mapping[str, str]

    @classmethod
    def of(cls, folder: Path, document: Document) -> Self | None:
        """Return the report of a build, given its report.json; None without its pages.

        A page that does not say what report.json says is an ``InputError``.
        """
        paths = {name: folder / name for name in PAGES}
        if not all(path.is_file() for path in paths.values()):
            return None
        pages = {name: path.read_text("utf-8", "replace") for name, path in paths.items()}
        written = cls(document, typed(ReportFigures, document), pages)
        written.with_placed(written.figures.placed)
        return written

    def with_placed(self, placed: PlacedFigures | None) -> dict[str, bytes]:
        """Return the files of the report with another device, or none."""
        before = compose(self.figures)
        after = compose(replace(self.figures, placed=placed))
        document = {key: value for key, value in self.document.items() if key != "placed"}
        if placed is not None:
            document["placed"] = plain(placed)
        plain_text = json.dumps(document, indent=2, allow_nan=False, ensure_ascii=False)
        texts = {
            "report.json": plain_text + "\n",
            "report.md": self._page("report.md", _in_markdown(before), _in_markdown(after)),
            "report.html": self._page("report.html", _in_html(before), _in_html(after)),
        }
        return {name: _as_written(text).encode() for name, text in texts.items()}

    def _page(self, name: str, before: tuple[str, ...], after: tuple[str, ...]) -> str:
        """Return a page in which parts are replaced, each of which it must have once."""
        page = self.pages[name]
        for old, new in zip(map(_as_written, before), map(_as_written, after), strict=True):
            if page.count(old) != 1:
                what = "it does not say what report.json says"
                raise InputError(name, what, fix="Compile the model again.")
            page = page.replace(old, new)
        return page


def _as_written(text: str) -> str:
    """Return a text as a page has it: characters that UTF-8 cannot hold are escaped."""
    return text.encode(errors="backslashreplace").decode()


def _in_markdown(report: Report) -> tuple[str, ...]:
    """Return the parts of report.md that say what the device is."""
    sections = "".join(section_markdown(section) for section in _on_resources(report))
    return verdicts_markdown(report), sections


def _in_html(report: Report) -> tuple[str, ...]:
    """Return the parts of report.html that say what the device is, or link to it."""
    sections = _on_resources(report)
    return (
        verdicts_html(report),
        "".join(link_html(section) for section in sections),
        "".join(section_html(section) for section in sections),
    )


def _on_resources(report: Report) -> list[Section]:
    return [section for section in report.sections if section.key in (_BEFORE, KEY)]
