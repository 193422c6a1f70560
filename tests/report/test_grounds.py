"""What a report rests on: the step and the assumptions, as data from where they were made to every rendering."""

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


def calibrated(on: str) -> str:
    return f"The program was calibrated on {on}: its weights and settings suit these. Give others with --calibration."


def played(
    origin: Origin = "given", step_seconds: float | None = None, steps: int = 40
) -> Recordings:
    """Three random recordings of a fingertip, with a label each."""
    spikes = np.random.default_rng(1).integers(0, 2, size=(3, steps, 78), dtype=np.uint8)
    source = "synthetic touches" if origin == "made up" else "a.npz"
    return Recordings(spikes, np.arange(3), step_seconds, source, origin)


def saved(path: Path, *, step_seconds: float | None = 0.02, **more: Any) -> Path:
    description = NetworkDescription(
        "tactile-snn",
        InputLayout(neutouch(1), steps=40, step_seconds=step_seconds),
        classes=3,
        hidden=4,
        name="small",
    )
    weights = {name: np.abs(w) for name, w in build_network(description, seed=1).weights().items()}
    Checkpoint(description, weights, **more).save(path)
    return path


@pytest.fixture
def network(tmp_path: Path) -> Network:
    """A saved network that was read again, and whose file left something open."""
    return replace(lc.load(saved(tmp_path / "m.pt")), assumptions=("The file left this open.",))


REGISTERS = hw.chip("loihi-sim").registers
GIVEN = played()
RAISED = np.random.default_rng(2).integers(0, 2, size=(2, 250, 78), dtype=np.uint8)
OTHERS = played()


@pytest.mark.parametrize(
    ("recordings", "calibration", "step", "wanted"),
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
            played("made up"),
            0.02,
            (calibrated("3 made-up recordings (synthetic touches)"),),
            id="calibrated on made-up ones",
        ),
        pytest.param(
            GIVEN,
            played("carried"),
            0.02,
            (calibrated("3 recordings that the model carries"),),
            id="calibrated on the model's own",
        ),
        pytest.param(played("made up"), OTHERS, 0.02, (MADE_UP,), id="made up"),
        pytest.param(played("trained on"), OTHERS, 0.02, (TRAINED_ON,), id="trained on"),
        pytest.param(played("carried"), OTHERS, 0.02, (), id="of the test part"),
        pytest.param(GIVEN, OTHERS, None, (NO_STEP,), id="no step"),
        pytest.param(
            played(step_seconds=0.01), OTHERS, None, (STEP_OF_BINS,), id="the step of the bins"
        ),
        pytest.param(
            played("made up", 0.01), OTHERS, None, (MADE_UP, NO_STEP), id="made-up bins say no step"
        ),
        pytest.param(played(steps=30), OTHERS, 0.02, (SILENCE,), id="shorter"),
        pytest.param(
            replace(GIVEN, binned=Binned(None, 9, 0, 0)), OTHERS, 0.02, (), id="bins were given"
        ),
        pytest.param(
            replace(GIVEN, binned=Binned(2, 9, 0, 0)),
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
    step: float | None,
    wanted: tuple[str, ...],
) -> None:
    found = grounds_of(replace(network, step_seconds=step), recordings, calibration, REGISTERS)
    assert found.assumptions == ("The file left this open.", *wanted)


def test_weights_that_round_alike_for_any_recordings_are_not_called_calibrated(
    tmp_path: Path,
) -> None:
    file = tmp_path / "windows.pt"
    layout, windows = (
        InputLayout(neutouch(1), steps=40, step_seconds=0.02),
        WindowParameters(steps=8, stride=8, levels=(1,)),
    )
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
    programs = [
        lc.compile(network, events=GIVEN, calibration=given, diagnosis=False).files()["program.npz"]
        for given in (None, played(steps=40))
    ]
    assert programs[0] == programs[1]
    assert grounds_of(network, GIVEN, played("made up"), REGISTERS).assumptions == ()


@pytest.mark.slow
@pytest.mark.parametrize("joined", [False, True], ids=["by itself", "in a committee"])
def test_registers_other_than_those_of_the_training_are_named(joined: bool, tmp_path: Path) -> None:
    shipped = Path(__file__).parents[2] / "examples/models"
    network = lc.load(shipped / "objects-hybrid-loihi.pt")
    given = [network, network] if joined else network
    chip = hw.chip("loihi-sim")
    narrow = replace(chip, name="narrow", registers=replace(chip.registers, voltage_bits=20))
    said = (
        "The network was trained in the integers of loihi-sim, whose registers of charge, current and voltage have 21, 23 "
        "and 23 bits. Those of this chip have 21, 23 and 20: what is called as trained wraps and clips like them, not as "
        "in the training."
    )
    for target, wanted in ((narrow, [said]), (chip, [])):
        report = lc.compile(given, target, events=RAISED, diagnosis=False).report
        assert [one for one in report["assumptions"] if "integers" in one] == wanted
    assert lc.load(shipped / "objects-hybrid.pt").trained_on == {}


def in_seconds(value: object, key: str = "") -> dict[str, object]:
    """Return what a report says of seconds that passed at a sensor, by dotted keys."""
    if isinstance(value, dict):
        rows = [in_seconds(item, f"{key}.{name}") for name, item in value.items()]
        return {name: item for row in rows for name, item in row.items()}
    last = key.rpartition(".")[2]
    return {key: value} if "real_time" in key or last in ("recording_ns", "step_seconds") else {}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("of_model", "of_events", "known"),
    [
        pytest.param(None, None, False, id="nobody says it"),
        pytest.param(0.02, None, True, id="the model says it"),
        pytest.param(None, 0.02, True, id="the recordings say it"),
    ],
)
def test_seconds_and_pace_only_where_a_step_is_known(
    of_model: float | None,
    of_events: float | None,
    known: bool,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    model = saved(tmp_path / "m.pt", step_seconds=of_model)
    array = np.random.default_rng(1).integers(0, 2, size=(3, 78, 40), dtype=np.uint8)
    np.savez(
        tmp_path / "a.npz",
        spikes=array,
        **({} if of_events is None else {"step_seconds": of_events}),
    )
    out = tmp_path / "out"
    assert (
        main([str(model), "--events", str(tmp_path / "a.npz"), "-o", str(out), "--emit", "csv"])
        == 0
    )
    report = json.loads((out / "report.json").read_text())
    times = in_seconds(report)
    assert len(times) >= 3
    assert all((value is not None) == known for value in times.values()), times
    assert (NO_STEP in report["assumptions"]) == (not known)
    shown = [
        " ".join(capsys.readouterr().out.split()),
        *(
            re.sub("</?code>", "", (out / f"report.{kind}").read_text()).replace("&nbsp;", " ")
            for kind in ("md", "html")
        ),
    ]
    for text in (*shown, (out / "csv/figures.csv").read_text()):
        assert all(
            sentence.replace("'", "&#x27;") in text or sentence in text
            for sentence in report["assumptions"]
        )
    for text in shown:
        assert ("recorded" in text and "times faster than" in text) == known


def test_a_nir_graph_of_no_step_has_no_pace_and_says_what_was_taken(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    one = np.ones(2)
    graph = nir.NIRGraph(
        {
            "input": nir.Input(np.array([3])),
            "w": nir.Linear(np.full((2, 3), 0.5)),
            "out": nir.LIF(
                tau=1e-3 * one, r=10 * one, v_leak=0 * one, v_threshold=one, v_reset=0 * one
            ),
            "output": nir.Output(np.array([2])),
        },
        [("input", "w"), ("w", "out"), ("out", "output")],
        type_check=False,
    )
    nir.write(tmp_path / "g.nir", graph)
    model = [str(tmp_path / "g.nir"), "-o", str(tmp_path / "out")]
    assert main(model) == 0
    unknown = capsys.readouterr().out
    made_up = MADE_UP.replace("synthetic touches", "synthetic spikes, 5 % per step")
    report = json.loads((tmp_path / "out/report.json").read_text())
    network = lc.load(tmp_path / "g.nir")
    assert report["assumptions"] == [*network.assumptions, made_up, NO_STEP]
    assert len(network.assumptions) == 3
    assert (report["latency"]["recording_ns"], report["latency"]["real_time"]) == (None, None)
    assert "times faster" not in unknown
    assert main([*model, "--dt", "1e-4", "--reset", "zero", "--discretisation", "euler"]) == 0
    report = json.loads((tmp_path / "out/report.json").read_text())
    assert report["assumptions"] == [made_up, NO_STEP]
    capsys.readouterr()
    assert main([*model, "--step-seconds", "1e-4"]) == 0
    assert "times faster than the 10.0 ms recorded" in " ".join(capsys.readouterr().out.split())


def test_recordings_that_a_network_was_trained_on_are_told_from_others(tmp_path: Path) -> None:
    for test_recordings, said in ((None, True), (3, False)):
        model = saved(
            tmp_path / "m.pt", recordings=played(), training={"test_recordings": test_recordings}
        )
        report = lc.compile(lc.load(model), diagnosis=False).report
        assert (TRAINED_ON in report["assumptions"]) == said
        assert report["match"]["events_origin"] == ("trained on" if said else "carried")


def test_time_is_of_the_profile_that_says_what_it_rests_on(network: Network) -> None:
    report = lc.compile(network, events=GIVEN, diagnosis=False).report
    assert report["latency"]["basis"] == report["energy"]["basis"]
    assert "pre-silicon simulation" in report["latency"]["basis"]


def test_made_up_recordings_have_the_step_of_the_model_or_none() -> None:
    for channels in (78, 5):
        assert [synthetic_recordings(channels, 40, step).step_seconds for step in (None, 0.5)] == [
            None,
            0.5,
        ]
