"""The options that say what the channels of recordings are: the same on every command that reads recordings.

A network in which neuron i spikes for input i alone shows where a pixel arrives.
"""

from __future__ import annotations

import argparse
import itertools
import json
from pathlib import Path

import nir
import numpy as np
import pytest

import hw_model as hw
from locsnn_compile.cli.compile import main as compile_main
from locsnn_compile.cli.main import main as locsnn_main
from locsnn_compile.cli.options import add_options
from locsnn_compile.data import read_recordings

Capture = pytest.CaptureFixture[str]
TXYP = np.dtype([("t", "<i8"), ("x", "<i2"), ("y", "<i2"), ("p", "<i1")])
READING = ("compile", "train", "run", "events", "explore", "sim", "stream", "pack")
SENSOR_OPTIONS = (
    "--axes",
    "--grid",
    "--layout",
    "--channels",
    "--polarities",
    "--columns",
    "--merge-polarities",
    "--only-taxels",
    "--only-polarity",
    "--merge-channels",
)
PYX = ("--channel-order", "pyx")


@pytest.fixture(autouse=True)
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Run every test in a folder of its own, so that files need no paths."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


def write_graph(shape: tuple[int, ...]) -> None:
    """Write ``m.nir``: neuron i spikes for input i alone."""
    size = int(np.prod(shape))
    nodes = {
        "input": nir.Input(np.array(shape)),
        "flat": nir.Flatten({"input": np.array(shape)}, start_dim=0, end_dim=-1),
        "weights": nir.Linear(np.eye(size)),
        "neurons": nir.Threshold(np.full(size, 0.5)),
        "output": nir.Output(np.array([size])),
    }
    names = list(nodes)
    edges = list(itertools.pairwise(names))
    nir.write("m.nir", nir.NIRGraph(nodes, edges, type_check=False))


def write_event(x: int, y: int, p: int) -> None:
    """Write ``e.npy``: one event, and another at (0, 0, p) a step later, after which its spike comes."""
    np.save("e.npy", np.array([(1_000, x, y, p), (41_000, 0, 0, p)], dtype=TXYP))


@pytest.mark.parametrize("command", READING)
def test_every_command_that_reads_recordings_has_the_options_of_the_sensor(command: str) -> None:
    parser = argparse.ArgumentParser()
    add_options(parser, command)
    options = {option for action in parser._actions for option in action.option_strings}
    assert set(SENSOR_OPTIONS) <= options
    models = ("compile", "run", "explore", "sim", "stream")
    assert ("--channel-order" in options) == (command in models)


@pytest.mark.parametrize(
    ("place", "neuron"), [((1, 2, 1), 25), ((3, 0, 0), 3), ((0, 3, 1), 28)], ids=str
)
@pytest.mark.parametrize("kind", ["an image", "flat, with its order"])
def test_compile_and_run_play_a_pixel_to_its_neuron(
    place: tuple[int, int, int], neuron: int, kind: str, capsys: Capture
) -> None:
    write_graph((2, 4, 4) if kind == "an image" else (32,))
    write_event(*place)
    order_options = () if kind == "an image" else (*PYX, "--grid", "4x4")
    assert (
        compile_main(["m.nir", "--events", "e.npy", *order_options, "--quiet", "-o", "built"]) == 0
    )
    report = json.loads(Path("built/report.json").read_text("utf-8"))
    assert not [sentence for sentence in report["assumptions"] if "number" in sentence]
    program = hw.load_program("built")
    assert (program.channel_order, program.polarities, program.columns) == ("pyx", 2, 4)
    capsys.readouterr()
    assert locsnn_main(["run", "built", "--events", "e.npy", "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert result["recordings"][0]["prediction"] == neuron
    assert not [sentence for sentence in result["assumptions"] if "number" in sentence]


def test_a_program_that_does_not_know_says_so_and_is_told(capsys: Capture) -> None:
    write_graph((32,))
    write_event(x=1, y=2, p=1)
    assert compile_main(["m.nir", "--quiet", "-o", "built"]) == 0
    capsys.readouterr()
    assert locsnn_main(["run", "built", "--events", "e.npy", "--grid", "4x4"]) == 0
    assert (
        "assumed: The program does not say how its inputs are numbered: 2 * (4 * y + x) + polarity was taken "
        "(--channel-order yxp).\n"
    ) in capsys.readouterr().out
    order_options = ("--grid", "4x4", *PYX, "--json")
    assert locsnn_main(["run", "built", "--events", "e.npy", *order_options]) == 0
    result = json.loads(capsys.readouterr().out)
    assert result["recordings"][0]["prediction"] == 25
    assert not [sentence for sentence in result["assumptions"] if "number" in sentence]


def test_another_order_than_the_models_own_is_refused(capsys: Capture) -> None:
    write_graph((2, 4, 4))
    write_event(x=1, y=2, p=1)
    command = ["m.nir", "--events", "e.npy", "--channel-order", "yxp", "--quiet", "-o", "built"]
    assert compile_main(command) == 2
    assert capsys.readouterr().err == (
        "channel_order: model 'm' has another (got yxp against pyx). Leave it out.\n"
    )
    assert compile_main(["m.nir", "--quiet", "-o", "built"]) == 0
    assert locsnn_main(["run", "built", "--events", "e.npy", "--channel-order", "yxp"]) == 2
    assert capsys.readouterr().err == (
        "--channel-order: program 'm' has another (got yxp against pyx). Leave it out.\n"
    )


def test_options_of_a_sensor_without_events_are_refused(capsys: Capture) -> None:
    write_graph((2, 4, 4))
    assert compile_main(["m.nir", "--grid", "4x4", "--quiet", "-o", "built"]) == 2
    assert capsys.readouterr().err == (
        "--grid: there are no events to read. Give them with --events.\n"
    )


def test_events_takes_the_sensor_that_train_takes(capsys: Capture) -> None:
    np.savez("train.npz", spikes=np.ones((4, 24, 5), dtype=np.uint8), labels=[0, 1, 0, 1])
    assert locsnn_main(["events", "train.npz", "--channels", "24", "--polarities", "2"]) == 0
    assert "busiest channels  0 (taxel 1 rising) 20" in capsys.readouterr().out
    assert locsnn_main(["events", "train.npz", "--channels", "24", "--columns", "4"]) == 0
    assert "(row 1, column 2)" in capsys.readouterr().out


def test_merging_has_a_name_of_its_own(capsys: Capture) -> None:
    """A sensor of one polarity is not what merging two is."""
    np.save("e.npy", np.array([(0, 1, 0, 0), (0, 1, 0, 1), (0, 3, 2, 1)], dtype=TXYP))
    one_polarity = ("events", "e.npy", "--grid", "4x4", "--polarities", "1")
    assert locsnn_main([*one_polarity]) == 2
    assert capsys.readouterr().err == (
        "file 'e.npy': its events have two polarities, but the sensor has one. Keep them apart by --polarities 2, or merge "
        "them by --merge-polarities.\n"
    )
    merging = ("events", "e.npy", "--grid", "4x4", "--merge-polarities", "--to", "merged.npz")
    assert locsnn_main([*merging]) == 0
    merged = read_recordings("merged.npz")
    assert merged.spikes.shape == (1, 1, 16)
    assert np.flatnonzero(merged.spikes).tolist() == [1, 11]


def test_a_file_keeps_the_size_of_its_sensor() -> None:
    np.save("e.npy", np.array([(0, 1, 2, 1)], dtype=TXYP))
    assert locsnn_main(["events", "e.npy", "--grid", "4x4", "--to", "kept.npz"]) == 0
    with np.load("kept.npz") as entries:
        assert entries["sensor_size"].tolist() == [4, 4, 2]
    write_graph((2, 4, 4))
    assert compile_main(["m.nir", "--events", "kept.npz", "--quiet", "-o", "built"]) == 0
    report = json.loads(Path("built/report.json").read_text("utf-8"))
    assert not [sentence for sentence in report["assumptions"] if "number" in sentence]
