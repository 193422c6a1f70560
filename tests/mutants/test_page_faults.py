"""Every fault of Loihi's arithmetic is detected by the oracle or by the core's SystemVerilog.

``page_faults.csv`` says by which; ``page_faults.py`` writes it.
"""

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


def test_every_fault_is_detected_by_a_witness():
    assert [row["fault"] for row in RECORDED if not (row["oracle"] or row["rtl"])] == []


def test_without_a_fault_nothing_differs():
    seed = page_faults.WRAPS
    sound = page_faults.by_oracle(seed)
    assert page_faults.told_by(sound, page_faults.by_engine(seed)) == ""


@pytest.mark.minutes
@pytest.mark.mutants
@pytest.mark.skipif(shutil.which("iverilog") is None, reason="Icarus Verilog is not installed")
def test_planting_the_faults_gives_the_table():
    assert page_faults.table() == RECORDED
