"""Write a report to its three files: report.json, report.md and report.html. All kinds of targets use this."""

import json

from locsnn_compile.report.content import Document, Report
from locsnn_compile.report.renderers.html import render_html
from locsnn_compile.report.renderers.markdown import render_markdown


def report_files(document: Document, composed: Report) -> dict[str, bytes]:
    """Return the bytes of report.json, report.md and report.html by name; equal reports give equal bytes.

    ``document`` is the content of report.json, and ``composed`` what the two pages show.
    """
    # NaN is not JSON: a figure that does not exist must be null, so that any JSON reader takes the file.
    plain = json.dumps(document, indent=2, allow_nan=False, ensure_ascii=False)
    texts = {
        "report.json": plain + "\n",
        "report.md": render_markdown(composed),
        "report.html": render_html(composed),
    }
    # A file name may hold bytes that are not UTF-8, which Python represents as lone surrogates. These
    # cannot be encoded; as backslash escapes they can, and JSON readers turn them back.
    return {name: text.encode(errors="backslashreplace") for name, text in texts.items()}
