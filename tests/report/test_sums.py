"""Figures do not depend on how the version of Python adds: since 3.12, sum() carries what floats lose."""

from __future__ import annotations

import builtins
import math
from pathlib import Path

import locsnn_compile as lc

MODEL = Path(__file__).parents[2] / "examples/models/objects-hybrid.pt"
PARTS = ("energy", "latency", "over_time", "match", "operations")


def sum_of_later_pythons(values, /, start=0):
    """Add floats exactly, as Python 3.12 nearly does, and all else one by one."""
    items = list(values)
    if items and all(type(item) in (int, float) for item in items) and type(items[-1]) is float:
        return math.fsum([start, *items])
    total = start
    for item in items:
        total = total + item
    return total


def test_figures_are_the_same_whichever_way_python_adds_floats(monkeypatch):
    compiled = {}
    network = lc.load(MODEL)
    for name in ("usual", "later"):
        compiled[name] = lc.compile(network, strategy="dendrite").report
        monkeypatch.setattr(builtins, "sum", sum_of_later_pythons)
    monkeypatch.undo()
    for part in PARTS:
        assert compiled["usual"][part] == compiled["later"][part], part
