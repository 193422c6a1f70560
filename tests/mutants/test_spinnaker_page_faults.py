"""Every fault of SpiNNaker's page is told by the recorded machine code, or stands here with its reason."""

from __future__ import annotations

import csv
from pathlib import Path

import spinnaker_page_faults

TABLE = Path(spinnaker_page_faults.__file__).with_suffix(".csv")
RECORDED = list(csv.DictReader(TABLE.read_text("utf-8").splitlines()))
NOT_TOLD = {
    f"{spinnaker_page_faults.MODULE} wrap: x + HALF_SPAN -> x - HALF_SPAN": "it is the same modulo 2^32",
}


def test_the_table_has_a_row_for_every_fault_of_the_page():
    faults = [fault.name for fault in spinnaker_page_faults.faults()]
    assert [row["fault"] for row in RECORDED] == faults


def test_the_machine_code_tells_every_other_fault():
    assert {row["fault"] for row in RECORDED if not row["machine_code"]} == set(NOT_TOLD)


def test_the_sound_page_differs_in_nothing():
    assert spinnaker_page_faults.told_by() == ""
