"""Options that would change nothing are refused, in one line and with nothing written.

The table has a command for each option and mode in which it would be idle.
"""

from __future__ import annotations

import csv
import shlex
from pathlib import Path

import numpy as np
import pytest

import locsnn_compile as lc
from locsnn_compile.cli.compile import main as compile_main
from locsnn_compile.cli.main import main as locsnn_main
from locsnn_compile.cli.main import parser as main_parser
from locsnn_compile.cli.train import training_config
from locsnn_compile.data.synthetic import synthetic_touches
from locsnn_compile.data.write import write_recordings
from locsnn_compile.settings import check_matters
from locsnn_compile.training.config import check_used, config_from_mapping, read_config

ROOT = Path(__file__).parents[2]
MODELS = ROOT / "examples/models"
FLOAT, GRID = MODELS / "objects-hybrid.pt", MODELS / "objects-hybrid-loihi.pt"


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """Recordings as bins and as events, a finished model, and a training configuration."""
    monkeypatch.chdir(tmp_path)
    touches = synthetic_touches(4, steps=20, classes=2, seed=1)
    write_recordings("d.npz", touches)
    write_recordings("e", touches, members="bs1")
    Path("model.pt").write_bytes(b"finished")
    Path("bits.yaml").write_text("weight_bits: 4\n")
    return tmp_path


INTEGERS = "the weights of this model are integers of the chip already"
NO_CHIP = "it would change nothing: the network is trained in float, and no chip holds it. Add --target CHIP."
WORTH = "--spike-worth: it weighs what --strategy auto chooses without bounds, which is not done here. Leave it out."
BINS = "'d.npz' holds bins, not single events to count. Leave it out."
OTHER = (
    "recordings 'd.npz': their channels are not those of sensor '200 channels' (78 against 200). Say which sensor it was: "
    "--grid WxH, with --polarities 1 or 2, --channels N, or --layout FILE."
)
# Each row: its id, a command, and the line on standard error.
REFUSED = [
    ("train, bits in float", "locsnn train --data d.npz --weight-bits 4 -o new.pt", f"--weight-bits: {NO_CHIP}"),
    ("train, strategy in float", "locsnn train --data d.npz --strategy reset -o new.pt", f"--strategy: {NO_CHIP}"),
    ("train, both", "locsnn train --data d.npz --weight-bits 4 --strategy reset -o new.pt", f"--strategy: {NO_CHIP}"),
    ("train, bits of the configuration", "locsnn train --data d.npz --config bits.yaml -o new.pt", f"config 'bits.yaml', weight_bits: {NO_CHIP}"),
    ("train, order without locations", "locsnn train --data d.npz --model tactile-snn --order whorl -o new.pt", "--order: it would change nothing: the network has no location branch. Leave it out."),
    ("train, lambda of one branch", "locsnn train --data d.npz --model tactile-snn --lambda 2 -o new.pt", "--lambda: it would change nothing: the network has no second branch. Leave it out."),
    ("train, graph without one", "locsnn train --data d.npz --graph tree -o new.pt", "--graph: it would change nothing: the network has no graph. Choose a model with one, such as hybrid-graph."),
    ("train, nothing to resume", "locsnn train --data d.npz --resume -o model.pt", "--resume: there is nothing to resume (no 'model.pt.state'). Train without --resume."),
    ("compile, bits of integers", f"locsnn-compile {GRID} --weight-bits 8", f"--weight-bits: it would change nothing: {INTEGERS}. Leave it out."),
    ("compile, split integers", f"locsnn-compile {GRID} --split-weights all", f"--split-weights: it would change nothing: {INTEGERS}. Leave it out."),
    ("compile, calibration of integers", f"locsnn-compile {GRID} --calibration d.npz", "--calibration: it would change nothing: no weights of this model are rounded for recordings. Leave it out."),
    ("compile, a recording of nothing", f"locsnn-compile {FLOAT} --recording 1 --emit network", "--recording: no emitted file shows a single recording. Add --emit vectors, rtl, vcd, trace, sanafe, lava, xylo or pynn."),
    ("compile, a probe of nothing", f"locsnn-compile {FLOAT} --probe time_output[0]", "--probe: no emitted file shows a neuron. Add --emit vcd."),
    ("compile, the worth of spikes of a strategy", f"locsnn-compile {FLOAT} --strategy reset --spike-worth 2", WORTH),
    ("compile, the worth of spikes within bounds", f"locsnn-compile {FLOAT} --max-spike-error 0.1 --spike-worth 2", WORTH),
    ("compile, the worth of spikes of integers", f"locsnn-compile {GRID} --spike-worth 2", WORTH),
    ("compile, a rate above all channels", f"locsnn-compile {FLOAT} --events d.npz --events-per-step 79 --quiet", "events_per_step 79: it is out of range for a network of 78 channels. Give 0 to 78."),
    ("compile, a rate below none", f"locsnn-compile {FLOAT} --events-per-step -1", "--events-per-step -1: it is out of range. Give a number from 0 up."),
    ("compile, junit of nothing", f"locsnn-compile {FLOAT} --junit g.xml", "--junit: no gate is asked for. Add one of --min-agreement, --max-spike-error, --max-score-error, --max-energy-nj, --max-latency-us, --max-cores."),
    ("compile, a description of a checkpoint", f"locsnn-compile {FLOAT} --config bits.yaml", f"model '{FLOAT}': config was given, but a checkpoint contains this itself. Leave config out."),
    ("compile, a step of a checkpoint", f"locsnn-compile {FLOAT} --dt 1e-3", f"model '{FLOAT}': dt was given, but a checkpoint contains this itself. Leave dt out."),
    ("compile, parts of nothing", f"locsnn-compile {FLOAT} --split 0.2", "--split: there are no events to read. Give them with --events."),
    ("explore, bits of integers", f"locsnn explore {GRID} --weight-bits 4 6", f"--weight-bits: it would change nothing: {INTEGERS}. Leave it out."),
    ("explore, calibration of integers", f"locsnn explore {GRID} --calibration d.npz", "--calibration: it would change nothing: no weights of this model are rounded for recordings. Leave it out."),
    ("explore, a part of nothing", f"locsnn explore {FLOAT} --part test", "--part test: there are no events to take it from. Give them with --events."),
    ("explore, workers of a scheduler", f"locsnn explore {FLOAT} --workers 2 --scheduler x:1", "--workers: a scheduler has workers of its own. Leave out --workers or --scheduler."),
    ("pack, calibration next to weights", f"locsnn pack {FLOAT} {GRID} --weights 1,2 --calibration d.npz -o new.pt", "--calibration: the weights are given. Leave out --calibration or --weights."),
    ("events, channels of bins, written", "locsnn events d.npz --channels 200 --to new.npz", OTHER),
    ("events, channels of bins, shown", "locsnn events d.npz --channels 200", OTHER),
    ("events, threshold of bins", "locsnn events d.npz --threshold 2", f"threshold: {BINS}"),
    ("events, polarities of bins", "locsnn events d.npz --polarities 1", f"polarities: {BINS}"),
    ("events, columns of bins", "locsnn events d.npz --columns 3", f"columns: {BINS}"),
    ("events, a part of a file", "locsnn events d.npz --part test", "file 'd.npz': there is no part 'test' (a single file is not divided). Leave the part out."),
    ("events, a recording of no raster", "locsnn events d.npz --json --recording 1", "--recording: no raster is shown or written. Leave out --json, or add -o."),
    ("events, members of a file", "locsnn events d.npz --members bs1 --to new.npz", "--members: no folder or .zip is written. Add --to with a folder or .zip."),
]  # fmt: skip


def run(command):
    """Run a command as typed; return its exit code."""
    program, *arguments = shlex.split(command)
    return (compile_main if program == "locsnn-compile" else locsnn_main)(arguments)


def names(folder):
    """Return what lies in a folder, with the bytes of its files."""
    return {
        path.relative_to(folder).as_posix(): path.is_file() and path.read_bytes()
        for path in folder.rglob("*")
    }


@pytest.mark.parametrize(
    ("command", "line"), [row[1:] for row in REFUSED], ids=[row[0] for row in REFUSED]
)
def test_options_that_would_change_nothing(command, line, folder, capsys):
    before = names(folder)
    assert (run(command), capsys.readouterr()) == (2, ("", f"{line}\n"))
    assert names(folder) == before


def test_options_that_change_something_are_taken(folder, capsys):
    """The same options in a mode of theirs."""
    assert run("locsnn events e --channels 200 --polarities 2 --to new.npz") == 0
    assert np.load("new.npz")["spikes"].shape[1] == 200
    assert run("locsnn events d.npz --channels 78") == 0
    assert capsys.readouterr().err == ""


# Each row: a key of a training configuration, a configuration in which it changes nothing, and one in which it does.
CHANGES = [
    ("strategy", {}, {"target": "loihi-sim"}),
    ("weight_bits", {}, {"target": "loihi-sim"}),
    ("weight_room", {}, {"target": "loihi-sim"}),
    ("refractory", {"target": "loihi-sim"}, {"target": "loihi-sim", "strategy": "reset"}),
    ("order", {"model": "tactile-snn"}, {"model": "location-tactile-snn"}),
    ("location_weight", {"model": "tactile-snn"}, {"model": "hybrid"}),
    ("hidden", {"model": "window-snn"}, {"model": "gru-mlp"}),
    ("hops", {"model": "hybrid-lif"}, {"model": "hybrid-graph"}),
    ("tau_sr", {"model": "hybrid-lif"}, {"model": "hybrid"}),
    ("decay", {"model": "hybrid"}, {"model": "hybrid-lif"}),
    ("window_steps", {"model": "hybrid"}, {"model": "window-snn"}),
    ("target_right", {}, {"loss": "spike-count"}),
    ("count_scale", {"loss": "spike-count"}, {"loss": "cross-entropy"}),
    ("align_events", {"model": "gru-mlp"}, {"model": "hybrid"}),
    ("class_order", {"class_order": "0-4"}, {"class_order": "0-4", "neighbour_smoothing": 0.1}),
    (
        "neighbour_smoothing",
        {"neighbour_smoothing": 0.1},
        {"class_order": "0-4", "neighbour_smoothing": 0.1},
    ),
    ("class_order", {"loss": "spike-count"}, {"class_order": "0-4", "neighbour_smoothing": 0.1}),
]


@pytest.mark.parametrize(("option", "without", "with_it"), CHANGES, ids=[row[0] for row in CHANGES])
def test_keys_of_a_configuration_and_what_they_need(option, without, with_it):
    check_used({option: option}, config_from_mapping(with_it))
    check_used({option: option}, config_from_mapping(without), config_from_mapping(with_it))
    with pytest.raises(
        lc.InputError, match=f"^{option}: it would change nothing: .*[.] [A-Z].*[.]$"
    ):
        check_used({option: option}, config_from_mapping(without))


@pytest.mark.parametrize(
    "path", sorted((ROOT / "examples/configs").glob("*.yaml")), ids=lambda path: path.stem
)
def test_the_configurations_that_ship_hold_no_unused_keys(path):
    values = read_config(path)
    check_used({name: name for name in values}, config_from_mapping(values))


def commands_of_the_results():
    """Return the arguments of all training commands that the documentation gives."""
    with (ROOT / "docs/research/results/commands.csv").open(encoding="utf-8", newline="") as file:
        lines = [row["command"].split(" && ") for row in csv.DictReader(file)]
    commands = [
        shlex.split(part)[1:] for line in lines for part in line if part.startswith("locsnn train ")
    ]
    assert len(commands) > 20
    return commands


@pytest.mark.slow
def test_the_commands_of_the_results_hold_no_unused_options(monkeypatch):
    """Configurations are shared between networks, and options lie over them."""
    monkeypatch.chdir(ROOT)
    for command in commands_of_the_results():
        training_config(main_parser().parse_args(command), start=None)


def test_what_matters_to_a_model():
    """Every rule says yes to a float hybrid; psi alone matters to a hybrid of integers."""
    options = {name: name for name in ("weight_bits", "split_weights", "calibration", "psi")}
    check_matters(lc.load(FLOAT), options)
    check_matters(lc.load(GRID), {"psi": "--psi"})


@pytest.mark.parametrize(
    ("options", "line"),
    [
        (
            ["--strategy", "reset"],
            "--calibration: it changed nothing: strategy reset rounds each weight by itself.\n",
        ),
        (["--strategy", "dendrite"], ""),
        (["--strategy", "reset", "--min-agreement", "0"], ""),
    ],
    ids=["resets", "another strategy", "settings are chosen"],
)
def test_a_build_says_where_calibration_changed_nothing(folder, options, line, capsys):
    arguments = [str(FLOAT), "--events", "d.npz", "--calibration", "d.npz", *options]
    compile_main([*arguments, "-o", "out", "--quiet"])
    assert capsys.readouterr().err == line
