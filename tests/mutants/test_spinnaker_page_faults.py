"""Every fault of SpiNNaker's arithmetic is detected by the recordings of its machine code, or is listed with its reason.

``spinnaker_page_faults.csv`` holds what detects each fault; ``spinnaker_page_faults.py`` writes it.
"""

from __future__ import annotations

import csv
from pathlib import Path

import spinnaker_page_faults

TABLE = Path(spinnaker_page_faults.__file__).with_suffix(".csv")
RECORDED = list(csv.DictReader(TABLE.read_text("utf-8").splitlines()))
NOT_DETECTED = {
    f"{spinnaker_page_faults.MODULE} wrap: x + HALF_SPAN -> x - HALF_SPAN": "it is the same modulo 2^32",
}
"""Faults that change nothing, with the reason."""


def test_the_table_has_a_row_for_every_fault_of_the_page():
    faults = [fault.name for fault in spinnaker_page_faults.faults()]
    assert [row["fault"] for row in RECORDED] == faults


def test_the_machine_code_detects_every_other_fault():
    assert {row["fault"] for row in RECORDED if not row["machine_code"]} == set(NOT_DETECTED)


def test_without_a_fault_nothing_differs():
    assert spinnaker_page_faults.told_by() == ""
