"""The report as typed figures and as a JSON document: one converts to the other and back, for every kind of chip."""

from __future__ import annotations

import json

import pytest

import hw_model as hw
import locsnn_compile as lc
from locsnn_compile.report.figures.document import ReportFigures
from locsnn_compile.report.figures.entries import plain
from locsnn_compile.report.figures.typed import typed
from tests.support.networks import hybrid, recordings


@pytest.mark.parametrize("target", ["loihi-sim", "ecp5-25f", "locsnn-130nm"])
@pytest.mark.parametrize("diagnosis", [True, False], ids=["diagnosed", "bare"])
def test_a_report_read_into_types_is_written_byte_for_byte(target: str, diagnosis: bool):
    network = hybrid()
    compiled = lc.compile(
        network,
        hw.chip(target),
        events=recordings(network),
        strategy="dendrite",
        diagnosis=diagnosis,
    )
    text = json.dumps(compiled.report)
    figures = typed(ReportFigures, json.loads(text))
    assert json.dumps(plain(figures)) == text
    assert figures == compiled.figures
