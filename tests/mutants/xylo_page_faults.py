"""Plant every fault of Xylo's arithmetic, and find out which of two independent witnesses detects it.

    python tests/mutants/xylo_page_faults.py [CSV]

The page of a chip is the module that defines its arithmetic. The plain engine plays the networks of
``tests/xylo/recorded-by-xylosim.npz`` with each fault, and for the oracle one more, made by hand.
Neither witness imports the page: xylosim is the vendor's simulator, which counts no events, and the
oracle is a second implementation. Writes, for each fault and witness, the first kind of values that
differs (:data:`TOLD_BY`). Takes a minute. Faults of the page's constants, and larger mistakes, are
tested in ``tests/xylo/test_xylo.py``.
"""

from __future__ import annotations

import csv
import sys
from collections.abc import Mapping
from pathlib import Path

import numpy as np

ROOT = Path(__file__).parents[2]
for folder in ("tests/mutants", ""):
    sys.path.insert(0, str(ROOT / folder))

from faults import Fault, faults_of  # noqa: E402
from tested import reasons  # noqa: E402

from hw_model.arithmetic import xylo  # noqa: E402
from hw_model.xylo.reference import play_xylo  # noqa: E402
from tests.support import xylo_oracle  # noqa: E402
from tests.support.numbered_arrays import read  # noqa: E402
from tests.support.witness_files import RECORDED, REGISTERS, network_of  # noqa: E402

MODULE = "hw_model.arithmetic.xylo"
OF_THE_STEP = {
    "collect",
    "respond",
    "decayed",
    "change_of",
    "fire",
    "fire_with_aliases",
    "saturate",
    "wrap",
    "taken",
    "charge_of",
}
"""The functions that compute a step. All others belong to the quantiser."""
TOLD_BY = (*REGISTERS, "events", "an error")
"""Kinds of values that are compared, in this order; an error is one that the faulty page raises."""
Values = Mapping[str, np.ndarray]


def faults() -> list[Fault]:
    """Return the faults of the functions of a step, without those that are known to change no result."""
    return [
        fault
        for fault in faults_of(MODULE)
        if fault.scope in OF_THE_STEP and fault.name not in reasons()
    ]


def plant(fault: Fault | None) -> None:
    """Put a fault into the loaded page, or, with None, restore it."""
    path = Path(str(xylo.__file__))
    text = path.read_text() if fault is None else fault.applied()
    exec(compile(text, str(path), "exec"), vars(xylo))


def by_xylosim(recorded: Values) -> Values:
    """Return the registers and spikes that were recorded from xylosim."""
    return {name: recorded[name] for name in REGISTERS}


def by_oracle(recorded: Values) -> Values:
    """Return the values of the oracle, counts of events included."""
    arrays, counted = xylo_oracle.play(network_of(recorded), recorded["events"])
    return arrays | {"events": np.array([counted[name] for name in xylo.EVENTS])}


def by_engine(recorded: Values) -> Values:
    """Return the values of the plain engine, with the fault that is planted; an empty dictionary if it fails."""
    try:
        with np.errstate(all="raise"):
            result = play_xylo(network_of(recorded), recorded["events"])
    except (ArithmeticError, IndexError, ValueError, TypeError):
        return {}
    arrays = {name: getattr(result, name) for name in REGISTERS}
    return arrays | {"events": np.array([result.events[name] for name in xylo.EVENTS])}


def least_thresholds() -> Values:
    """Return a network whose neurons spike once for each unit of their potentials, and rest in between."""
    # A dash of 1 halves a state in every step.
    of_each_synapse = np.array([[1]])
    of_each_neuron = np.array([1])
    return {
        **dict.fromkeys(("dash_syn", "dash_syn_out"), of_each_synapse),
        **dict.fromkeys(("dash_mem", "dash_mem_out", "threshold", "threshold_out"), of_each_neuron),
        "weights_in": np.array([[[8]]]),
        "weights_hidden": np.array([[[-1]]]),
        "weights_out": np.array([[4]]),
        **dict.fromkeys(("shift_in", "shift_hidden", "shift_out"), np.array(0)),
        "aliases": np.array("[]"),
        "events": np.array([[0], [0], [1], [0], [0], [0], [0], [0]]),
    }


def told_by(sound: Values, faulty: Values) -> str:
    """Return the first kind of values that differs with a fault; "" if none does."""
    if not faulty:
        return "an error"
    for kind in TOLD_BY:
        if kind in sound and not np.array_equal(sound[kind], faulty[kind]):
            return kind
    return ""


def table() -> list[dict[str, str]]:
    """Return a row for each fault: its name, and the first kind of values of each witness that differs."""
    recordings = read(RECORDED)
    sound = {
        "xylosim": [by_xylosim(recorded) for recorded in recordings],
        "oracle": [by_oracle(recorded) for recorded in (*recordings, least_thresholds())],
    }
    rows = []
    for fault in faults():
        plant(fault)
        try:
            faulty = [by_engine(recorded) for recorded in (*recordings, least_thresholds())]
        finally:
            plant(None)
        row = {"fault": fault.name}
        for witness, of_networks in sound.items():
            # Not strict: the network made by hand comes last, and xylosim did not play it.
            differing = [told_by(*pair) for pair in zip(of_networks, faulty, strict=False)]
            row[witness] = min(filter(None, differing), key=TOLD_BY.index, default="")
        rows.append(row)
    return rows


if __name__ == "__main__":
    path = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).with_suffix(".csv")
    rows = table()
    with path.open("w", newline="") as file:
        writer = csv.DictWriter(file, list(rows[0]), lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)
    for name in ("xylosim", "oracle"):
        print(f"{name}: {sum(bool(row[name]) for row in rows)} of {len(rows)} faults")
