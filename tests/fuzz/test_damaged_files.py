"""Damaged files of every kind end in a network, recordings, a program or one line, within time and memory.

A case is a reader and a number, which decides the damage. The slow test reads the cases that docs/research/robustness.md
gives the figures of, and some that lie far beyond them.
"""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

FUZZ = Path(__file__).with_name("fuzz.py")
PAGE = Path(__file__).parents[2] / "docs/research/robustness.md"
CASES = 22_950
"""All cases of the page: 850 for each of 27 readers."""
FEW_CASES = 162
"""Six for each of 27 readers."""
FAR_CASE = 100_000
"""The number of the first case of the few: the page has only those below 850."""
CPU_MS = 10_000
"""The limit of a case, as worker.py sets it: 10 s of processor time."""
MEMORY_MIB = 2_048
"""The limit of the memory of a case, as worker.py sets it: 2 GiB."""
HANG_SECONDS = 1_500
"""How long fuzz.py may take before the test gives up. Chosen by hand."""
JOBS = min(2, os.cpu_count() or 1)
"""How many readers fuzz.py runs at once. Chosen by hand: a case may take 2 GiB."""


def fuzz(*options):
    """Run fuzz.py in a process of its own; return its JSON."""
    process = subprocess.run(
        [sys.executable, str(FUZZ), "--json", *options],
        capture_output=True,
        text=True,
        check=False,
        timeout=HANG_SECONDS,
    )
    assert process.stderr == ""
    return json.loads(process.stdout)


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="its limits are those of Linux")
@pytest.mark.parametrize(
    ("cases", "first", "jobs"),
    [
        pytest.param(FEW_CASES, FAR_CASE, 1, id="some"),
        pytest.param(CASES, 0, JOBS, id="all", marks=pytest.mark.minutes),
    ],
)
def test_damaged_files(cases, first, jobs):
    document = fuzz("--cases", str(cases), "--first", str(first), "--jobs", str(jobs))
    assert document["faults"] == []
    figures = document["figures"].values()
    assert sum(row["cases"] for row in figures) == cases
    assert all(row["cases"] == row["read"] + row["refused"] for row in figures)
    if cases == CASES:
        # Of so many cases, every reader can read some. Of a few, it may have to refuse all.
        assert all(row["read"] for row in figures)
    assert max(row["slowest_ms"] for row in figures) < CPU_MS
    assert max(row["peak_mib"] for row in figures) < MEMORY_MIB


def test_the_page_gives_the_figures_of_all_readers():
    sys.path.insert(0, str(FUZZ.parent))
    from readers import READERS

    # Columns of the page: reader, cases, read, refused, faults (none), and two that depend on the machine.
    rows = re.findall(
        r"^\| ([^|]+) \| ([\d,]+) \| ([\d,]+) \| ([\d,]+) \| 0 \|",
        PAGE.read_text(),
        flags=re.MULTILINE,
    )
    assert [row[0] for row in rows] == [*(reader.name for reader in READERS), "all"]
    counts = [[int(figure.replace(",", "")) for figure in row[1:]] for row in rows]
    assert counts[-1] == [sum(column) for column in zip(*counts[:-1], strict=True)]
    assert counts[-1][0] == CASES
