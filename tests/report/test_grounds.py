"""The assumptions of a report, and the length of a step: they are stated where they are made, and nowhere else.

Each sentence is written out by hand. Builds through the command line show that the sentences reach report.json, the
pages, the terminal and the CSV files, and that no time of a sensor appears where the length of a step is unknown.
"""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import nir
import numpy as np
import pytest

import hw_model as hw
import locsnn_compile as lc
from locsnn_compile.cli.compile import main
from locsnn_compile.data.recordings import Binned, Origin, Recordings
from locsnn_compile.data.sensor import neutouch
from locsnn_compile.frontends.parts import synthetic_recordings
from locsnn_compile.models.checkpoint import Checkpoint
from locsnn_compile.models.description import InputLayout, NetworkDescription
from locsnn_compile.models.graph_and_windows import WindowParameters
from locsnn_compile.models.networks import build_network
from locsnn_compile.network.network import Network
from locsnn_compile.report.grounds import grounds_of

STEPS = 40
CHANNELS = 78
"""The size of the networks here: a sensor of one fingertip has 39 taxels with two polarities."""

MADE_UP = (
    "The check plays made-up recordings (synthetic touches): accuracy is not known, and agreement, energy and time will "
    "differ on real ones."
)
TRAINED_ON = (
    "The check plays recordings that the network was trained on, which the model carries: its accuracy on others may be "
    "lower."
)
NO_STEP = "How long a step lasts is not known, because neither the model nor the recordings say it (--step-seconds): there is no comparison with the pace of a sensor."
STEP_OF_BINS = (
    "A step lasts 0.01 s, like the bins of the recordings, because the model does not say."
)
SILENCE = "The recordings have 30 steps; silence follows, up to the 40 of the model."

THRESHOLD = (
    "A bin of more than 2 events is 1, the default, because the model does not say (--threshold)."
)


def calibrated(recordings: str) -> str:
    """Return the sentence that a report has for these calibration recordings."""
    return (
        f"The program was calibrated on {recordings}: its weights and settings suit these. "
        "Give others with --calibration."
    )


def random_recordings(
    origin: Origin = "given", step_seconds: float | None = None, steps: int = STEPS
) -> Recordings:
    """Return three random recordings of a fingertip, with a label each."""
    spikes = np.random.default_rng(1).integers(0, 2, size=(3, steps, CHANNELS), dtype=np.uint8)
    source = "synthetic touches" if origin == "made up" else "a.npz"
    return Recordings(spikes, np.arange(3), step_seconds, source, origin)


def save_model(path: Path, *, step_seconds: float | None = 0.02, **entries: Any) -> Path:
    """Write the checkpoint of a small network with further ``entries``, and return its path."""
    description = NetworkDescription(
        "tactile-snn",
        InputLayout(neutouch(1), steps=STEPS, step_seconds=step_seconds),
        classes=3,
        hidden=4,
        name="small",
    )
    # Without negative weights, neurons spike.
    weights = {name: np.abs(w) for name, w in build_network(description, seed=1).weights().items()}
    Checkpoint(description, weights, **entries).save(path)
    return path


@pytest.fixture
def network(tmp_path: Path) -> Network:
    """A network that was read from a file, with an assumption about something that the file left open."""
    network = lc.load(save_model(tmp_path / "m.pt"))
    return replace(network, assumptions=("The file left this open.",))


REGISTERS = hw.chip("loihi-sim").registers
GIVEN = random_recordings()
OTHERS = random_recordings()
"""Equal recordings, but another object: calibration on them is not calibration on those of the check."""


@pytest.mark.parametrize(
    ("recordings", "calibration", "model_step_seconds", "sentences"),
    [
        pytest.param(GIVEN, OTHERS, 0.02, (), id="nothing"),
        pytest.param(
            GIVEN,
            GIVEN,
            0.02,
            (calibrated("the recordings of the check itself"),),
            id="the same twice",
        ),
        pytest.param(
            GIVEN,
            random_recordings("made up"),
            0.02,
            (calibrated("3 made-up recordings (synthetic touches)"),),
            id="calibrated on made-up ones",
        ),
        pytest.param(
            GIVEN,
            random_recordings("carried"),
            0.02,
            (calibrated("3 recordings that the model carries"),),
            id="calibrated on the model's own",
        ),
        pytest.param(random_recordings("made up"), OTHERS, 0.02, (MADE_UP,), id="made up"),
        pytest.param(random_recordings("trained on"), OTHERS, 0.02, (TRAINED_ON,), id="trained on"),
        pytest.param(random_recordings("carried"), OTHERS, 0.02, (), id="of the test part"),
        pytest.param(GIVEN, OTHERS, None, (NO_STEP,), id="no step"),
        pytest.param(
            random_recordings(step_seconds=0.01),
            OTHERS,
            None,
            (STEP_OF_BINS,),
            id="the step of the bins",
        ),
        pytest.param(
            random_recordings("made up", 0.01),
            OTHERS,
            None,
            (MADE_UP, NO_STEP),
            id="made-up bins say no step",
        ),
        pytest.param(random_recordings(steps=30), OTHERS, 0.02, (SILENCE,), id="shorter"),
        pytest.param(
            replace(GIVEN, binned=Binned(threshold=None, events=9, outside=0, below=0)),
            OTHERS,
            0.02,
            (),
            id="bins were given",
        ),
        pytest.param(
            replace(GIVEN, binned=Binned(threshold=2, events=9, outside=0, below=0)),
            OTHERS,
            0.02,
            (THRESHOLD,),
            id="a usual threshold",
        ),
    ],
)
def test_every_assumption_stands_and_no_other(
    network: Network,
    recordings: Recordings,
    calibration: Recordings,
    model_step_seconds: float | None,
    sentences: tuple[str, ...],
) -> None:
    network = replace(network, step_seconds=model_step_seconds)
    grounds = grounds_of(network, recordings, calibration, REGISTERS)
    assert grounds.assumptions == ("The file left this open.", *sentences)


def test_weights_that_round_alike_for_any_recordings_are_not_called_calibrated(
    tmp_path: Path,
) -> None:
    """Neurons of windows count events. No strategy lowers them, so each of their weights is rounded alone."""
    file = tmp_path / "windows.pt"
    layout = InputLayout(neutouch(1), steps=STEPS, step_seconds=0.02)
    windows = WindowParameters(steps=8, stride=8, levels=(1,))
    # All taxels of the fingertip, numbered from 1.
    order = tuple(range(1, 40))
    description = NetworkDescription(
        "window-snn",
        layout,
        classes=3,
        window=windows,
        location_order="own",
        location_taxels=order,
        name="windows",
    )
    Checkpoint(description, build_network(description, seed=1).weights()).save(file)
    network = lc.load(file)
    assert (network.has_float_weights, network.by_strategy) == (True, False)
    without_calibration = lc.compile(network, events=GIVEN, diagnosis=False)
    with_calibration = lc.compile(
        network, events=GIVEN, calibration=random_recordings(), diagnosis=False
    )
    assert without_calibration.files()["program.npz"] == with_calibration.files()["program.npz"]
    made_up = random_recordings("made up")
    assert grounds_of(network, GIVEN, made_up, REGISTERS).assumptions == ()


@pytest.mark.slow
@pytest.mark.parametrize("in_committee", [False, True], ids=["by itself", "in a committee"])
def test_registers_other_than_those_of_the_training_are_named(in_committee: bool) -> None:
    shipped = Path(__file__).parents[2] / "examples/models"
    network = lc.load(shipped / "objects-hybrid-loihi.pt")
    model = [network, network] if in_committee else network
    recordings = np.random.default_rng(2).integers(
        0, 2, size=(2, network.steps, CHANNELS), dtype=np.uint8
    )
    chip = hw.chip("loihi-sim")
    narrow = replace(chip, name="narrow", registers=replace(chip.registers, voltage_bits=20))
    sentence = (
        "The network was trained in the integers of loihi-sim, whose registers of charge, current and voltage have 21, 23 "
        "and 23 bits. Those of this chip have 21, 23 and 20: what is called as trained wraps and clips like them, not as "
        "in the training."
    )
    for target, sentences in ((narrow, [sentence]), (chip, [])):
        report = lc.compile(model, target, events=recordings, diagnosis=False).report
        on_integers = [line for line in report["assumptions"] if "integers" in line]
        assert on_integers == sentences
    assert lc.load(shipped / "objects-hybrid.pt").trained_on == {}


def sensor_times(value: object, key: str = "") -> dict[str, object]:
    """Return the figures of a report that depend on how long a step lasts at the sensor, by dotted keys."""
    if isinstance(value, dict):
        times: dict[str, object] = {}
        for name, item in value.items():
            times |= sensor_times(item, f"{key}.{name}")
        return times
    last_name = key.rpartition(".")[2]
    is_sensor_time = "real_time" in key or last_name in ("recording_ns", "step_seconds")
    return {key: value} if is_sensor_time else {}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("model_step_seconds", "events_step_seconds", "is_known"),
    [
        pytest.param(None, None, False, id="nobody says it"),
        pytest.param(0.02, None, True, id="the model says it"),
        pytest.param(None, 0.02, True, id="the recordings say it"),
    ],
)
def test_seconds_and_pace_only_where_a_step_is_known(
    model_step_seconds: float | None,
    events_step_seconds: float | None,
    is_known: bool,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    model = save_model(tmp_path / "m.pt", step_seconds=model_step_seconds)
    spikes = np.random.default_rng(1).integers(0, 2, size=(3, CHANNELS, STEPS), dtype=np.uint8)
    arrays: dict[str, Any] = {"spikes": spikes}
    if events_step_seconds is not None:
        arrays["step_seconds"] = events_step_seconds
    events = tmp_path / "a.npz"
    np.savez(events, **arrays)
    out = tmp_path / "out"
    assert main([str(model), "--events", str(events), "-o", str(out), "--emit", "csv"]) == 0
    report = json.loads((out / "report.json").read_text())
    times = sensor_times(report)
    assert len(times) >= 3
    assert all((value is not None) == is_known for value in times.values()), times
    assert (NO_STEP in report["assumptions"]) == (not is_known)
    terminal = " ".join(capsys.readouterr().out.split())
    markdown = (out / "report.md").read_text()
    # Options are in <code>, and spaces before units do not break.
    page = re.sub("</?code>", "", (out / "report.html").read_text()).replace("&nbsp;", " ")
    for text in (terminal, markdown, page, (out / "csv/figures.csv").read_text()):
        for sentence in report["assumptions"]:
            escaped = sentence.replace("'", "&#x27;")
            assert escaped in text or sentence in text
    for text in (terminal, markdown, page):
        assert ("recorded" in text and "times faster than" in text) == is_known


def test_a_nir_graph_of_no_step_has_no_pace_and_says_what_was_taken(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    ones = np.ones(2)
    graph = nir.NIRGraph(
        {
            "input": nir.Input(np.array([3])),
            "w": nir.Linear(np.full((2, 3), 0.5)),
            "out": nir.LIF(
                tau=1e-3 * ones, r=10 * ones, v_leak=0 * ones, v_threshold=ones, v_reset=0 * ones
            ),
            "output": nir.Output(np.array([2])),
        },
        [("input", "w"), ("w", "out"), ("out", "output")],
        type_check=False,
    )
    nir.write(tmp_path / "g.nir", graph)
    arguments = [str(tmp_path / "g.nir"), "-o", str(tmp_path / "out")]
    assert main(arguments) == 0
    output = capsys.readouterr().out
    made_up = MADE_UP.replace("synthetic touches", "synthetic spikes, 5 % per step")
    report = json.loads((tmp_path / "out/report.json").read_text())
    network = lc.load(tmp_path / "g.nir")
    assert report["assumptions"] == [*network.assumptions, made_up, NO_STEP]
    assert len(network.assumptions) == 3
    assert (report["latency"]["recording_ns"], report["latency"]["real_time"]) == (None, None)
    assert "times faster" not in output
    # With these options nothing of the graph is left open, but the step of recordings is still unknown.
    assert main([*arguments, "--dt", "1e-4", "--reset", "zero", "--discretisation", "euler"]) == 0
    report = json.loads((tmp_path / "out/report.json").read_text())
    assert report["assumptions"] == [made_up, NO_STEP]
    capsys.readouterr()
    assert main([*arguments, "--step-seconds", "1e-4"]) == 0
    assert "times faster than the 10.0 ms recorded" in " ".join(capsys.readouterr().out.split())


def test_recordings_that_a_network_was_trained_on_are_told_from_others(tmp_path: Path) -> None:
    for test_recordings, origin in ((None, "trained on"), (3, "carried")):
        model = save_model(
            tmp_path / "m.pt",
            recordings=random_recordings(),
            training={"test_recordings": test_recordings},
        )
        report = lc.compile(lc.load(model), diagnosis=False).report
        assert report["match"]["events_origin"] == origin
        assert (TRAINED_ON in report["assumptions"]) == (origin == "trained on")


def test_time_is_of_the_profile_that_says_what_it_rests_on(network: Network) -> None:
    report = lc.compile(network, events=GIVEN, diagnosis=False).report
    assert report["latency"]["basis"] == report["energy"]["basis"]
    assert "pre-silicon simulation" in report["latency"]["basis"]


def test_made_up_recordings_have_the_step_of_the_model_or_none() -> None:
    # Touches for the channels of a fingertip, random spikes for others.
    for channels in (CHANNELS, 5):
        assert synthetic_recordings(channels, STEPS, step_seconds=None).step_seconds is None
        assert synthetic_recordings(channels, STEPS, 0.5).step_seconds == 0.5
