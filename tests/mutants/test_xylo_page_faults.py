"""Every fault of the step of Xylo's page is told by xylosim or by the oracle, and the table says by which."""

from __future__ import annotations

import csv
from pathlib import Path

import pytest
import xylo_page_faults

TABLE = Path(xylo_page_faults.__file__).with_suffix(".csv")
RECORDED = list(csv.DictReader(TABLE.read_text().splitlines()))


def test_the_table_holds_the_faults_of_the_step():
    assert [row["fault"] for row in RECORDED] == [fault.name for fault in xylo_page_faults.faults()]


def test_every_fault_is_told_by_a_witness():
    assert [row["fault"] for row in RECORDED if not (row["xylosim"] or row["oracle"])] == []


def test_xylosim_tells_every_fault_that_moves_a_register_or_a_spike():
    untold = [row["oracle"] for row in RECORDED if not row["xylosim"]]
    counted_only = [kind for kind in untold if kind == "events"]
    # A threshold of 1 is in none of the networks that xylosim played.
    assert len(untold) - len(counted_only) == 1


def test_a_sound_page_is_told_by_none():
    network = xylo_page_faults.least_thresholds()
    sound = xylo_page_faults.by_oracle(network)
    assert xylo_page_faults.told_by(sound, xylo_page_faults.by_engine(network)) == ""


@pytest.mark.minutes
@pytest.mark.mutants
def test_the_table_is_what_is_found():
    assert xylo_page_faults.table() == RECORDED
