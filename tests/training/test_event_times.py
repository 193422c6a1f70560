"""A checkpoint, and a program of it, read events with the start and the unit of time of the training."""

import json
from pathlib import Path

import numpy as np
import pytest

import hw_model as hw
import locsnn_compile as lc
from hw_model.targets.programs import load_any_program
from locsnn_compile.cli.main import main as locsnn
from locsnn_compile.data.read import read_recordings
from locsnn_compile.data.recordings import EventTimes
from locsnn_compile.training.config import config_from_mapping, read_config

FIELDS = [("t", "i8"), ("x", "i8"), ("y", "i8"), ("p", "i8")]
SENSOR = ["--grid", "2x2", "--polarities", "1"]
TIMES = ["--start", "0", "--time-unit", "ms"]
FIRST_MS, STEP_MS = 40, 20
"""Recordings begin two steps after time 0 of their files."""


@pytest.fixture(scope="module")
def trained(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder of ``model.pt`` and its ``data``: two classes, an event a step, times in ms."""
    folder = tmp_path_factory.mktemp("trained")
    for label in (0, 1):
        at = folder / "data" / str(label)
        at.mkdir(parents=True)
        for number in range(4):
            rows = [(FIRST_MS + STEP_MS * k, label, k % 2, 0) for k in range(3)]
            np.save(at / f"sample_{number}.npy", np.array(rows, FIELDS))
    asked = ["--data", str(folder / "data"), *SENSOR, *TIMES, "--quiet", "-o"]
    fast = ["--epochs", "1", "--model", "tactile-snn", "--hidden", "4"]
    assert locsnn(["train", *asked, str(folder / "model.pt"), *fast]) in (0, 3)
    return folder


def steps_of_events(spikes: np.ndarray) -> list[int]:
    return np.flatnonzero(spikes.any(axis=1)).tolist()


def test_a_model_reads_events_as_its_training_did(trained: Path) -> None:
    network = lc.load(trained / "model.pt")
    assert network.event_times == EventTimes(0.0, "ms")
    found = read_recordings(trained / "data", model=network.expected)
    assert steps_of_events(found.spikes[0]) == [2, 3, 4]
    assert found.assumed == (
        "Times were read in ms, as in the training (--time-unit).",
        "Recordings start at 0 s of their files, as in the training (--start).",
    )


def test_options_take_precedence_over_the_training(trained: Path) -> None:
    network = lc.load(trained / "model.pt")
    given = {"start": "first", "time_unit": "s", "max_steps": 100_000}
    found = read_recordings(trained / "data", model=network.expected, steps=5, **given)
    assert steps_of_events(found.spikes[0]) == [0]
    assert found.assumed == ()


def test_a_program_reads_events_as_the_training_did(
    trained: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    compiled = [str(trained / "model.pt"), "--events", str(trained / "data")]
    assert locsnn(["compile", *compiled, "-o", str(tmp_path / "built"), "--quiet"]) == 0
    report = json.loads((tmp_path / "built/report.json").read_text())
    assert report["operations"]["per_sample"]["input_events"] == 3
    program = hw.load_program(tmp_path / "built")
    assert (program.start, program.time_unit) == (0.0, "ms")
    played = ["run", str(tmp_path / "built"), "--events", str(trained / "data"), "--json"]
    results = []
    for options in ([], TIMES):
        assert locsnn([*played, *options]) == 0
        results.append(json.loads(capsys.readouterr().out))
    kept, asked = results
    said = kept.pop("assumptions")
    assert said[0] == "Times were read in ms, as in the training (--time-unit)."
    assert asked.pop("assumptions") == []
    assert kept == asked


@pytest.mark.parametrize(
    ("chip", "options"),
    [
        pytest.param("spinnaker1", ["--model", "tactile-snn"], id="SpiNNaker"),
        pytest.param("xylo-audio3", ["--target", "xylo-audio3"], id="Xylo"),
    ],
)
def test_programs_of_other_chips_read_events_so_too(
    trained: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    chip: str,
    options: list[str],
) -> None:
    data, model, built = trained / "data", tmp_path / "model.pt", str(tmp_path / "built")
    asked = ["--data", str(data), *SENSOR, *TIMES, "--epochs", "1", "--hidden", "4", *options]
    assert locsnn(["train", *asked, "--quiet", "-o", str(model)]) in (0, 3)
    compiled = [str(model), "--target", chip, "--events", str(data), "-o", built]
    assert locsnn(["compile", *compiled, "--quiet"]) == 0
    program = load_any_program(built)
    assert (program.start, program.time_unit) == (0.0, "ms")
    assert locsnn(["run", built, "--events", str(data), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["assumptions"] == [
        "Times were read in ms, as in the training (--time-unit).",
        "Recordings start at 0 s of their files, as in the training (--start).",
    ]


@pytest.mark.parametrize(("written", "start"), [("first", "first"), ("2", 2.0), ("0.5", 0.5)])
def test_a_configuration_may_say_when_recordings_start(
    tmp_path: Path, written: str, start: float | str
) -> None:
    path = tmp_path / "training.yaml"
    path.write_text(f"start_at: {written}\n")
    assert config_from_mapping(read_config(path)).start_at == start


def test_fine_tuning_goes_on_with_the_times(trained: Path, tmp_path: Path) -> None:
    asked = ["--data", str(trained / "data"), *SENSOR, "--from", str(trained / "model.pt")]
    out = tmp_path / "tuned.pt"
    assert locsnn(["train", *asked, "--epochs", "1", "--quiet", "-o", str(out)]) in (0, 3)
    assert lc.load(out).event_times == EventTimes(0.0, "ms")


def test_a_model_that_says_nothing_of_times_leaves_them_open(trained: Path) -> None:
    network = lc.load("examples/models/objects-best.pt")
    assert network.event_times is None
