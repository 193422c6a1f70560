"""A checkpoint, and a program compiled from it, read events with the start and the unit of time of the training.

The files here have times in milliseconds from 40 ms on; read with the defaults (microseconds, from the first event on),
their events would lie in other steps.
"""

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
"""The first event lies two steps after time 0 of its file; steps have the default width."""


@pytest.fixture(scope="module")
def trained(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder of ``model.pt`` and its ``data``: two classes, three events, one in each step."""
    folder = tmp_path_factory.mktemp("trained")
    for label in (0, 1):
        folder_of_class = folder / "data" / str(label)
        folder_of_class.mkdir(parents=True)
        for number in range(4):
            rows = [(FIRST_MS + STEP_MS * k, label, k % 2, 0) for k in range(3)]
            np.save(folder_of_class / f"sample_{number}.npy", np.array(rows, FIELDS))
    reading = ["--data", str(folder / "data"), *SENSOR, *TIMES]
    small = ["--epochs", "1", "--model", "tactile-snn", "--hidden", "4", "--quiet"]
    # A single epoch may teach nothing, which exits with 3.
    assert locsnn(["train", *reading, *small, "-o", str(folder / "model.pt")]) in (0, 3)
    return folder


def steps_of_events(spikes: np.ndarray) -> list[int]:
    """Return the steps of a recording (steps, channels) that have an event."""
    return np.flatnonzero(spikes.any(axis=1)).tolist()


def test_a_model_reads_events_as_its_training_did(trained: Path) -> None:
    network = lc.load(trained / "model.pt")
    assert network.event_times == EventTimes(0.0, "ms")
    recordings = read_recordings(trained / "data", model=network.expected)
    assert steps_of_events(recordings.spikes[0]) == [2, 3, 4]
    assert recordings.assumed == (
        "Times were read in ms, as in the training (--time-unit).",
        "Recordings start at 0 s of their files, as in the training (--start).",
    )


def test_options_take_precedence_over_the_training(trained: Path) -> None:
    network = lc.load(trained / "model.pt")
    options = {"start": "first", "time_unit": "s", "max_steps": 100_000}
    recordings = read_recordings(trained / "data", model=network.expected, steps=5, **options)
    # In seconds, all events but the first lie far behind the 5 steps.
    assert steps_of_events(recordings.spikes[0]) == [0]
    assert recordings.assumed == ()


def test_a_program_reads_events_as_the_training_did(
    trained: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    model = str(trained / "model.pt")
    data = str(trained / "data")
    built = str(tmp_path / "built")
    assert locsnn(["compile", model, "--events", data, "-o", built, "--quiet"]) == 0
    report = json.loads((tmp_path / "built/report.json").read_text())
    assert report["operations"]["per_sample"]["input_events"] == 3
    program = hw.load_program(tmp_path / "built")
    assert (program.start, program.time_unit) == (0.0, "ms")
    results = []
    for options in ([], TIMES):
        assert locsnn(["run", built, "--events", data, "--json", *options]) == 0
        results.append(json.loads(capsys.readouterr().out))
    by_program, by_options = results
    assumptions = by_program.pop("assumptions")
    assert assumptions[0] == "Times were read in ms, as in the training (--time-unit)."
    assert by_options.pop("assumptions") == []
    assert by_program == by_options


@pytest.mark.parametrize(
    ("chip", "options"),
    [
        pytest.param("spinnaker1", ["--model", "tactile-snn"], id="SpiNNaker"),
        pytest.param("xylo-audio3", ["--target", "xylo-audio3"], id="Xylo"),
    ],
)
def test_programs_of_other_chips_read_events_as_the_training_did(
    trained: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    chip: str,
    options: list[str],
) -> None:
    data = str(trained / "data")
    model = str(tmp_path / "model.pt")
    built = str(tmp_path / "built")
    training = ["--data", data, *SENSOR, *TIMES, "--epochs", "1", "--hidden", "4", *options]
    assert locsnn(["train", *training, "--quiet", "-o", model]) in (0, 3)
    compiling = [model, "--target", chip, "--events", data, "-o", built]
    assert locsnn(["compile", *compiling, "--quiet"]) == 0
    program = load_any_program(built)
    assert (program.start, program.time_unit) == (0.0, "ms")
    assert locsnn(["run", built, "--events", data, "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["assumptions"] == [
        "Times were read in ms, as in the training (--time-unit).",
        "Recordings start at 0 s of their files, as in the training (--start).",
    ]


@pytest.mark.parametrize(("written", "start"), [("first", "first"), ("2", 2.0), ("0.5", 0.5)])
def test_a_configuration_may_state_when_recordings_start(
    tmp_path: Path, written: str, start: float | str
) -> None:
    path = tmp_path / "training.yaml"
    path.write_text(f"start_at: {written}\n")
    assert config_from_mapping(read_config(path)).start_at == start


def test_fine_tuning_keeps_the_times_of_the_first_training(trained: Path, tmp_path: Path) -> None:
    options = ["--data", str(trained / "data"), *SENSOR, "--from", str(trained / "model.pt")]
    tuned = tmp_path / "tuned.pt"
    assert locsnn(["train", *options, "--epochs", "1", "--quiet", "-o", str(tuned)]) in (0, 3)
    assert lc.load(tuned).event_times == EventTimes(0.0, "ms")


def test_a_model_whose_training_stated_no_times_leaves_them_open() -> None:
    network = lc.load("examples/models/objects-best.pt")
    assert network.event_times is None
