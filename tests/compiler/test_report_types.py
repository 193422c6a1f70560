"""The report of a build as types and as a document: both say the same, for every kind of chip."""

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
def test_the_report_of_a_build_comes_back_byte_for_byte(target: str, diagnosis: bool):
    network = hybrid()
    compiled = lc.compile(
        network,
        hw.chip(target),
        events=recordings(network),
        strategy="dendrite",
        diagnosis=diagnosis,
    )
    read = typed(ReportFigures, json.loads(json.dumps(compiled.report)))
    assert json.dumps(plain(read)) == json.dumps(compiled.report)
    assert read == compiled.figures
