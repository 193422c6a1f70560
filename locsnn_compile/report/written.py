"""The three forms of a report as files, the same for every target."""

import json

from locsnn_compile.report.content import Document, Report
from locsnn_compile.report.renderers.html import render_html
from locsnn_compile.report.renderers.markdown import render_markdown


def report_files(document: Document, composed: Report) -> dict[str, bytes]:
    """Return report.json, report.md and report.html as bytes; equal reports give equal bytes."""
    plain = json.dumps(document, indent=2, allow_nan=False, ensure_ascii=False)
    texts = {
        "report.json": plain + "\n",
        "report.md": render_markdown(composed),
        "report.html": render_html(composed),
    }
    # A name may hold characters that UTF-8 cannot; JSON can read their escapes.
    return {name: text.encode(errors="backslashreplace") for name, text in texts.items()}
