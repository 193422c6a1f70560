"""viewer.html: data, style, plotting library and script in one file that loads nothing else.

It shows the spikes and potentials of both sides, and what the cores did in every step.
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
    """Return a page on recordings, as UTF-8; ``first`` is where the sides first differ."""
    report = compose(figures)
    values = plain(viewer_values(observed, figures.resources.by_core, first))
    data = json.dumps(values, allow_nan=False, separators=(",", ":")).replace("<", "\\u003c")
    page = filled(
        __package__,
        "viewer.html",
        title=text(report.title),
        subtitle=text(report.subtitle),
        data=data,
    )
    return page.encode(errors="backslashreplace")
