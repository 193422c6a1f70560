"""The command ``locsnn train``: the files that it writes, what it prints, and what it refuses.

Recordings are a few synthetic touches, so most runs here learn nothing; their exit code and remarks say so.
"""

from __future__ import annotations

import argparse
import errno
import os
import re
import subprocess
import sys
import types
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from locsnn_compile.cli import train as command
from locsnn_compile.cli.main import main
from locsnn_compile.cli.shell import add_command, progress_bar
from locsnn_compile.data.read import read_recordings
from locsnn_compile.data.synthetic import synthetic_touches
from locsnn_compile.data.write import write_recordings
from locsnn_compile.errors import InputError
from locsnn_compile.models.checkpoint_reader import read_checkpoint
from locsnn_compile.training.config import config_from_mapping
from locsnn_compile.training.state import EpochRecord
from locsnn_compile.training.train import train

SILENT = "! No output neuron spikes in any of the 9 recordings it was trained on: every prediction is a tie. Give --learning-rate 0.1.\n"


def parser() -> argparse.ArgumentParser:
    """A parser with the command alone."""
    locsnn = argparse.ArgumentParser(prog="locsnn")
    add_command(locsnn.add_subparsers(required=True), "train")
    return locsnn


def run(*arguments: str) -> int:
    """Train with fixed defaults, and return the exit code, but 0 for 3, with which runs end that learn nothing."""
    args = parser().parse_args(["train", "--defaults", "fixed", *arguments])
    code: int = args.run(args)
    return 0 if code == 3 else code


@pytest.fixture
def data(tmp_path: Path) -> str:
    """A file of nine recordings of three classes, without parts."""
    write_recordings(tmp_path / "touches.npz", synthetic_touches(9, steps=40, classes=3, seed=1))
    return str(tmp_path / "touches.npz")


def evtouch_folder(path: Path) -> str:
    """Write a folder like the published EvTouch archives, with a train part of six and a test part of three."""
    touches = synthetic_touches(9, steps=40, classes=3, seed=1)
    assert touches.labels is not None
    for index, (spikes, label) in enumerate(zip(touches.spikes, touches.labels, strict=True)):
        part = path / ("test" if index < 3 else "train")
        part.mkdir(parents=True, exist_ok=True)
        np.save(
            part / f"sample_{index}_label_{label}.npy",
            spikes.T.reshape(39, 2, 40).astype(np.float32),
        )
    return str(path)


def test_a_file_without_parts_is_divided_into_training_and_validation(
    tmp_path: Path, data: str, capsys: pytest.CaptureFixture[str]
) -> None:
    output = tmp_path / "small.pt"
    network = ("--hidden", "6", "--order", "whorl")
    assert run("--data", data, "--epochs", "2", *network, "-o", str(output)) == 0
    checkpoint = read_checkpoint(output)
    assert checkpoint.description.name == "small"
    assert (checkpoint.description.hidden, checkpoint.description.classes) == (6, 3)
    assert checkpoint.description.location_order == "whorl"
    assert checkpoint.recordings is not None
    assert len(checkpoint.recordings) == 8
    assert checkpoint.training["test_accuracy"] is None
    validation = checkpoint.training["validation_accuracy"]
    printed = capsys.readouterr()
    assert printed.out == (
        f"epoch {checkpoint.training['chosen_epoch']} chosen by validation accuracy {validation:.3f}\n"
        "baselines on 3 recordings of the validation part: counts 1.000, counts in 8 bins of time 1.000\n"
        f"{SILENT}wrote {output}\n"
    )
    # Two epochs of the first phase, and as many of the refit as were chosen.
    lines = printed.err.splitlines()
    assert len(lines) == 2 + checkpoint.training["chosen_epoch"]
    assert re.fullmatch(
        rf"1/4 select epoch 1, loss \d+\.\d{{3}}, validation {validation:.3f}", lines[0]
    )
    assert re.fullmatch(r"3/\d refit epoch 1, loss \d+\.\d{3}", lines[2])
    assert sorted(file.name for file in tmp_path.iterdir()) == [
        "small.csv",
        "small.pt",
        "small.svg",
        "touches.npz",
    ]


def test_the_test_part_of_a_folder_is_measured_and_carried(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    output = tmp_path / "small.pt"
    folder = evtouch_folder(tmp_path / "Ev-X")
    options = ("--epochs", "2", "--hidden", "6", "--recordings", "2")
    assert run("--data", folder, *options, "-o", str(output)) == 0
    checkpoint = read_checkpoint(output)
    assert (checkpoint.training["train_recordings"], checkpoint.training["test_recordings"]) == (
        6,
        3,
    )
    assert checkpoint.recordings is not None
    assert checkpoint.recordings.labels is not None
    assert checkpoint.recordings.labels.tolist() == [0, 1]
    printed = capsys.readouterr().out
    assert (
        f"test accuracy {checkpoint.training['test_accuracy']:.3f} on 3 recordings\nlabel \\ predicted    0    1    2  tie\n"
        in printed
    )
    assert "! All classes tie in 3 of 3 test recordings: they predict no class" in printed
    rows = [
        [int(n) for n in line.split()] for line in checkpoint.training["test_confusion"].split(";")
    ]
    assert rows == [[0, 0, 0, 1]] * 3
    assert "every prediction is a tie" in printed
    assert sum(rows[i][i] for i in range(3)) / 3 == checkpoint.training["test_accuracy"]
    for label, row in enumerate(rows):
        assert f"{label:>17}" + "".join(f"{n:5}" for n in row) + "\n" in printed


def test_options_take_precedence_over_the_configuration(
    tmp_path: Path, data: str, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "c.yaml").write_text("model: tactile-snn\nepochs: 9\nhidden: 5\nseed: 3\n")
    output = tmp_path / "small.pt"
    config = ("--config", str(tmp_path / "c.yaml"))
    options = ("--epochs", "1", "--learning-rate", "0.01", "--no-refit", "--recordings", "0")
    assert run("--data", data, *config, *options, "--quiet", "-o", str(output)) == 0
    checkpoint = read_checkpoint(output)
    names = ("model", "epochs", "hidden", "seed", "learning_rate", "refit")
    assert [checkpoint.training[name] for name in names] == ["tactile-snn", 1, 5, 3, 0.01, False]
    assert checkpoint.recordings is None
    assert capsys.readouterr() == ("", "")


def test_a_float_network_is_trained_further_for_a_chip(
    tmp_path: Path, data: str, capsys: pytest.CaptureFixture[str]
) -> None:
    start, output = tmp_path / "float.pt", tmp_path / "chip.pt"
    run("--data", data, "--epochs", "2", "--hidden", "6", "--order", "whorl", "-o", str(start))
    capsys.readouterr()
    chip = ("--target", "loihi-sim", "--strategy", "reset", "--weight-bits", "4")
    options = ("--from", str(start), *chip, "--epochs", "2")
    assert run("--data", data, *options, "-o", str(output)) == 0
    checkpoint = read_checkpoint(output)
    assert checkpoint.chip is not None
    assert (checkpoint.chip.target, checkpoint.chip.strategy) == ("loihi-sim", "reset")
    assert {numbers.weight_bits for numbers in checkpoint.chip.populations.values()} == {4}
    assert checkpoint.description == replace(read_checkpoint(start).description, name="chip")
    expected = {
        "start": "float",
        "start_sha256": read_checkpoint(start).sha256,
        "hidden": 6,
        "order": "whorl",
        "epochs": 2,
        # The defaults of fine-tuning.
        "learning_rate": 0.001,
        "validation_fraction": 0.0,
    }
    assert {name: checkpoint.training[name] for name in expected} == expected
    assert capsys.readouterr().out == f"epoch 2 chosen\n{SILENT}wrote {output}\n"


def test_a_stopped_run_resumes_to_equal_files(
    tmp_path: Path, data: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    options = ("--data", data, "--epochs", "12", "--hidden", "5")
    uninterrupted = tmp_path / "uninterrupted"
    uninterrupted.mkdir()
    run(*options, "-o", str(uninterrupted / "small.pt"))

    # The user stops the run in epoch 11, before its record is made.
    import locsnn_compile.training.train as training

    record = training.EpochRecord

    def stopping(phase: str, epoch: int, **figures: float | None) -> EpochRecord:
        if (phase, epoch) == ("select", 11):
            raise KeyboardInterrupt
        return record(phase=phase, epoch=epoch, **figures)  # type: ignore[arg-type]

    monkeypatch.setattr(training, "EpochRecord", stopping)
    capsys.readouterr()
    assert run(*options, "-o", str(tmp_path / "small.pt")) == 130
    *lines, last = capsys.readouterr().err.splitlines()
    epochs = [line for line in lines if not line.startswith("! After 3 of 12 epochs")]
    assert (len(epochs), last) == (10, "Stopped. Continue with the same command and --resume.")
    monkeypatch.setattr(training, "EpochRecord", record)
    assert (tmp_path / "small.pt.state").exists()
    assert run(*options, "--resume", "-o", str(tmp_path / "small.pt")) == 0
    for name in ("small.pt", "small.csv"):
        assert (tmp_path / name).read_bytes() == (uninterrupted / name).read_bytes()


def test_a_disk_that_is_full_at_the_end_loses_no_epoch(
    tmp_path: Path, data: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    options = ("--data", data, "--epochs", "1", "--hidden", "5", "--quiet")
    write_bytes = Path.write_bytes

    def write_to_full_disk(path: Path, content: bytes) -> int:
        if path.name.startswith(".small.pt.partial-"):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return write_bytes(path, content)

    monkeypatch.setattr(Path, "write_bytes", write_to_full_disk)
    output = str(tmp_path / "small.pt")
    assert main(["train", *options, "-o", output]) == 2
    assert capsys.readouterr() == (
        "",
        f"checkpoint {output!r}: it cannot be written (No space left on device). "
        "Free space or fix access, then repeat the command with --resume.\n",
    )
    monkeypatch.undo()
    assert sorted(path.name for path in tmp_path.glob("small*")) == [
        "small.csv",
        "small.pt.state",
        "small.svg",
    ]
    # A single epoch may teach nothing, which exits with 3.
    assert main(["train", *options, "--resume", "-o", output]) in (0, 3)
    assert not (tmp_path / "small.pt.state").exists()


def test_a_state_with_weights_of_another_shape_is_refused_in_one_line(
    tmp_path: Path, data: str, capsys: pytest.CaptureFixture[str]
) -> None:
    recordings = read_recordings(data)
    path = tmp_path / "small.pt.state"
    config = config_from_mapping({"epochs": 2, "hidden": 5, "defaults": "fixed"})
    train(recordings, config, name="small", state_path=path)
    state = torch.load(path, weights_only=True)
    state["weights"]["time_hidden.weight"] = torch.zeros(6, 78)
    torch.save(state, path)
    before = path.read_bytes()
    options = ("--data", data, "--epochs", "2", "--hidden", "5", "--defaults", "fixed")
    assert main(["train", *options, "--resume", "-o", str(tmp_path / "small.pt")]) == 2
    assert capsys.readouterr().err == (
        "training state 'small.pt.state': weights 'time_hidden.weight' have another shape ((6, 78) against (5, 78)). "
        "Delete it, or train without --resume.\n"
    )
    assert (path.read_bytes(), sorted(tmp_path.glob("small*"))) == (before, [path])


# Each row: an id, the arguments, and the message.
REFUSED = [
    ("missing data", ("--data", "none.npz"), "file 'none.npz': it does not exist. Check the path."),
    ("negative recordings", ("--recordings", "-1"), "--recordings -1: it is out of range. Give a number from 0 up."),
    ("no folder for the output", ("-o", "none/x.pt"), "output 'x.pt': it is not a .pt file in an existing folder. Correct -o."),
    ("other kind of output", ("-o", "x.nir"), "output 'x.nir': it is not a .pt file in an existing folder. Correct -o."),
    ("misspelt model", ("--model", "hybird"), "training options: model: 'hybird' is not known. Did you mean 'hybrid'?"),
    ("misspelt strategy", ("--strategy", "delayline"), "--strategy delayline: it is not known. Did you mean 'delay-line'?"),
    ("weight bits", ("--weight-bits", "7"), "training options: weight_bits: 7 is not known. Choose one of: 1, 2, 3, 4, 5, 6, 8."),
    ("unknown chip", ("--target", "loihi-3"), "target 'loihi-3': no chip of this name ships. Did you mean 'loihi-sim'? A chip file of your own ends in .yaml."),
    ("nothing to start from", ("--from", "none.pt"), "checkpoint 'none.pt': it cannot be read (No such file or directory). Check the path."),
    ("short order", ("--order", "1,2,3"), "location order: taxel 4 is missing (3 of 39 taxels given). Give every taxel from 1 to 39 exactly once."),
]  # fmt: skip


@pytest.mark.parametrize(
    ("arguments", "message"), [row[1:] for row in REFUSED], ids=[row[0] for row in REFUSED]
)
def test_arguments_that_cannot_be_used_are_refused_before_anything_is_written(
    tmp_path: Path,
    data: str,
    monkeypatch: pytest.MonkeyPatch,
    arguments: tuple[str, ...],
    message: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InputError) as caught:
        run("--data", data, *arguments)
    assert str(caught.value) == message
    assert [file.name for file in tmp_path.iterdir()] == ["touches.npz"]


def test_help_shows_a_working_example(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        parser().parse_args(["train", "--help"])
    text = capsys.readouterr().out
    assert "locsnn train --data examples/recordings/motions.npz --epochs 20 -o motions.pt" in text


def test_progress_is_drawn_on_a_terminal(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    record = EpochRecord(
        phase="select",
        epoch=1,
        learning_rate=0.1,
        loss=2.0,
        validation_loss=1.0,
        validation_accuracy=0.5,
    )
    options = argparse.Namespace(tensorboard=None, quiet=False)
    with progress_bar("training", show=True) as bar:
        progress = command.after_epochs(options, bar)
        assert progress is not None
        progress(1, 4, record)
    shown = capsys.readouterr()
    assert shown.out == ""
    assert "select epoch 1, loss 2.000, validation 0.500" in shown.err
    quiet = argparse.Namespace(tensorboard=None, quiet=True)
    command.after_epochs(quiet, move_bar=None)(1, 4, record)
    assert capsys.readouterr() == ("", "")


def test_the_command_is_imported_without_torch() -> None:
    code = (
        "import sys, locsnn_compile.cli.train, locsnn_compile.data; print('torch' in sys.modules)"
    )
    process = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    )
    assert process.stdout == "False\n"


@pytest.mark.skipif(torch.cuda.is_available(), reason="there is a CUDA device")
def test_a_missing_gpu_is_refused(data: str, tmp_path: Path) -> None:
    with pytest.raises(InputError) as caught:
        run("--data", data, "--device", "cuda", "-o", str(tmp_path / "net.pt"))
    assert str(caught.value) == (
        "training option 'device': torch sees no CUDA device here. "
        "Use cpu, or install torch with CUDA on a machine that has one."
    )
    assert [file.name for file in tmp_path.iterdir()] == ["touches.npz"]


@pytest.mark.skipif(not torch.cuda.is_available(), reason="there is no CUDA device")
@pytest.mark.parametrize("name", ["hybrid", "hybrid-lif", "tactile-sgnet", "window-snn", "gru-mlp"])
def test_losses_on_a_gpu_are_about_those_on_the_cpu(name: str) -> None:
    recordings = synthetic_touches(16, steps=30, classes=2, seed=1)
    losses = []
    for device in ("cpu", "cuda"):
        sizes = {"hidden": 4, "features": 3, "step_features": 2}
        config = config_from_mapping({"model": name, "device": device, "epochs": 2, **sizes})
        losses.append([record.loss for record in train(recordings, config).history])
    # Sums in another order may decide a spike differently.
    assert np.allclose(*losses, rtol=0.05)


@pytest.mark.parametrize(
    ("names", "lines"),
    [
        pytest.param(
            None,
            [
                "label \\ predicted   0   1",
                "                0  12   0",
                "                1   3   4",
            ],
            id="numbers",
        ),
        pytest.param(
            ("press", "slide"),
            [
                "label \\ predicted  press  slide",
                "            press     12      0",
                "            slide      3      4",
            ],
            id="names",
        ),
        pytest.param(
            ("p" * 40, "s" * 20),
            [
                "label \\ predicted   0   1",
                "                0  12   0",
                "                1   3   4",
            ],
            id="long names",
        ),
    ],
)
def test_the_confusion_matrix_has_the_names_of_the_classes_if_there_is_room(
    names: tuple[str, ...] | None, lines: list[str]
) -> None:
    assert command.confusion_lines(np.array([[12, 0, 0], [3, 4, 0]]), names) == lines


def test_the_confusion_matrix_of_more_than_20_classes_is_not_printed() -> None:
    assert command.confusion_lines(np.eye(21, 22, dtype=np.int64)) == []
    assert len(command.confusion_lines(np.eye(20, 21, dtype=np.int64))) == 21
    assert command.confusion_lines(np.array([[12, 0, 0], [1, 4, 0]])) == [
        "label \\ predicted   0   1",
        "                0  12   0",
        "                1   1   4",
    ]


def test_ties_have_a_column_of_the_confusion_matrix() -> None:
    assert command.confusion_lines(np.array([[12, 0, 0], [1, 4, 20]])) == [
        "label \\ predicted    0    1  tie",
        "                0   12    0    0",
        "                1    1    4   20",
    ]


def test_a_quiet_run_prints_no_epochs(
    tmp_path: Path, data: str, capsys: pytest.CaptureFixture[str]
) -> None:
    options = ("--epochs", "1", "--hidden", "4", "--quiet")
    assert run("--data", data, *options, "-o", str(tmp_path / "q.pt")) == 0
    assert capsys.readouterr() == ("", "")


def test_a_missing_tensorboard_is_refused_before_training(
    tmp_path: Path, data: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "torch.utils.tensorboard", None)
    runs = str(tmp_path / "runs")
    with pytest.raises(InputError) as caught:
        run("--data", data, "--tensorboard", runs, "-o", str(tmp_path / "small.pt"))
    assert str(caught.value) == (
        "--tensorboard: it needs torch.utils.tensorboard, which is not installed. "
        "Install it with: pip install tensorboard."
    )
    assert not (tmp_path / "small.pt").exists()


def test_the_figures_of_epochs_are_written_for_tensorboard(
    tmp_path: Path, data: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """They must be those of the log."""
    scalars: list[tuple[str, float, int]] = []

    class Writer:
        """Stands for TensorBoard's SummaryWriter."""

        def __init__(self, folder: str) -> None:
            assert folder == str(tmp_path / "runs")

        def add_scalar(self, name: str, value: float, step: int) -> None:
            scalars.append((name, value, step))

        def flush(self) -> None:
            pass

    monkeypatch.setitem(
        sys.modules, "torch.utils.tensorboard", types.SimpleNamespace(SummaryWriter=Writer)
    )
    options = ("--epochs", "1", "--hidden", "4", "--no-refit", "--quiet")
    tensorboard = ("--tensorboard", str(tmp_path / "runs"))
    assert run("--data", data, *options, *tensorboard, "-o", str(tmp_path / "small.pt")) == 0
    header, record = (tmp_path / "small.csv").read_text().splitlines()
    assert header == "phase,epoch,learning_rate,loss,validation_loss,validation_accuracy"
    names = header.split(",")[2:]
    logged = record.split(",")[2:]
    assert [(name, step) for name, _, step in scalars] == [(f"select/{name}", 1) for name in names]
    assert [float(f"{value:.6g}") for _, value, _ in scalars] == [float(value) for value in logged]


@pytest.mark.minutes
@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_tensorboard_reads_the_figures(tmp_path: Path, data: str) -> None:
    accumulator = pytest.importorskip("tensorboard.backend.event_processing.event_accumulator")
    runs = tmp_path / "runs"
    options = ("--epochs", "2", "--hidden", "4", "--no-refit", "--quiet")
    tensorboard = ("--tensorboard", str(runs))
    assert run("--data", data, *options, *tensorboard, "-o", str(tmp_path / "small.pt")) == 0
    events = accumulator.EventAccumulator(str(runs)).Reload()
    assert [event.step for event in events.Scalars("select/loss")] == [1, 2]
