"""Damaged files of every kind end in a network, recordings, a program or one line, within time and memory.

The slow test reads the cases that docs/research/robustness.md gives the figures of.
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


def fuzz(*options):
    """Run fuzz.py in a process of its own; return its JSON."""
    process = subprocess.run(
        [sys.executable, str(FUZZ), "--json", *options],
        capture_output=True,
        text=True,
        check=False,
        timeout=1500,
    )
    assert process.stderr == ""
    return json.loads(process.stdout)


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="its limits are those of Linux")
@pytest.mark.parametrize(
    "options",
    [
        pytest.param(("--cases", "162", "--first", "100000", "--jobs", "1"), id="some"),
        pytest.param(("--cases", str(CASES), "--jobs", str(min(2, os.cpu_count() or 1))), id="all", marks=pytest.mark.minutes),
    ],
)  # fmt: skip
def test_damaged_files(options):
    document = fuzz(*options)
    assert document["faults"] == []
    figures = document["figures"].values()
    assert sum(row["cases"] for row in figures) == int(options[1])
    assert all(row["cases"] == row["read"] + row["refused"] for row in figures)
    assert all(row["read"] for row in figures) or int(options[1]) < CASES
    assert max(row["slowest_ms"] for row in figures) < 10_000
    assert max(row["peak_mib"] for row in figures) < 2048


def test_the_page_gives_the_figures_of_all_readers():
    sys.path.insert(0, str(FUZZ.parent))
    from readers import READERS

    rows = re.findall(
        r"^\| ([^|]+) \| ([\d,]+) \| ([\d,]+) \| ([\d,]+) \| 0 \|",
        PAGE.read_text(),
        flags=re.MULTILINE,
    )
    assert [row[0] for row in rows] == [*(reader.name for reader in READERS), "all"]
    counts = [[int(figure.replace(",", "")) for figure in row[1:]] for row in rows]
    assert counts[-1] == [sum(column) for column in zip(*counts[:-1], strict=True)]
    assert counts[-1][0] == CASES
