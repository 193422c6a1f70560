"""The options on steps, times and classes mean the same on every command that reads recordings.

Three events at known times are read by each command.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import nir
import numpy as np
import pytest

from locsnn_compile.cli.main import main as locsnn
from locsnn_compile.cli.options import add_options

TIMES = ("--step-seconds", "--steps", "--threshold", "--start", "--time-unit", "--max-steps", "--classes")  # fmt: skip


@pytest.mark.parametrize(
    "command", ["compile", "train", "run", "events", "explore", "pack", "sim", "stream"]
)
def test_every_command_that_reads_recordings_takes_them(command: str) -> None:
    parser = argparse.ArgumentParser()
    add_options(parser, command)
    options = {option for action in parser._actions for option in action.option_strings}
    assert {*TIMES} <= options


@pytest.fixture
def late_events(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """One event on each of three channels, 40 ms apart, from 1 s on; times are in milliseconds."""
    monkeypatch.chdir(tmp_path)
    ones = np.ones(2)
    nodes = {
        "input": nir.Input(np.array([3])),
        "w": nir.Linear(np.array([[0.6, 0.6, 0.6], [0.1, 0.1, 0.1]])),
        "out": nir.IF(r=ones, v_threshold=ones, v_reset=0 * ones),
        "output": nir.Output(np.array([2])),
    }
    edges = [("input", "w"), ("w", "out"), ("out", "output")]
    nir.write("g.nir", nir.NIRGraph(nodes, edges, type_check=False))
    rows = [(1000 + 40 * k, k, 0) for k in range(3)]
    np.save("events.npy", np.array(rows, dtype=[("t", "i8"), ("x", "i8"), ("p", "i1")]))
    return Path("events.npy")


def test_explore_reads_recordings_as_the_other_commands_do(
    late_events: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    options = ["--time-unit", "ms", "--step-seconds", "0.01", "--start", "0.9"]
    explored = ["--events", str(late_events), *options, "--weight-bits", "8", "-o", "found"]
    assert locsnn(["explore", "g.nir", *explored, "--json"]) == 0
    points = json.loads(capsys.readouterr().out)["points"]
    command = points[0]["command"]
    assert "--step-seconds 0.01 --start 0.9 --time-unit ms" in command
    arguments = command.removeprefix("locsnn-compile ").split()
    assert locsnn(["compile", *arguments, "-o", "built", "--quiet"]) == 0
    report = json.loads(Path("built/report.json").read_text())
    # The last of three events is at 1.08 s, 0.18 s after the start.
    assert report["latency"]["recording_ns"] == pytest.approx(19 * 10e6)
    assert report["operations"]["per_sample"]["input_events"] == 3


def test_calibration_is_read_as_the_other_recordings_are(late_events: Path) -> None:
    files = ["--events", str(late_events), "--calibration", str(late_events)]
    options = [*files, "--time-unit", "ms", "--min-agreement", "0"]
    assert locsnn(["compile", "g.nir", *options, "-o", "built", "--quiet"]) == 0
    report = json.loads(Path("built/report.json").read_text())
    assert report["operations"]["per_sample"]["input_events"] == 3
