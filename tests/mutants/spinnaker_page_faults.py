"""Plant every fault of SpiNNaker's arithmetic, and find out whether recordings of its machine code detect it.

    python tests/mutants/spinnaker_page_faults.py [CSV]

The page of a chip is the module that defines its arithmetic. The plain engine plays the networks of
``tests/spinnaker/recorded-by-machine-code.npz`` with each fault, and its values are compared with the
recorded ones. The machine code does not count wraps, so these are not compared. Writes, for each
fault, the first kind of values that differs. Takes a minute.
"""

from __future__ import annotations

import csv
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]
for folder in ("tests/mutants", ""):
    sys.path.insert(0, str(ROOT / folder))

from faults import Fault, faults_of  # noqa: E402

from hw_model.arithmetic import spinnaker  # noqa: E402
from hw_model.spinnaker.reference import play_reference  # noqa: E402
from tests.support.machine_files import RECORDED, case_of, differences  # noqa: E402
from tests.support.numbered_arrays import read  # noqa: E402
from tests.support.random_spinnaker import PHASE  # noqa: E402

MODULE = "hw_model.arithmetic.spinnaker"
OF_THE_STEP = {
    "wrap",
    "constants",
    "quotient",
    "initial_share",
    "_exponential",
    "_share",
    "_lost_by_rest",
    "charged",
    "drive_of",
    "goal_of",
    "approached",
    "faded",
    "step",
    "slot_of",
    "comes_too_late",
    "collected",
}
"""The functions that compute constants and a step."""
ERROR = "an error"
"""Stands in the table for a fault with which the engine ends in an error."""


def faults() -> list[Fault]:
    """Return the faults of the functions that compute constants and a step."""
    return [fault for fault in faults_of(MODULE) if fault.scope in OF_THE_STEP]


def plant(fault: Fault | None) -> None:
    """Put a fault into the loaded page, or, with None, restore it."""
    path = Path(str(spinnaker.__file__))
    text = path.read_text() if fault is None else fault.applied()
    exec(compile(text, str(path), "exec"), vars(spinnaker))


def told_by() -> str:
    """Return the first kind of values that differs from those of the machine code; "" if none does."""
    try:
        for recorded in read(RECORDED):
            case = case_of(recorded)
            result = play_reference(case.network, PHASE, case.spikes, case.lateness)
            different = differences(case, result, recorded)
            if different:
                return next(iter(different))
    except (ArithmeticError, AttributeError, IndexError, TypeError, ValueError):
        return ERROR
    return ""


def table() -> list[dict[str, str]]:
    """Return a row for each fault: its name, and the first kind of values that differs."""
    rows = []
    for fault in faults():
        plant(fault)
        try:
            rows.append({"fault": fault.name, "machine_code": told_by()})
        finally:
            plant(None)
    return rows


if __name__ == "__main__":
    path = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).with_suffix(".csv")
    rows = table()
    with path.open("w", newline="") as file:
        writer = csv.DictWriter(file, list(rows[0]), lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)
    print(f"machine code: {sum(bool(row['machine_code']) for row in rows)} of {len(rows)} faults")
