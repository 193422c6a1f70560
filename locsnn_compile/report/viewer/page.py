"""Write viewer.html, an interactive page that shows spikes and potentials of both sides step by step.

It also shows what the cores did in every step. Data, style, plotting library and script are in one file that loads
nothing else, so that it can be opened from a folder without a server.
"""

import json

from hw_model.texts.templates import filled
from locsnn_compile.report.compose import compose
from locsnn_compile.report.figures.document import ReportFigures
from locsnn_compile.report.figures.entries import plain
from locsnn_compile.report.renderers.html import text
from locsnn_compile.report.viewer.values import viewer_values
from locsnn_compile.verification.matching import Divergence
from locsnn_compile.verification.observation import Observed


def render_viewer(observed: Observed, figures: ReportFigures, first: Divergence | None) -> bytes:
    """Return a page on some of the recordings, as UTF-8; ``first`` is the first spike that differs, if any does."""
    report = compose(figures)
    values = plain(viewer_values(observed, figures.resources.by_core, first))
    compact = json.dumps(values, allow_nan=False, separators=(",", ":"))
    # The data stand in a <script> element, which a name with "</script>" in it would end.
    data = compact.replace("<", "\\u003c")
    page = filled(
        __package__,
        "viewer.html",
        title=text(report.title),
        subtitle=text(report.subtitle),
        data=data,
    )
    # A name may hold characters that UTF-8 cannot encode.
    return page.encode(errors="backslashreplace")
