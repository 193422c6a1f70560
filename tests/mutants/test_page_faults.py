"""Every fault of the step's page is told by the oracle or by the core's SystemVerilog, and the table says by which."""

from __future__ import annotations

import csv
import shutil
from pathlib import Path

import page_faults
import pytest

TABLE = Path(page_faults.__file__).with_suffix(".csv")
RECORDED = list(csv.DictReader(TABLE.read_text().splitlines()))


def test_the_table_holds_the_faults_of_the_step():
    assert [row["fault"] for row in RECORDED] == [fault.name for fault in page_faults.faults()]


def test_every_fault_is_told_by_a_witness():
    assert [row["fault"] for row in RECORDED if not (row["oracle"] or row["rtl"])] == []


def test_a_sound_page_is_told_by_none():
    seed = page_faults.WRAPS
    sound = page_faults.by_oracle(seed)
    assert page_faults.told_by(sound, page_faults.by_engine(seed)) == ""


@pytest.mark.minutes
@pytest.mark.mutants
@pytest.mark.skipif(shutil.which("iverilog") is None, reason="Icarus Verilog is not installed")
def test_the_table_is_what_is_found():
    assert page_faults.table() == RECORDED
