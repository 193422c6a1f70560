"""How recordings become steps: what models and programs state, what options set, and which options are refused.

Recordings of events at known times are written here, so that the number of events in, before and after the steps is
known.
"""

from __future__ import annotations

import json
from argparse import Namespace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
import yaml

import hw_model as hw
from locsnn_compile.cli import compile as compile_command
from locsnn_compile.cli.main import main as locsnn
from locsnn_compile.cli.step_options import expected_by, read_for_program
from locsnn_compile.data.read import read_recordings
from locsnn_compile.models.checkpoint_reader import read_checkpoint

Capture = pytest.CaptureFixture[str]
STEPS = 36
EVENTS = 427
"""Events of every recording here: any number that shows again where events are counted."""


def slip_file(path: Path, seed: int, steps: int = STEPS, events: int = EVENTS) -> Path:
    """Write a recording of so many events in bins of 1 ms, the first at 0 s and the last in the last bin."""
    rng = np.random.default_rng(seed)
    ms = np.sort(rng.uniform(0, steps, events))
    ms[[0, -1]] = 0, steps - 0.5
    cells = rng.integers(1, 17, events)
    path.write_text(
        "".join(
            f"{i % 2} {cell} {t / 1000:.6f}\n"
            for i, (cell, t) in enumerate(zip(cells, ms, strict=True))
        )
    )
    return path


@pytest.fixture(scope="module")
def slip(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of recordings, a network trained on them in steps of 1 ms, and its program."""
    folder = tmp_path_factory.mktemp("slip")
    (folder / "data").mkdir()
    for i in range(6):
        slip_file(folder / "data" / f"{i}_label_{i % 2}.tact", i)
    slip_file(folder / "x.tact", 9)
    train = [
        "--epochs",
        "1",
        "--hidden",
        "4",
        "--model",
        "tactile-snn",
        "--quiet",
        "-o",
        str(folder / "slip.pt"),
    ]
    assert (
        main(["train", "--data", str(folder / "data"), "--step-seconds", "0.001", *train])
        in TRAINED
    )
    options = ["-o", str(folder / "out"), "--quiet", "--strategy", "dendrite"]
    assert (
        main(["compile", str(folder / "slip.pt"), "--events", str(folder / "x.tact"), *options])
        == 0
    )
    return folder


TRAINED = (0, 3)
"""Exit codes of training: a run of so few epochs may learn nothing, which exits with 3."""


def main(arguments: list[str]) -> int:
    """Run either command."""
    compiles = arguments[0] == "compile"
    return compile_command.main(arguments[1:]) if compiles else locsnn(arguments)


def options(**changed: Any) -> Namespace:
    """Return the parsed options on reading, as they are if only the ``changed`` ones were typed."""
    return Namespace(
        **{
            "step_seconds": None,
            "steps": None,
            "threshold": None,
            "axes": None,
            "split": None,
            "fold": None,
            "grid": None,
            "layout": None,
            "channels": None,
            "polarities": None,
            "columns": None,
            "merge_polarities": None,
            "only_taxels": None,
            "only_polarity": None,
            "merge_channels": None,
            "channel_order": None,
            "classes": None,
            "start": None,
            "time_unit": None,
            "max_steps": None,
        }
        | changed
    )


def test_a_checkpoint_and_its_program_keep_the_steps(slip: Path) -> None:
    layout = read_checkpoint(slip / "slip.pt").description.input
    assert (layout.steps, layout.step_seconds, layout.event_threshold) == (STEPS, 0.001, 0)
    program = hw.load_program(slip / "out")
    assert (program.step_seconds, program.event_threshold) == (0.001, 0)
    recordings = read_for_program(options(), str(slip / "x.tact"), program)
    assert (recordings.spikes.shape, recordings.step_seconds) == ((1, STEPS, 156), 0.001)
    report = json.loads((slip / "out" / "report.json").read_text())
    assert report["skipped"]["binning"] == {
        "threshold": 0,
        "events": EVENTS,
        "outside": 0,
        "below": 0,
        "elsewhere": 0,
        "dropped": 0,
        "words": f"0 of {EVENTS} events dropped: 0 outside the steps, 0 in bins of at most 0",
    }


def test_run_plays_what_compile_checked(slip: Path, capsys: Capture) -> None:
    assert main(["run", str(slip / "out"), "--events", str(slip / "x.tact"), "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    report = json.loads((slip / "out" / "report.json").read_text())
    assert document["counts"]["input_events"] == report["operations"]["per_sample"]["input_events"]
    assert document["counts"]["input_events"] == int(
        read_recordings(slip / "x.tact", step_seconds=0.001).spikes.sum()
    )
    assert document["binning"] == {
        "threshold": 0,
        "events": EVENTS,
        "outside": 0,
        "below": 0,
        "elsewhere": 0,
        "dropped": 0,
    }
    assert main(["run", str(slip / "out"), "--events", str(slip / "x.tact")]) == 0
    last = capsys.readouterr().out.splitlines()[-1]
    assert (
        last
        == f"binning: 0 of {EVENTS} events dropped: 0 outside the steps, 0 in bins of at most 0"
    )


def test_a_recording_that_is_too_long_is_cut(slip: Path, tmp_path: Path, capsys: Capture) -> None:
    long = slip_file(tmp_path / "long.tact", 3, steps=2 * STEPS)
    seconds = np.array([float(line.split()[2]) for line in long.read_text().splitlines()])
    late = int((seconds >= STEPS * 0.001).sum())
    assert late > 100  # about half of the events come after the steps of the model
    words = f"{late} of {EVENTS} events dropped: {late} outside the steps, 0 in bins of at most 0"
    assert main(["run", str(slip / "out"), "--events", str(long)]) == 0
    assert capsys.readouterr().out.splitlines()[-1] == f"binning: {words}"
    compile = ["compile", str(slip / "slip.pt"), "--events", str(long), "-o", str(tmp_path / "out")]
    assert main([*compile, "--strategy", "dendrite"]) == 0
    assert f"! Binning left events out. {words}." in " ".join(capsys.readouterr().out.split())


def test_a_configuration_file_sets_the_steps(slip: Path, tmp_path: Path) -> None:
    (tmp_path / "c.yaml").write_text(
        "model: tactile-snn\nhidden: 4\nepochs: 1\nstep_seconds: 0.002\nsteps: 20\nevent_threshold: 1\n"
    )
    data = ["--data", str(slip / "data"), "--config", str(tmp_path / "c.yaml")]
    assert main(["train", *data, "--quiet", "-o", str(tmp_path / "c.pt")]) in TRAINED
    layout = read_checkpoint(tmp_path / "c.pt").description.input
    assert (layout.steps, layout.step_seconds, layout.event_threshold) == (20, 0.002, 1)
    assert (
        main(["train", *data, "--threshold", "0", "--quiet", "-o", str(tmp_path / "d.pt")])
        in TRAINED
    )
    assert read_checkpoint(tmp_path / "d.pt").description.input.event_threshold == 0


@pytest.mark.parametrize(
    ("command", "given", "message"),
    [
        (
            ["run", "{}/out", "--events", "{}/x.tact"],
            ["--step-seconds", "0.02"],
            "step_seconds: program 'slip' has another (got 0.02 against 0.001). Leave it out.",
        ),
        (
            ["run", "{}/out", "--events", "{}/x.tact"],
            ["--steps", "40"],
            "steps: program 'slip' has another (got 40 against 36). Leave it out.",
        ),
        (
            ["run", "{}/out", "--events", "{}/x.tact"],
            ["--threshold", "1"],
            "threshold: program 'slip' has another (got 1 against 0). Leave it out.",
        ),
        (
            [
                "run",
                "{}/out",
                "--events",
                "{}/x.tact",
                "--stop",
                "margin",
                "--calibrate",
                "{}/binned.npz",
            ],
            [],
            "recordings 'binned.npz': their steps are not as long as those of program 'slip' (0.02 s against 0.001 s). "
            "Give recordings that were binned for it, or their single events.",
        ),
        (
            ["run", "{}/out", "--events", "{}/binned.npz"],
            [],
            "recordings 'binned.npz': their steps are not as long as those of program 'slip' (0.02 s against 0.001 s). "
            "Give recordings that were binned for it, or their single events.",
        ),
        (
            ["run", "{}/out", "--events", "{}/bare.npz"],
            ["--threshold", "0"],
            "threshold: 'bare.npz' holds bins, not single events to count. Leave it out.",
        ),
        (
            ["run", "{}/out", "--events", "{}/bare.npz"],
            ["--step-seconds", "0.001"],
            "--step-seconds: nothing requested is timed. Add --stream.",
        ),
        (
            ["compile", "{}/slip.pt", "--quiet", "-o", "{}/never", "--events", "{}/x.tact"],
            ["--step-seconds", "0.02"],
            "step_seconds: model 'slip' has another (got 0.02 against 0.001). Leave it out.",
        ),
        (
            ["compile", "{}/slip.pt", "--quiet", "-o", "{}/never"],
            ["--threshold", "2"],
            "threshold: model 'slip' has another (got 2 against 0). Leave it out.",
        ),
        (
            ["compile", "{}/slip.pt", "--quiet", "-o", "{}/never"],
            ["--steps", "35"],
            "steps: model 'slip' has another (got 35 against 36). Leave it out.",
        ),
        (
            ["compile", "{}/slip.pt", "--quiet", "-o", "{}/never", "--events", "{}/binned.npz"],
            [],
            "recordings 'binned.npz': their steps are not as long as those of model 'slip' (0.02 s against 0.001 s). "
            "Give recordings that were binned for it, or their single events.",
        ),
        (
            ["train", "--from", "{}/slip.pt", "--data", "{}/data", "-o", "{}/never.pt"],
            ["--step-seconds", "0.02"],
            "step_seconds: the network to start from has another (got 0.02 against 0.001). Leave it out.",
        ),
        (
            ["train", "--from", "{}/slip.pt", "--data", "{}/data", "-o", "{}/never.pt"],
            ["--threshold", "1"],
            "threshold: the network to start from has another (got 1 against 0). Leave it out.",
        ),
        (
            ["train", "--data", "{}/binned.npz", "-o", "{}/never.pt"],
            ["--step-seconds", "0.001"],
            "step_seconds: file 'binned.npz' holds bins of another width (got 0.001 against 0.02). Leave it out.",
        ),
        (
            ["events", "{}/binned.npz"],
            ["--step-seconds", "0.5"],
            "step_seconds: file 'binned.npz' holds bins of another width (got 0.5 against 0.02). Leave it out.",
        ),
    ],
    ids=lambda value: " ".join(value[:1]) if isinstance(value, list) else None,
)
def test_what_contradicts_is_refused(
    slip: Path, command: list[str], given: list[str], message: str, capsys: Capture
) -> None:
    spikes = np.zeros((2, 156, STEPS), dtype=np.uint8)
    np.savez(slip / "binned.npz", spikes=spikes, labels=[0, 1], step_seconds=0.02)
    np.savez(slip / "bare.npz", spikes=spikes, labels=[0, 1])
    typed = [word.format(slip) for word in command]
    for word in typed:
        message = message.replace(f"recordings {Path(word).name!r}", f"recordings {word!r}")
    assert main([*typed, *given]) == 2
    assert capsys.readouterr() == ("", f"{message}\n")
    assert not (slip / "never").exists()
    assert not (slip / "never.pt").exists()


def test_equal_options_change_nothing(slip: Path, capsys: Capture) -> None:
    play = ["run", str(slip / "out"), "--events", str(slip / "x.tact"), "--json"]
    assert main(play) == 0
    plain = capsys.readouterr().out
    assert main([*play, "--step-seconds", "1e-3", "--steps", "36", "--threshold", "0"]) == 0
    assert capsys.readouterr().out == plain


def test_fine_tuning_bins_as_its_start_did(slip: Path, tmp_path: Path) -> None:
    start = [
        "--data",
        str(slip / "data"),
        "--from",
        str(slip / "slip.pt"),
        "--epochs",
        "1",
        "--quiet",
    ]
    assert main(["train", *start, "-o", str(tmp_path / "next.pt")]) in TRAINED
    layout_of_start = read_checkpoint(slip / "slip.pt").description.input
    assert read_checkpoint(tmp_path / "next.pt").description.input == layout_of_start


def test_programs_from_before_take_the_steps_from_options(
    slip: Path, tmp_path: Path, capsys: Capture
) -> None:
    old = tmp_path / "old"
    old.mkdir()
    document = yaml.safe_load((slip / "out" / "program.yaml").read_text())
    assert (document.pop("step_seconds"), document.pop("event_threshold")) == (0.001, 0)
    (old / "program.yaml").write_text(yaml.safe_dump(document, sort_keys=False))
    (old / "program.npz").write_bytes((slip / "out" / "program.npz").read_bytes())
    program = hw.load_program(old)
    assert (program.step_seconds, program.event_threshold) == (None, None)
    expected = expected_by(program)
    assert (expected.step_seconds, expected.threshold, expected.steps, expected.channels) == (
        None,
        None,
        STEPS,
        156,
    )
    play = ["--events", str(slip / "x.tact"), "--json"]
    assert main(["run", str(old), *play, "--step-seconds", "0.001"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert main(["run", str(slip / "out"), *play]) == 0
    assert document == json.loads(capsys.readouterr().out)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("step_seconds", 0),
        ("step_seconds", "0.02"),
        ("event_threshold", -1),
        ("event_threshold", 0.5),
    ],
)
def test_entries_that_are_no_steps(slip: Path, tmp_path: Path, name: str, value: object) -> None:
    document = yaml.safe_load((slip / "out" / "program.yaml").read_text()) | {name: value}
    (tmp_path / "program.yaml").write_text(yaml.safe_dump(document, sort_keys=False))
    (tmp_path / "program.npz").write_bytes((slip / "out" / "program.npz").read_bytes())
    with pytest.raises(hw.InputError) as caught:
        hw.load_program(tmp_path)
    assert str(caught.value) == "program.yaml: its entries do not make a program. Compile again."


def test_a_checkpoint_of_bins_says_nothing_of_a_threshold(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    np.savez(
        tmp_path / "a.npz",
        spikes=rng.random((4, 78, 20)) < 0.2,
        labels=[0, 1, 0, 1],
        step_seconds=0.001,
    )
    train = [
        "train",
        "--data",
        str(tmp_path / "a.npz"),
        "--epochs",
        "1",
        "--hidden",
        "4",
        "--quiet",
    ]
    assert main([*train, "-o", str(tmp_path / "a.pt")]) == 0
    entry = torch.load(tmp_path / "a.pt", weights_only=True)["input"]
    assert entry == {
        "fingertips": 1,
        "steps": 20,
        "step_seconds": 0.001,
        "taxels": 39,
        "polarities": 2,
    }


def test_what_binning_drops_is_shown(slip: Path, capsys: Capture) -> None:
    def binned(*given: str) -> tuple[dict[str, Any], str]:
        assert (
            main(["events", str(slip / "x.tact"), "--step-seconds", "0.001", *given, "--json"]) == 0
        )
        document = json.loads(capsys.readouterr().out)["binning"]
        assert main(["events", str(slip / "x.tact"), "--step-seconds", "0.001", *given]) == 0
        return document, next(
            line for line in capsys.readouterr().out.splitlines() if line.startswith("binning")
        )

    usual, line = binned()
    assert usual == {
        "threshold": 0,
        "events": EVENTS,
        "outside": 0,
        "below": 0,
        "elsewhere": 0,
        "dropped": 0,
    }
    assert (
        line
        == f"binning           0 of {EVENTS} events dropped: 0 outside the steps, 0 in bins of at most 0"
    )
    strict, line = binned("--threshold", "1")
    # 427 events in 36 steps of 156 channels are mostly alone in their bin.
    assert strict["below"] > 0.6 * EVENTS
    assert line == (
        f"binning           {strict['below']} of {EVENTS} events dropped: 0 outside the steps, "
        f"{strict['below']} in bins of at most 1"
    )
