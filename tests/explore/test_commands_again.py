"""The commands that an exploration prints reproduce its figures, however the recordings were read."""

import json
import shlex
from pathlib import Path

import nir
import numpy as np
import pytest

from locsnn_compile.cli.main import main as locsnn

FIELDS = [("t", "i8"), ("x", "i8"), ("y", "i8"), ("p", "i8")]
STEP_MS = 20


@pytest.fixture
def model(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a graph of 4 inputs, next to folders of events of two polarities on 2 x 2 pixels."""
    monkeypatch.chdir(tmp_path)
    ones = np.ones(2)
    nodes = {
        "input": nir.Input(np.array([4])),
        "w": nir.Linear(np.array([[0.7, 0.4, 0.3, 0.6], [0.2, 0.9, 0.8, 0.1]])),
        "out": nir.IF(r=ones, v_threshold=ones, v_reset=0 * ones),
        "output": nir.Output(np.array([2])),
    }
    edges = [("input", "w"), ("w", "out"), ("out", "output")]
    nir.write("g.nir", nir.NIRGraph(nodes, edges, type_check=False))
    rng = np.random.default_rng(3)
    for folder in ("events", "others"):
        Path(folder).mkdir()
        for number in range(6):
            table = np.zeros(30, FIELDS)
            table["t"] = 1000 + np.sort(rng.integers(0, 30, 30)) * STEP_MS
            for name in ("x", "y", "p"):
                table[name] = rng.integers(0, 2, 30)
            np.save(f"{folder}/sample_{number}.npy", table)
    return Path("g.nir")


READ = ["--grid", "2x2", "--channel-order", "yxp", "--merge-polarities", "--time-unit", "ms"]
WAYS = [
    pytest.param([*READ, "--start", "0.9", "--threshold", "1"], id="all recordings of a file"),
    pytest.param([*READ, "--recordings", "3"], id="some of them"),
    pytest.param([*READ, "--recordings", "3", "--start", "0.9"], id="some, from another start"),
    pytest.param([*READ, "--recordings", "3", "--step-seconds", "0.04"], id="some, in wider bins"),
]


@pytest.mark.slow
@pytest.mark.parametrize("options", WAYS)
def test_commands_give_the_figures_of_their_points(
    model: Path, options: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    files = ["--events", "events", "--report-on", "others"]
    grid = ["--weight-bits", "8", "--split-weights", "0", "-o", "found", "--json"]
    assert locsnn(["explore", str(model), *files, *options, *grid]) in (0, 3)
    points = json.loads(capsys.readouterr().out)["points"]
    compared = 0
    for point in points:
        for figures, command in (("figures", "command"), ("reported", "report_command")):
            if point[command] is None:
                continue
            arguments = shlex.split(point[command])[1:]
            assert locsnn(["compile", *arguments, "--json", "-o", "built"]) == 0, point[command]
            report = json.loads(capsys.readouterr().out)
            expected = point[figures]
            assert report["match"]["spike_agreement"] == expected["spike_agreement"]
            assert report["energy"]["per_sample_pj"] == pytest.approx(expected["energy_pj"])
            compared += 1
    assert compared == 2
