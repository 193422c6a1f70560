"""Recordings of any sensor, from ``locsnn train`` to the report: layouts, axes, class names, lengths, gaps, silence.

Synthetic touches of grids and of sensors without positions are trained on for one epoch and compiled. What is known of
the sensor must come back from the checkpoint, the report and the program as it was written into the files here.
"""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import hw_model as hw
import locsnn_compile as lc
from locsnn_compile.cli.compile import main as compile_main
from locsnn_compile.cli.main import main as locsnn_main
from locsnn_compile.cli.step_options import expected_by
from locsnn_compile.data import write_recordings
from locsnn_compile.data.sensor import SensorLayout, asked_layout
from locsnn_compile.data.synthetic import synthetic_touches
from locsnn_compile.models.checkpoint_reader import read_checkpoint

Capture = pytest.CaptureFixture[str]
NAMES = ("press", "slide", "twist")


def grid_layout(text: str, polarities: int) -> SensorLayout:
    """Return the layout of a grid such as ``4x5``, in columns and rows."""
    layout = asked_layout(text, polarities, channels=None, layout=None)
    assert layout is not None
    return layout


GRID = grid_layout("4x5", 2)


@pytest.fixture(autouse=True)
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Run every test in a folder of its own, so that files need no paths."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


def write(
    sensor: SensorLayout, name: str = "a.npz", *, step_major: bool = False, **more: object
) -> str:
    """Write synthetic touches of a sensor, with labels and class names, and return the file's name."""
    touches = synthetic_touches(6, steps=20, classes=3, sensor=sensor)
    spikes = touches.spikes if step_major else touches.spikes.transpose(0, 2, 1)
    np.savez(name, **{"spikes": spikes, "labels": touches.labels, "class_names": NAMES} | more)  # type: ignore[arg-type]
    return name


def train(data: str, *options: str, output: str = "a.pt") -> int:
    """Return the exit code, 0 where the run was too short to learn: that is not what is tested here."""
    usual = ("--epochs", "1", "--defaults", "fixed", "--quiet")
    code = locsnn_main(["train", "--data", data, *usual, "-o", output, *options])
    return 0 if code == 3 else code


def compiled(*options: str, model: str = "a.pt") -> dict:
    """Compile a model in this folder, and return the report."""
    assert compile_main([model, "--quiet", "-o", "built", *options]) == 0
    return json.loads(Path("built/report.json").read_text("utf-8"))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("sensor", "options"),
    [
        pytest.param(SensorLayout("8 channels", taxels=8), ("--channels", "8"), id="8 channels"),
        pytest.param(GRID, ("--grid", "4x5", "--order", "snake"), id="40 channels"),
        pytest.param(
            grid_layout("16x16", 2), ("--grid", "16x16", "--order", "hilbert"), id="512 channels"
        ),
        pytest.param(
            grid_layout("32x32", 2),
            ("--grid", "32x32", "--order", "spiral", "--hidden", "4"),
            id="2048 channels",
            marks=pytest.mark.minutes,
        ),
    ],
)
def test_recordings_of_a_sensor_train_and_compile(
    sensor: SensorLayout, options: tuple[str, ...]
) -> None:
    data = write(sensor)
    assert train(data, *options) == 0
    layout = read_checkpoint("a.pt").description.input.sensor
    assert (layout.name, layout.channels) == (sensor.name, sensor.channels)
    report = compiled("--events", data)
    assert report["match"]["samples"] == 6
    assert report["match"]["wraps"] == 0
    assert report["classes"] == list(NAMES)
    assert locsnn_main(["run", "built", "--events", data]) == 0


@pytest.mark.slow
@pytest.mark.parametrize(
    "model", ["hybrid-graph", "tactile-sgnet", "window-snn", "hybrid-lif", "gru-mlp", "cnn-3d"]
)
def test_every_kind_of_network_takes_a_grid(model: str) -> None:
    sensor = grid_layout("6x5", 1)
    touches = synthetic_touches(6, steps=30, classes=3, sensor=sensor)
    np.savez("a.npz", spikes=touches.spikes.transpose(0, 2, 1), labels=touches.labels)
    graph = ("--graph", "nearest") if model in ("hybrid-graph", "tactile-sgnet") else ()
    assert train("a.npz", "--grid", "6x5", "--polarities", "1", "--model", model, *graph) == 0
    if model not in ("gru-mlp", "cnn-3d"):
        assert compiled("--events", "a.npz")["ann_comparison"].keys() == {"cnn-3d", "gru-mlp"}


def test_networks_that_a_sensor_cannot_have_are_not_compared(tmp_path: Path) -> None:
    """Both names stay in report.json: without a grid there are no frames, and without a sensor no channels."""
    undefined = {"operations": None, "ratio": None, "chip_ratio": None}
    train(write(SensorLayout("8 channels", taxels=8)), "--channels", "8")
    comparison = compiled("--events", "a.npz")["ann_comparison"]
    assert comparison["cnn-3d"] == undefined
    assert comparison["gru-mlp"]["operations"] > 0
    text = Path("built/report.md").read_text("utf-8")
    assert ("GRU-MLP" in text, "CNN-3D" in text) == (True, False)
    unknown = replace(lc.load("a.pt"), sensor=None)
    assert lc.compile(unknown).report["ann_comparison"] == {
        "cnn-3d": undefined,
        "gru-mlp": undefined,
    }


def test_without_events_the_check_plays_touches_of_the_sensor() -> None:
    train(write(GRID), "--grid", "4x5", "--recordings", "0")
    report = compiled()
    assert report["match"]["events_source"] == "synthetic touches"
    assert lc.load("a.pt").sensor == GRID


def test_taxels_of_any_sensor_are_dropped_mixed_and_shifted() -> None:
    Path("run.yaml").write_text("taxel_dropout: 0.5\nmixing: 0.5\ntaxel_shift: 2\nchannels: 7\n")
    assert train(write(SensorLayout("7 channels", taxels=7)), "--config", "run.yaml") == 0


@pytest.mark.parametrize(
    ("options", "step_major", "message"),
    [
        pytest.param(
            (),
            False,
            "recordings 'a.npz': their channels are not those of sensor 'neutouch' (40 against 78). Say which sensor it "
            "was: --grid WxH, with --polarities 1 or 2, --channels N, or --layout FILE.",
            id="no sensor",
        ),
        pytest.param(
            ("--grid", "4x4"),
            False,
            "recordings 'a.npz': their channels are not those of sensor 'grid 4x4' (40 against 32). Say which sensor it "
            "was: --grid WxH, with --polarities 1 or 2, --channels N, or --layout FILE.",
            id="another grid",
        ),
        pytest.param(
            ("--grid", "4x5"),
            True,
            "file 'a.npz': its axes look like (samples, steps, channels) (6 x 20 x 40 values). Give "
            "--axes samples,steps,channels, or transpose it to (samples, channels, steps), as files have it.",
            id="transposed",
        ),
        pytest.param(
            ("--channels", "40", "--model", "cnn-3d"),
            False,
            "network 'cnn-3d': its frames need a grid of at least 5 x 5 taxels (sensor '40 channels'). "
            "Give --grid WxH of the sensor, or use another network.",
            id="no grid",
        ),
        pytest.param(
            ("--channels", "40", "--model", "hybrid-graph", "--graph", "tree"),
            False,
            "taxel graph 'tree': it needs to know where the taxels lie, and sensor '40 channels' does not give their positions. "
            "Give --grid WxH, or --layout FILE with positions.",
            id="no places",
        ),
        pytest.param(
            ("--grid", "4x5", "--axes", "samples,channels"),
            False,
            "axes: it is not an order of axes (got 'samples,channels'). Name steps and channels, or taxels, "
            "or rows and columns, with polarities or without, and samples.",
            id="no axes",
        ),
    ],
)
def test_what_contradicts_the_sensor_is_refused(
    options: tuple[str, ...], step_major: bool, message: str, capsys: Capture
) -> None:
    assert train(write(GRID, step_major=step_major), *options) == 2
    assert capsys.readouterr() == ("", f"{message}\n")
    assert not Path("a.pt").exists()


def test_another_order_of_axes_is_said_by_an_option_or_by_the_file(capsys: Capture) -> None:
    by_default, step_major = write(GRID), write(GRID, "b.npz", step_major=True)
    stating_axes = write(GRID, "c.npz", step_major=True, axes="samples,steps,channels")
    axes = ("--axes", "samples,steps,channels")
    runs = ((by_default, ()), (step_major, axes), (stating_axes, ()), (stating_axes, axes))
    weights = []
    for data, options in runs:
        assert train(data, "--grid", "4x5", *options) == 0
        weights.append(read_checkpoint("a.pt").weights["time_hidden"])
    assert all(np.array_equal(weights[0], weights_of_run) for weights_of_run in weights)
    assert train(stating_axes, "--grid", "4x5", "--axes", "samples,channels,steps") == 2
    assert capsys.readouterr().err == (
        "axes: file 'c.npz' gives another order (samples,steps,channels). Leave it out.\n"
    )


def test_a_layout_file_is_kept_in_the_checkpoint() -> None:
    Path("glove.yaml").write_text(
        "positions: [[0, 0], [2, 0], [0, 1]]\nnames: [thumb, index, palm]\nsurfaces: 2\n"
    )
    sensor = SensorLayout(
        "glove",
        taxels=3,
        polarities=1,
        surfaces=2,
        positions=((0.0, 0.0), (2.0, 0.0), (0.0, 1.0)),
        names=("thumb", "index", "palm"),
    )
    assert train(write(sensor), "--layout", "glove.yaml", "--order", "tour") == 0
    Path("glove.yaml").unlink()
    description = read_checkpoint("a.pt").description
    assert description.input.sensor == sensor
    assert description.location_taxels == (1, 3, 2)
    assert description.walk.tolist() == [0, 2, 1, 3, 5, 4]


def test_events_with_x_and_y_are_laid_out_as_the_checkpoint_was(capsys: Capture) -> None:
    """Its grid and polarities travel to the program: the highest column and one polarity are silent in the file."""
    train(write(GRID), "--grid", "4x5")
    event = [("t", "<i8"), ("x", "<i8"), ("y", "<i8"), ("p", "<i8")]
    np.save("e.npy", np.array([(0, 1, 2, 0), (20_000, 0, 4, 0)], dtype=event))
    recordings = lc.read_recordings("e.npy", model=lc.load("a.pt").expected)
    assert sorted(zip(*map(list, np.nonzero(recordings.spikes[0])), strict=True)) == [
        (0, 2 * (2 * 4 + 1)),
        (1, 2 * 16),
    ]
    report = compiled("--events", "e.npy")
    assert report["operations"]["per_sample"]["input_events"] > 0
    program = hw.load_program("built")
    assert (program.polarities, program.columns) == (2, 4)
    assert np.array_equal(
        lc.read_recordings("e.npy", model=expected_by(program)).spikes, recordings.spikes
    )
    capsys.readouterr()
    assert locsnn_main(["run", "built", "--events", "e.npy"]) == 0


def test_a_network_to_start_from_brings_its_sensor(capsys: Capture) -> None:
    data = write(GRID)
    assert train(data, "--grid", "4x5") == 0
    for options in ((), ("--grid", "4x5")):
        assert train(data, "--from", "a.pt", *options, output="b.pt") == 0
        assert read_checkpoint("b.pt").description.input.sensor == GRID
    assert train(data, "--from", "a.pt", "--grid", "5x4", output="c.pt") == 2
    assert capsys.readouterr().err == (
        "sensor 'grid 5x4': the network to start from has another layout (sensor 'grid 4x5'). Leave the option out.\n"
    )


def test_class_names_travel_and_must_agree(capsys: Capture) -> None:
    train(write(GRID), "--grid", "4x5")
    assert read_checkpoint("a.pt").description.class_names == NAMES
    report = compiled("--events", "a.npz")
    assert report["classes"] == list(NAMES)
    assert "| twist |" in Path("built/report.md").read_text("utf-8")
    other = write(GRID, "b.npz", class_names=("twist", "slide", "press"))
    assert compile_main(["a.pt", "--events", other, "--quiet", "-o", "other"]) == 2
    assert capsys.readouterr().err == (
        "recordings 'b.npz': their classes have other names than those of model 'a' (twist, slide, press against press, "
        "slide, twist). Give recordings of the same classes, in the same order.\n"
    )
    assert locsnn_main(["run", "built", "--events", other]) == 2
    assert capsys.readouterr().err == (
        "recordings 'b.npz': their classes have other names than those of program 'a' (twist, slide, press against press, "
        "slide, twist). Give recordings of the same classes, in the same order.\n"
    )
    assert locsnn_main(["run", "built", "--events", "a.npz"]) == 0
    model = lc.load("a.pt")
    with pytest.raises(
        lc.InputError, match="their classes have other names than those of model 'a'"
    ):
        lc.compile(model, events=lc.read_recordings(other))
    wide = replace(lc.read_recordings("a.npz"), step_seconds=0.5)
    with pytest.raises(lc.InputError, match="their steps are not as long as those of model 'a'"):
        lc.verify(lc.compile(replace(model, step_seconds=0.02), diagnosis=False), wide)
    capsys.readouterr()
    assert train(other, "--grid", "4x5", "--from", "a.pt", output="b.pt") == 2
    assert capsys.readouterr().err == (
        "recordings 'b.npz': their classes have other names than those of the network to start from (twist, slide, press "
        "against press, slide, twist). Give recordings of the same classes, in the same order.\n"
    )


def test_polarities_are_merged_only_if_asked(capsys: Capture) -> None:
    """With --channels 40 alone, events of both polarities of a taxel became the same channel."""
    touches = lc.read_recordings(write(GRID))
    write_recordings(Path("events.zip"), touches, members="bs1", sensor=GRID)
    assert train("events.zip", "--channels", "40") == 2
    assert capsys.readouterr().err == (
        "archive 'events.zip': its events have two polarities, but the sensor has one. Keep them apart by --polarities 2, "
        "or merge them by --merge-polarities.\n"
    )
    assert train("events.zip", "--channels", "40", "--polarities", "2") == 0
    recordings = read_checkpoint("a.pt").recordings
    assert recordings is not None
    assert np.array_equal(recordings.spikes, touches.spikes[: len(recordings)])
    merging = ("--channels", "40", "--merge-polarities")
    assert train("events.zip", *merging, output="b.pt") == 0
    recordings = read_checkpoint("b.pt").recordings
    assert recordings is not None
    assert np.array_equal(
        recordings.spikes,
        touches.spikes[: len(recordings), :, ::2] | touches.spikes[: len(recordings), :, 1::2],
    )


FIT = "its class names do not fit its classes (2 different ones against 3)"


@pytest.mark.parametrize(
    ("names", "problem"),
    [
        (("press", "slide"), FIT),
        (("press", "press", "twist"), FIT),
        (("press", "", "twist"), "a class name cannot be used ('')"),
        (("press", "\x1b[31mslide", "twist"), "a class name cannot be used ('\\x1b[31mslide')"),
        (("press", "x" * 81, "twist"), f"a class name cannot be used ('{'x' * 81})"),
    ],
    ids=["too few", "twice", "empty", "control character", "long"],
)
def test_class_names_that_do_not_fit(names: tuple[str, ...], problem: str, capsys: Capture) -> None:
    assert train(write(GRID, class_names=names), "--grid", "4x5") == 2
    assert capsys.readouterr().err == (
        f"recordings 'a.npz': {problem}. Give a name of 1 to 80 printable characters for each class, from class 0 on.\n"
    )


def test_folders_are_classes_and_recordings_have_lengths_of_their_own(capsys: Capture) -> None:
    touches = synthetic_touches(6, steps=24, classes=3, sensor=GRID)
    for i, (spikes, label) in enumerate(zip(touches.spikes, touches.labels, strict=True)):  # type: ignore[arg-type]
        for part in ("train", "test"):
            folder = Path("set") / part / NAMES[label]
            folder.mkdir(parents=True, exist_ok=True)
            np.save(folder / f"sample_{i}.npy", spikes[: 19 + i].T)
    recordings = lc.read_recordings("set", split="train")
    assert recordings.class_names == NAMES
    assert recordings.labels.tolist() == [0, 1, 2, 0, 1, 2]  # type: ignore[union-attr]
    assert recordings.spikes.shape == (6, 24, 40)
    assert not recordings.spikes[0, 19:].any()
    assert locsnn_main(
        ["train", "--data", "set", "--grid", "4x5", "--epochs", "1", "-o", "a.pt"]
    ) in (0, 3)
    assert "test accuracy" in capsys.readouterr().out
    assert compiled("--events", "set")["classes"] == list(NAMES)


def test_labels_with_gaps_and_silence_are_told(capsys: Capture) -> None:
    spikes = synthetic_touches(6, steps=20, classes=2, sensor=GRID).spikes.copy()
    spikes[4] = 0
    np.savez("a.npz", spikes=spikes.transpose(0, 2, 1), labels=[0, 3, 0, 3, 0, 3])
    assert locsnn_main(
        ["train", "--data", "a.npz", "--grid", "4x5", "--epochs", "1", "-o", "a.pt"]
    ) in (0, 3)
    stdout = capsys.readouterr().out
    assert "! 1 of 6 recordings to train on has no event.\n" in stdout
    assert "! No recording to train on has label 1, 2: labels count from 0 to 3 here.\n" in stdout
    np.savez("b.npz", spikes=0 * spikes.transpose(0, 2, 1), labels=[0, 3, 0, 3, 0, 3])
    assert train("b.npz", "--grid", "4x5") == 2
    assert capsys.readouterr().err == (
        "recordings 'b.npz': none of them has an event (6 recordings). Give recordings with events.\n"
    )


def test_recordings_that_are_too_long_are_told_before_training(capsys: Capture) -> None:
    np.savez("a.npz", spikes=np.ones((2, 4, 20_001), dtype=np.uint8), labels=[0, 1])
    assert train("a.npz", "--channels", "4") == 2
    assert capsys.readouterr().err == (
        "recordings 'a.npz': they are too long (20001 steps against 20000). Cut them with --steps, use wider bins, or allow more with --max-steps.\n"
    )


def test_events_shows_places_of_the_sensor(capsys: Capture) -> None:
    spikes = np.zeros((1, 40, 9), dtype=np.uint8)
    spikes[0, 11] = 1
    np.savez("a.npz", spikes=spikes, class_names=NAMES, labels=[2])
    assert locsnn_main(["events", "a.npz", "--grid", "4x5"]) == 0
    printed = capsys.readouterr().out
    assert "busiest channels  11 (row 2, column 2 falling) 9\n" in printed
    assert "recording 0, label 2 (twist):\n" in printed
    assert locsnn_main(["events", "a.npz", "--grid", "4x4"]) == 2
    assert capsys.readouterr().err == (
        "recordings 'a.npz': their channels are not those of sensor 'grid 4x4' (40 against 32). Say which sensor it was: "
        "--grid WxH, with --polarities 1 or 2, --channels N, or --layout FILE.\n"
    )


@pytest.mark.parametrize("name", ["b.npz", "b.pt"])
def test_names_of_classes_are_written_again(name: str) -> None:
    assert locsnn_main(["events", write(GRID), "--grid", "4x5", "--to", name]) == 0
    assert lc.read_recordings(name).class_names == NAMES
