"""``locsnn explore`` on one chip, from the command line: figures, files, commands, interruptions and resuming.

A point is a setting of the compiler with its figures. Figures of points are compared with builds of ``locsnn-compile``
by the printed commands.
"""

import csv
import json
import shlex
import shutil
import xml.etree.ElementTree as ET
from contextlib import contextmanager

import numpy as np
import pytest

import hw_model as hw
import locsnn_compile as lc
from hw_model.simulation import ENGINES
from locsnn_compile.cli import explore as explore_cli
from locsnn_compile.cli.compile import main as compile_main
from locsnn_compile.cli.main import parser
from locsnn_compile.data.members import PARTS
from locsnn_compile.explore import point as point_module
from locsnn_compile.settings import DIALS
from tests.support.explored_model import (
    explore,
    explored,
    figures_of,
    files_without_timings,
    narrow,
)

FILES = {"explore.json", "explore.csv", "explore.svg", "timings.csv", "timings.svg"}
RECORDINGS = 5
"""Of the fixture ``events``."""
CHANNELS = 78
"""Of the fixture ``model``, which has 40 steps."""


@pytest.fixture(scope="module")
def small(model, events, tmp_path_factory):
    """The folder of an exploration of two strategies and two widths: four points."""
    folder = tmp_path_factory.mktemp("explored") / "out"
    grid = narrow("dendrite", "reset", bits=(4, 8))
    assert explore(model, "--events", events, *grid, "-o", folder, "--quiet") == 0
    return folder


def settings_of(document):
    """Return (strategy, weight bits) of each point of explore.json."""
    return [
        (row["setting"]["strategy"], row["setting"]["weight_bits"]) for row in document["points"]
    ]


def test_the_grid_is_complete_and_in_order(small):
    document = explored(small)
    assert settings_of(document) == [("dendrite", 4), ("dendrite", 8), ("reset", 4), ("reset", 8)]
    assert document["schema"] == "locsnn-explore/1"
    assert document["model"]["name"] == "small"
    assert document["chosen_on"] == {
        "source": "few.npz",
        "part": None,
        "recordings": RECORDINGS,
        "available": RECORDINGS,
    }


@pytest.mark.parametrize("number", [0, 3], ids=["dendrite, 4-bit", "reset, 8-bit"])
def test_the_printed_command_gives_the_same_figures(small, tmp_path, number):
    row = explored(small)["points"][number]
    program, *arguments = shlex.split(row["command"])
    assert program == "locsnn-compile"
    assert compile_main([*arguments, "-o", str(tmp_path / "build"), "--quiet"]) == 0
    figures = figures_of(tmp_path / "build")
    assert {name: row["figures"][name] for name in vars(figures)} == vars(figures)
    assert row["figures"]["spike_error"] == figures.spike_error


def test_recommended_is_one_of_the_front(small):
    document = explored(small)
    front = [row for row in document["points"] if row["on_front"]]
    recommended = [row for row in document["points"] if row["recommended"]]
    assert len(recommended) == 1
    assert recommended[0] in front
    assert document["recommended"]["setting"] == recommended[0]["setting"]
    assert document["recommended"]["command"] == recommended[0]["command"]
    assert (
        " on the front within what auto keeps by default, --min-agreement "
        in document["recommended"]["why"]
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    "strategies", [("dendrite", "reset"), ("reset",)], ids=["on the grid", "not on the grid"]
)
def test_bounds_by_default_are_those_of_auto(model, events, tmp_path, strategies, capsys):
    """The setting from which ``auto`` takes its bounds is measured if it is not on the grid."""
    options = (*narrow(*strategies, bits=(1,)), "--engines", "-o", tmp_path / "out")
    assert explore(model, "--events", events, *options, "--quiet") == 0
    document = explored(tmp_path / "out")
    compiled = lc.compile(lc.load(model), calibration=events, events=events, diagnosis=False)
    bounds = {
        name: compiled.report["strategy_choice"][name]
        for name in ("min_agreement", "max_spike_error")
    }
    assert {name: document["recommended"][name] for name in bounds} == bounds
    assert settings_of(document) == [(strategy, 1) for strategy in strategies]
    assert document["recommended"]["setting"] is document["recommended"]["command"] is None
    assert document["recommended"]["why"].startswith(
        "no setting keeps what auto keeps by default, --min-agreement "
    )
    assert capsys.readouterr() == ("", "")


@pytest.mark.slow
def test_a_chip_of_narrow_weights_is_explored_up_to_its_widest(model, events, tmp_path):
    """Its bounds by default are those of ``auto`` on this chip, which has no 8 bits to start from."""
    narrow_chip = tmp_path / "narrow.yaml"
    chip_document = hw.chip("loihi-sim").document
    narrow_chip.write_text(
        chip_document.replace("\n  delay_max:", "\n  weight_bits_max: 4\n  delay_max:")
    )
    options = (
        "--strategy",
        "dendrite",
        "reset",
        "--split-weights",
        0,
        "--engines",
        "-o",
        tmp_path / "out",
        "--quiet",
    )
    assert explore(model, "--target", narrow_chip, "--events", events, *options) == 0
    explored_document = explored(tmp_path / "out")
    assert settings_of(explored_document) == [
        (strategy, bits) for strategy in ("dendrite", "reset") for bits in (1, 2, 3, 4)
    ]
    assert all(row["figures"] for row in explored_document["points"])
    compiled = lc.compile(
        lc.load(model), str(narrow_chip), calibration=events, events=events, diagnosis=False
    )
    bounds = {
        name: compiled.report["strategy_choice"][name]
        for name in ("min_agreement", "max_spike_error")
    }
    assert {name: explored_document["recommended"][name] for name in bounds} == bounds


def test_nothing_is_recommended_where_no_neuron_spikes(model, tmp_path, capsys):
    silence = tmp_path / "silence.npz"
    np.savez(silence, spikes=np.zeros((2, CHANNELS, 40), dtype=np.uint8))
    grid = narrow("dendrite", "reset")
    assert explore(model, "--events", silence, *grid, "-o", tmp_path / "out") == 0
    document = explored(tmp_path / "out")
    for row in document["points"]:
        agreements = {
            name: row["figures"][name]
            for name in ("spike_agreement", "prediction_agreement", "spike_error")
        }
        assert agreements == {
            "spike_agreement": None,
            "prediction_agreement": None,
            "spike_error": None,
        }
    why = "nothing was compared: no neuron spikes on these recordings, and all class scores tie"
    assert (document["recommended"]["setting"], document["recommended"]["why"]) == (None, why)
    lines = capsys.readouterr().out.splitlines()
    assert f"Recommended: none, {why}." in lines
    assert sum({"silent", "all", "tie"} <= set(line.split()) for line in lines) == 2
    with (tmp_path / "out/explore.csv").open() as file:
        assert {row["spike_error"] for row in csv.DictReader(file)} == {""}
    gated = ("--max-spike-error", 1, "-o", tmp_path / "gated", "--quiet")
    assert explore(model, "--events", silence, *narrow("reset"), *gated) == 3
    assert capsys.readouterr().err == (
        "gate failed: no setting keeps --max-spike-error 1; no neuron spikes on these recordings.\n"
    )


def test_the_table_of_the_csv_has_the_figures_of_the_json(small):
    with (small / "explore.csv").open() as file:
        rows = list(csv.DictReader(file))
    for row, point in zip(rows, explored(small)["points"], strict=True):
        assert {dial.name: row[dial.name] for dial in DIALS} == {
            k: str(v) for k, v in point["setting"].items()
        }
        assert float(row["energy_pj"]) == point["figures"]["energy_pj"]
        assert float(row["spike_error"]) == point["figures"]["spike_error"]
        assert (row["on_front"] == "True", row["command"]) == (
            point["on_front"],
            point["command"],
        )


def test_timings_are_a_file_of_their_own(small):
    with (small / "timings.csv").open() as file:
        rows = list(csv.DictReader(file))
    # The slow reference engine is timed on a single recording.
    assert [(row["strategy"], row["engine"], row["recordings"]) for row in rows[:2]] == [
        ("dendrite", "fast", str(RECORDINGS)),
        ("dendrite", "reference", "1"),
    ]
    points, engines = 4, 2
    assert len(rows) == points * engines
    assert all(float(row["seconds_per_recording"]) > 0 for row in rows)
    assert "seconds" not in (small / "explore.json").read_text()


@pytest.mark.parametrize("name", ["explore.svg", "timings.svg"])
def test_pictures_are_whole_and_have_a_mark_for_each_point_and_panel(small, name):
    root = ET.fromstring((small / name).read_text())
    marks = [
        element
        for element in root.iter()
        if element.get("class") in ("mark", "mark front") and len(element)
    ]
    # Both pictures have two panels: energy and time, and the two engines.
    panels = 2
    points = explored(small)["points"]
    assert len(marks) == panels * len(points)
    front = sum(row["on_front"] for row in points)
    assert sum(mark.get("class") == "mark front" for mark in marks) == panels * front


def test_finished_points_are_not_measured_again(model, events, small, monkeypatch):
    before = files_without_timings(small)
    monkeypatch.setattr(point_module, "fulfil", None)
    grid = narrow("dendrite", "reset", bits=(4, 8))
    assert explore(model, "--events", events, *grid, "-o", small, "--quiet") == 0
    assert files_without_timings(small) == before


@pytest.mark.slow
def test_an_interrupted_run_goes_on(model, events, small, tmp_path, monkeypatch, capsys):
    grid = narrow("dendrite", "reset", bits=(4, 8))
    arguments = (model, "--events", events, *grid, "-o", tmp_path / "out", "--quiet")
    measured = []

    def stopped(study, setting, limit=2):
        if len(measured) == limit:
            raise KeyboardInterrupt
        measured.append(setting)
        return point_module.measure(study, setting)

    monkeypatch.setattr("locsnn_compile.explore.sweep.measure", stopped)
    assert explore(*arguments) == 130
    assert capsys.readouterr() == ("", "Stopped. The same command resumes from here.\n")
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == ["points"]
    assert len(list((tmp_path / "out/points").iterdir())) == 2

    measured_later = []

    def counted(study, setting):
        measured_later.append(setting)
        return point_module.measure(study, setting)

    monkeypatch.setattr("locsnn_compile.explore.sweep.measure", counted)
    assert explore(*arguments) == 0
    assert [str(setting) for setting in measured_later] == ["reset, 4-bit", "reset, 8-bit"]
    assert files_without_timings(tmp_path / "out") == files_without_timings(small)


def test_the_front_is_reported_on_other_recordings(model, divided, tmp_path, capsys):
    out = tmp_path / "out"
    files = ("--events", divided, "--report-on", divided)
    assert explore(model, *files, *narrow("dendrite", "reset"), "-o", out) == 0
    stdout = capsys.readouterr().out
    document = explored(out)
    assert document["chosen_on"] == {
        "source": "touches",
        "part": "train",
        "recordings": 6,
        "available": 6,
    }
    assert document["reported_on"] == {
        "source": "touches",
        "part": "test",
        "recordings": 4,
        "available": 4,
    }
    assert "6 recordings of touches, train part" in stdout
    assert "The front on 4 recordings of touches, test part:" in stdout
    for row in document["points"]:
        assert (
            (row["reported"] is not None) == (row["report_command"] is not None) == row["on_front"]
        )
    row = next(row for row in document["points"] if row["on_front"])
    assert row["command"].endswith(f"--events {out / 'events.npz'}")
    for key, command in (("figures", row["command"]), ("reported", row["report_command"])):
        assert compile_main([*shlex.split(command)[1:], "-o", str(tmp_path / key), "--quiet"]) == 0
        figures = figures_of(tmp_path / key)
        assert {name: row[key][name] for name in vars(figures)} == vars(figures)


def test_reporting_on_what_was_chosen_on_is_said(model, tmp_path, capsys):
    few = tmp_path / "few.npy"
    np.save(few, (np.random.default_rng(2).random((3, CHANNELS, 40)) < 0.1).astype(np.uint8))
    files = ("--events", few, "--report-on", few)
    assert explore(model, *files, *narrow("dendrite"), "-o", tmp_path / "out") == 0
    warning = capsys.readouterr().out.splitlines()[1]
    assert warning == "Reported on 3 recordings that settings were also chosen on."


def test_recordings_to_report_on_are_refused_before_all_the_work(model, divided, tmp_path, capsys):
    np.save(tmp_path / "long.npy", np.ones((1, 78, 4000), np.uint8))
    np.save(tmp_path / "odd.npy", np.ones((1, 78, 40), np.uint8))
    np.save(tmp_path / "odd_labels.npy", np.array([99]))
    for name, problem in (
        ("long.npy", "the recordings are longer than the model's"),
        ("odd.npy", "a label is not one of"),
    ):
        options = (
            "--events",
            divided,
            "--report-on",
            tmp_path / name,
            *narrow("dendrite"),
            "-o",
            tmp_path / "out",
        )
        assert explore(model, *options) == 2
        assert problem in capsys.readouterr().err
        assert not (tmp_path / "out").exists()


def test_choosing_on_test_recordings_is_said(model, divided, tmp_path, capsys):
    grid = narrow("dendrite")
    assert explore(model, "--events", divided, "--part", "test", *grid, "-o", tmp_path / "out") == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[1] == "Chosen on test recordings: figures on these no longer test the choice."
    assert explored(tmp_path / "out")["chosen_on"]["part"] == "test"


def test_weights_are_rounded_for_the_recordings_compared_on(model, events, small):
    """Not for those that a model carries, which may be of its test part."""
    assert explored(small)["points"][0]["command"].endswith(
        f"--calibration {events} --events {events}"
    )


def test_calibration_recordings_can_be_given(model, events, divided, tmp_path):
    options = (
        *narrow("dendrite", bits=(4,)),
        "--engines",
        "--calibration",
        divided,
        "-o",
        tmp_path / "out",
        "--quiet",
    )
    assert explore(model, "--events", events, *options) == 0
    row = explored(tmp_path / "out")["points"][0]
    assert row["command"].endswith(f"--calibration {divided} --events {events}")
    assert (
        compile_main([*shlex.split(row["command"])[1:], "-o", str(tmp_path / "build"), "--quiet"])
        == 0
    )
    figures = figures_of(tmp_path / "build")
    assert {name: row["figures"][name] for name in vars(figures)} == vars(figures)


def test_names_of_the_options_are_those_of_the_readers():
    explore = next(
        action.choices for action in parser()._actions if isinstance(action.choices, dict)
    )["explore"]
    choices = {action.dest: action.choices for action in explore._actions}
    assert choices["part"] == list(PARTS)
    assert sorted(choices["engines"]) == sorted(ENGINES) == sorted(explore_cli.ENGINES)


def test_without_events_touches_are_made(model, tmp_path, capsys):
    grid = (*narrow("dendrite"), "--engines")
    assert explore(model, *grid, "-o", tmp_path / "out") == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == "small on loihi-sim, 16 recordings of synthetic touches, profile davies2018"
    row = explored(tmp_path / "out")["points"][0]
    assert row["figures"]["accuracy"] is None
    assert (
        compile_main([*shlex.split(row["command"])[1:], "-o", str(tmp_path / "build"), "--quiet"])
        == 0
    )
    assert (tmp_path / "out/timings.csv").read_bytes() == b""


def test_a_bound_takes_recordings_evenly(model, events, tmp_path):
    arguments = ("--recordings", 3, *narrow("dendrite"), "--engines", "-o", tmp_path / "out")
    assert explore(model, "--events", events, *arguments, "--quiet") == 0
    assert explored(tmp_path / "out")["chosen_on"]["recordings"] == 3
    played, available = np.load(tmp_path / "out/events.npz"), np.load(events)
    assert np.array_equal(played["spikes"], available["spikes"][[0, 2, 4]])
    assert np.array_equal(played["labels"], available["labels"][[0, 2, 4]])


@pytest.mark.parametrize(
    "budget",
    [("--max-spike-error", 1), ("--min-agreement", 0, "--max-spike-error", 1)],
    ids=["one", "both"],
)
def test_a_budget_takes_the_cheapest_that_keeps_it(model, events, small, budget, capsys):
    grid = narrow("dendrite", "reset", bits=(4, 8))
    assert explore(model, "--events", events, *grid, *budget, "-o", small, "--json") == 0
    document = json.loads(capsys.readouterr().out)
    front = [row for row in document["points"] if row["on_front"]]
    assert (
        document["recommended"]["setting"]
        == min(front, key=lambda row: row["figures"]["energy_pj"])["setting"]
    )
    assert document["recommended"]["why"].startswith("the least energy, ")


def test_a_budget_that_nothing_keeps_is_a_gate_that_fails(model, events, tmp_path, capsys):
    grid = (*narrow("reset", bits=(1,)), "--engines")
    arguments = (*grid, "--max-spike-error", 0, "-o", tmp_path / "out", "--json")
    assert explore(model, "--events", events, *arguments) == 3
    printed = capsys.readouterr()
    recommended = json.loads(printed.out)["recommended"]
    assert recommended["setting"] is recommended["command"] is None
    assert recommended["why"].startswith(
        "no setting keeps --max-spike-error 0; the least spike error is "
    )
    assert printed.err == f"gate failed: {recommended['why']}.\n"


def test_refused_settings_are_rows_with_their_reason(model, events, tmp_path, capsys):
    """A chip of a single small core, which three compartments per neuron do not fit."""
    text = hw.chip("loihi-sim").document
    chip = tmp_path / "tiny.yaml"
    tiny = text
    for old, new in (
        ("compartments_per_core: 1024", "compartments_per_core: 20"),
        ("cores_per_chip: 128", "cores_per_chip: 1"),
        ("columns: 8", "columns: 1"),
        ("rows: 4", "rows: 1"),
        ("cores_per_tile: 4", "cores_per_tile: 1"),
    ):
        tiny = tiny.replace(old, new)
    chip.write_text(tiny)
    assert tiny != text
    grid = (*narrow("dendrite", "delay-line", "reset"), "--target", chip, "--engines")
    assert explore(model, "--events", events, *grid, "-o", tmp_path / "out") == 0
    document = explored(tmp_path / "out")
    printed_refusals = [
        line
        for line in capsys.readouterr().out.splitlines()
        if line.startswith("dendrite, 8-bit: ")
    ]
    refused = [row for row in document["points"] if row["refused"]]
    assert [row["setting"]["strategy"] for row in refused] == ["dendrite"]
    assert printed_refusals == [f"dendrite, 8-bit: {refused[0]['refused']}"]
    assert refused[0]["figures"] is None
    assert not refused[0]["on_front"]


def test_what_all_settings_share_is_one_error(model, tmp_path, capsys):
    long = tmp_path / "long.npz"
    np.savez(long, spikes=np.zeros((2, 78, 41), dtype=np.uint8))
    assert explore(model, "--events", long, "-o", tmp_path / "out") == 2
    line = f"events {str(long)!r}: the recordings are longer than the model's (41 steps against 40). Cut them to 40 steps.\n"
    assert capsys.readouterr() == ("", line)
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("arguments", "line"),
    [
        (("--weight-bits", 7), "--weight-bits 7: it is not known. Choose from 1, 2, 3, 4, 5, 6, 8."),
        (("--strategy", "dendrites"), "--strategy dendrites: it is not known. Did you mean 'dendrite'?"),
        (("--engines", "quick"), "--engines quick: it is not known. Choose one of: fast, reference."),
        (("--part", "training"), "--part training: it is not known. Did you mean 'train'?"),
        (("--part", "train"), "--part train: there are no events to take it from. Give them with --events."),
        (("--recordings", 0), "--recordings 0: it is out of range. Give a number from 1 up."),
        (("--workers", 0), "--workers 0: it is out of range. Give a number from 1 to 256."),
        (("--workers", 1000), "--workers 1000: it is out of range. Give a number from 1 to 256."),
        (("--min-agreement", 1.5), "--min-agreement 1.5: it is out of range. Give a number from 0 to 1."),
        (("--max-spike-error", "nan"), "--max-spike-error nan: it is out of range. Give a number from 0 to 1."),
        (("--workers", 2, "--scheduler", "tcp://a:1"), "--workers: a scheduler has workers of its own. Leave out --workers or --scheduler."),
        (("--events", "gone.npz"), "file 'gone.npz': it does not exist. Check the path."),
        (("--target", "loihi"), "target 'loihi': no chip of this name ships. Did you mean 'loihi-sim'? A chip file of your own ends in .yaml."),
    ],
    ids=lambda value: "_".join(map(str, value)) if isinstance(value, tuple) else None,
)  # fmt: skip
def test_wrong_usage_is_one_line(model, arguments, line, tmp_path, capsys):
    assert explore(model, *arguments, "-o", tmp_path / "out") == 2
    assert capsys.readouterr() == ("", line + "\n")
    assert not (tmp_path / "out").exists()


def test_only_a_test_part_is_refused(model, divided, tmp_path, capsys):
    shutil.copytree(divided / "test", tmp_path / "some/test")
    assert explore(model, "--events", tmp_path / "some", "-o", tmp_path / "out") == 2
    line = f"events {str(tmp_path / 'some')!r}: it has only a test part, and no setting may be chosen on that. Give other recordings, or say so with --part test.\n"
    assert capsys.readouterr() == ("", line)


def test_the_bar_moves_with_each_setting(model, events, tmp_path, monkeypatch):
    calls = []

    @contextmanager
    def bar(title, *, show):
        yield lambda done, total: calls.append((title, done, total))

    monkeypatch.setattr(explore_cli, "progress_bar", bar)
    grid = (*narrow("dendrite", bits=(4, 8)), "--engines")
    assert explore(model, "--events", events, *grid, "-o", tmp_path / "out", "--quiet") == 0
    assert calls == [("exploring", 0, 2), ("exploring", 1, 2), ("exploring", 2, 2)]
