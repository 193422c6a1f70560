"""Add the resources of an FPGA to the report of a build that was written earlier.

``locsnn rtl fit`` places the open core on a device and learns which cells it takes and which clock it
reaches. This module replaces the parts of report.json, report.md and report.html that a placement
changes, and leaves the rest as it was written.
"""

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
_SECTION_BEFORE = "resources"
"""The section that is always there and after which the section on the device stands."""


class WrittenReport(Frozen, eq=False):
    """A report as it was written: its document, the figures in it, and the texts of :data:`PAGES`, by name.

    The pages show pictures of a recording, whose spikes are not among the figures. So the pages cannot
    be written again as a whole: only the parts that a placement changes are replaced.
    """

    document: Document
    figures: ReportFigures
    pages: Mapping[str, str]

    @classmethod
    def of(cls, folder: Path, document: Document) -> Self | None:
        """Return the report in the folder of a build, given its report.json; None if it lacks a page.

        Raise InputError if a page does not agree with report.json.
        """
        paths = {name: folder / name for name in PAGES}
        if not all(path.is_file() for path in paths.values()):
            return None
        pages = {name: path.read_text("utf-8", "replace") for name, path in paths.items()}
        written = cls(document, typed(ReportFigures, document), pages)
        # Replacing the device by itself changes nothing, but raises the error if a page disagrees.
        # So the user hears of it before the minutes that placing takes.
        written.with_placed(written.figures.placed)
        return written

    def with_placed(self, placed: PlacedFigures | None) -> dict[str, bytes]:
        """Return the files of the report with ``placed`` as its device, or without a device if it is None."""
        before = compose(self.figures)
        after = compose(replace(self.figures, placed=placed))
        # Taken out and added again, so that the key is always the last.
        document = {key: value for key, value in self.document.items() if key != "placed"}
        if placed is not None:
            document["placed"] = plain(placed)
        plain_text = json.dumps(document, indent=2, allow_nan=False, ensure_ascii=False)
        markdown = self._with_replaced(
            "report.md", _parts_of_markdown(before), _parts_of_markdown(after)
        )
        html = self._with_replaced("report.html", _parts_of_html(before), _parts_of_html(after))
        texts = {"report.json": plain_text + "\n", "report.md": markdown, "report.html": html}
        return {name: _as_written(text).encode() for name, text in texts.items()}

    def _with_replaced(self, name: str, before: tuple[str, ...], after: tuple[str, ...]) -> str:
        """Return a page with each part of ``before`` replaced by its counterpart in ``after``.

        Raise InputError if the page does not have a part exactly once: then somebody edited it, or
        another version wrote it.
        """
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


def _parts_of_markdown(report: Report) -> tuple[str, ...]:
    """Return the parts of report.md that depend on the device."""
    sections = "".join(section_markdown(section) for section in _resource_sections(report))
    return verdicts_markdown(report), sections


def _parts_of_html(report: Report) -> tuple[str, ...]:
    """Return the parts of report.html that depend on the device, or link to its section."""
    sections = _resource_sections(report)
    return (
        verdicts_html(report),
        "".join(link_html(section) for section in sections),
        "".join(section_html(section) for section in sections),
    )


def _resource_sections(report: Report) -> list[Section]:
    """Return the section on resources and, if the report has a device, the section on the device.

    The two are neighbours and are replaced together. A report without a device has no text of its own
    at the place where the device's section belongs; the section before it marks that place.
    """
    return [section for section in report.sections if section.key in (_SECTION_BEFORE, KEY)]
