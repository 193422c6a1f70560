"""The pages on energy in the documentation agree with the code.

Constants in docs/explanation/energy.md are those of the chip file and of the code; tables in
docs/research/results/energy.md are what a benchmark writes from real recordings.
"""

from __future__ import annotations

import importlib.util
from pathlib import Path

import pytest

import hw_model as hw
from locsnn_compile.baselines.operations import ARITHMETICS
from locsnn_compile.report.words import words
from tests.support.real_recordings import REAL, on_real_recordings

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs/explanation/energy.md").read_text(encoding="utf-8")
TABLES = (ROOT / "docs/research/results/energy.md").read_text(encoding="utf-8")


def test_profiles_and_arithmetics_are_those_of_the_code():
    for name, profile in hw.chip("loihi-sim").profiles.items():
        row = next(line for line in PAGE.splitlines() if line.startswith(f"| `{name}` |"))
        assert profile.source in row
        assert ("not stated" if profile.voltage_v is None else f"{profile.voltage_v:g} V") in row
    for name, costs in ARITHMETICS.items():
        assert (
            f"| {words(name)} | {costs.multiplication_pj:g} pJ | {costs.addition_pj:g} pJ |" in PAGE
        )


def test_the_bound_of_the_buffer_is_that_of_the_chip_file():
    bounds = [
        item for item in hw.chip("loihi-sim").profile("davies2018").not_included if item.bound_pj
    ]
    assert [item.bound_pj for item in bounds] == [{"transpose_events": 20.0}]
    assert "20 pJ per event" in PAGE


@pytest.mark.minutes
@on_real_recordings
@pytest.mark.parametrize("name", ["objects-hybrid-loihi", "containers-hybrid-loihi"])
def test_the_tables_are_what_the_command_writes(name, monkeypatch):
    """Only for networks that were trained in integers: a change of the rounding does not move their figures."""
    monkeypatch.syspath_prepend(ROOT / "tests/benchmarks")
    spec = importlib.util.spec_from_file_location(
        "energy_tables", ROOT / "tests/benchmarks/energy.py"
    )
    assert spec
    assert spec.loader
    script = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(script)
    tables = script.tables({name: script.report_of(name, REAL)})
    rows = [line for line in tables.splitlines() if line.startswith(f"| {name} ")]
    # A network has ten rows in all tables together.
    assert len(rows) == 10
    assert [row for row in rows if row not in TABLES] == []
