"""The page itself: data, style, plotting library and script in one file that loads nothing."""

import json
import re
from importlib.resources import files

from hw_model.values import ByteArray, IntArray
from locsnn_compile.pipeline import Levels
from locsnn_compile.report.compose import compose
from locsnn_compile.report.content import Document
from locsnn_compile.report.renderers.html import text
from locsnn_compile.report.viewer.data import viewer_values
from locsnn_compile.verification.matching import Divergence

_PARTS = ("viewer.css", "uPlot.min.css", "uPlot.LICENSE", "uPlot.iife.min.js", "viewer.js")


def render_viewer(
    levels: Levels, document: Document, recordings: ByteArray, labels: IntArray | None, first: Divergence | None
) -> bytes:
    """Return the page of recordings (samples, steps, channels) as the network takes them.

    ``document`` is the report's; ``first`` is where the sides first differ.
    """
    room, report = files(__package__), compose(document)
    values = viewer_values(levels, recordings, labels, first) | {"cores": document["resources"]["by_core"]}
    data = json.dumps(values, allow_nan=False, separators=(",", ":")).replace("<", "\\u003c")
    given = {"title": text(report.title), "subtitle": text(report.subtitle), "data": data}
    given |= {name: room.joinpath(name).read_text("utf-8") for name in _PARTS}
    page = re.sub("@@(.+?)@@", lambda found: given[found[1]], room.joinpath("viewer.html").read_text("utf-8"))
    return page.encode(errors="backslashreplace")
