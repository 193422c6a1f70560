"""``locsnn explore`` from the command line: figures, files, commands, what stops it, and going on."""

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
from tests.support.explored_model import explore, explored, figures_of, lasting, narrow

FILES = {"explore.json", "explore.csv", "explore.svg", "timings.csv", "timings.svg"}


@pytest.fixture(scope="module")
def small(model, events, tmp_path_factory):
    """Two strategies, two widths."""
    folder = tmp_path_factory.mktemp("explored") / "out"
    grid = narrow("dendrite", "reset", bits=(4, 8))
    assert explore(model, "--events", events, *grid, "-o", folder, "--quiet") == 0
    return folder


def settings_of(document):
    return [
        (row["setting"]["strategy"], row["setting"]["weight_bits"]) for row in document["points"]
    ]


def test_the_grid_is_complete_and_in_order(small):
    found = explored(small)
    assert settings_of(found) == [("dendrite", 4), ("dendrite", 8), ("reset", 4), ("reset", 8)]
    assert found["schema"] == "locsnn-explore/1"
    assert found["model"]["name"] == "small"
    assert found["chosen_on"] == {
        "source": "few.npz",
        "part": None,
        "recordings": 5,
        "available": 5,
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
    found = explored(small)
    front = [row for row in found["points"] if row["on_front"]]
    taken = [row for row in found["points"] if row["recommended"]]
    assert len(taken) == 1
    assert taken[0] in front
    assert found["recommended"]["setting"] == taken[0]["setting"]
    assert found["recommended"]["command"] == taken[0]["command"]
    assert (
        " on the front within what auto keeps by default, --min-agreement "
        in found["recommended"]["why"]
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    "strategies", [("dendrite", "reset"), ("reset",)], ids=["on the grid", "not on the grid"]
)
def test_bounds_by_default_are_those_of_auto(model, events, tmp_path, strategies, capsys):
    """What ``auto`` starts from is measured where the grid has it not."""
    options = (*narrow(*strategies, bits=(1,)), "--engines", "-o", tmp_path / "out")
    assert explore(model, "--events", events, *options, "--quiet") == 0
    found = explored(tmp_path / "out")
    compiled = lc.compile(lc.load(model), calibration=events, events=events, diagnosis=False)
    bounds = {
        name: compiled.report["strategy_choice"][name]
        for name in ("min_agreement", "max_spike_error")
    }
    assert {name: found["recommended"][name] for name in bounds} == bounds
    assert settings_of(found) == [(strategy, 1) for strategy in strategies]
    assert found["recommended"]["setting"] is found["recommended"]["command"] is None
    assert found["recommended"]["why"].startswith(
        "no setting keeps what auto keeps by default, --min-agreement "
    )
    assert capsys.readouterr() == ("", "")


@pytest.mark.slow
def test_a_chip_of_narrow_weights_is_explored_up_to_its_widest(model, events, tmp_path):
    """Its bounds by default are those of ``auto`` on this chip, which has no 8 bits to start from."""
    narrow_chip = tmp_path / "narrow.yaml"
    document = hw.chip("loihi-sim").document
    narrow_chip.write_text(
        document.replace("\n  delay_max:", "\n  weight_bits_max: 4\n  delay_max:")
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
    found = explored(tmp_path / "out")
    assert settings_of(found) == [
        (strategy, bits) for strategy in ("dendrite", "reset") for bits in (1, 2, 3, 4)
    ]
    assert all(row["figures"] for row in found["points"])
    compiled = lc.compile(
        lc.load(model), str(narrow_chip), calibration=events, events=events, diagnosis=False
    )
    bounds = {
        name: compiled.report["strategy_choice"][name]
        for name in ("min_agreement", "max_spike_error")
    }
    assert {name: found["recommended"][name] for name in bounds} == bounds


def test_nothing_is_recommended_where_no_neuron_spikes(model, tmp_path, capsys):
    silence = tmp_path / "silence.npz"
    np.savez(silence, spikes=np.zeros((2, 78, 40), dtype=np.uint8))
    assert (
        explore(model, "--events", silence, *narrow("dendrite", "reset"), "-o", tmp_path / "out")
        == 0
    )
    found = explored(tmp_path / "out")
    for row in found["points"]:
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
    assert (found["recommended"]["setting"], found["recommended"]["why"]) == (None, why)
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
    for row, wanted in zip(rows, explored(small)["points"], strict=True):
        assert {dial.name: row[dial.name] for dial in DIALS} == {
            k: str(v) for k, v in wanted["setting"].items()
        }
        assert float(row["energy_pj"]) == wanted["figures"]["energy_pj"]
        assert float(row["spike_error"]) == wanted["figures"]["spike_error"]
        assert (row["on_front"] == "True", row["command"]) == (
            wanted["on_front"],
            wanted["command"],
        )


def test_timings_are_a_file_of_their_own(small):
    with (small / "timings.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [(row["strategy"], row["engine"], row["recordings"]) for row in rows[:2]] == [
        ("dendrite", "fast", "5"),
        ("dendrite", "reference", "1"),
    ]
    assert len(rows) == 8
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
    assert len(marks) == 2 * 4
    front = sum(row["on_front"] for row in explored(small)["points"])
    assert sum(mark.get("class") == "mark front" for mark in marks) == 2 * front


def test_finished_points_are_not_measured_again(model, events, small, monkeypatch):
    before = lasting(small)
    monkeypatch.setattr(point_module, "fulfil", None)
    grid = narrow("dendrite", "reset", bits=(4, 8))
    assert explore(model, "--events", events, *grid, "-o", small, "--quiet") == 0
    assert lasting(small) == before


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

    again = []

    def counted(study, setting):
        again.append(setting)
        return point_module.measure(study, setting)

    monkeypatch.setattr("locsnn_compile.explore.sweep.measure", counted)
    assert explore(*arguments) == 0
    assert [str(setting) for setting in again] == ["reset, 4-bit", "reset, 8-bit"]
    assert lasting(tmp_path / "out") == lasting(small)


def test_the_front_is_reported_on_other_recordings(model, divided, tmp_path, capsys):
    out = tmp_path / "out"
    assert (
        explore(
            model,
            "--events",
            divided,
            "--report-on",
            divided,
            *narrow("dendrite", "reset"),
            "-o",
            out,
        )
        == 0
    )
    printed = capsys.readouterr().out
    found = explored(out)
    assert found["chosen_on"] == {
        "source": "touches",
        "part": "train",
        "recordings": 6,
        "available": 6,
    }
    assert found["reported_on"] == {
        "source": "touches",
        "part": "test",
        "recordings": 4,
        "available": 4,
    }
    assert "6 recordings of touches, train part" in printed
    assert "The front on 4 recordings of touches, test part:" in printed
    for row in found["points"]:
        assert (
            (row["reported"] is not None) == (row["report_command"] is not None) == row["on_front"]
        )
    row = next(row for row in found["points"] if row["on_front"])
    assert row["command"].endswith(f"--events {out / 'events.npz'}")
    for key, command in (("figures", row["command"]), ("reported", row["report_command"])):
        assert compile_main([*shlex.split(command)[1:], "-o", str(tmp_path / key), "--quiet"]) == 0
        figures = figures_of(tmp_path / key)
        assert {name: row[key][name] for name in vars(figures)} == vars(figures)


def test_reporting_on_what_was_chosen_on_is_said(model, tmp_path, capsys):
    np.save(
        tmp_path / "few.npy", (np.random.default_rng(2).random((3, 78, 40)) < 0.1).astype(np.uint8)
    )
    few = tmp_path / "few.npy"
    assert (
        explore(
            model, "--events", few, "--report-on", few, *narrow("dendrite"), "-o", tmp_path / "out"
        )
        == 0
    )
    assert (
        capsys.readouterr().out.splitlines()[1]
        == "Reported on 3 recordings that settings were also chosen on."
    )


def test_recordings_to_report_on_are_refused_before_all_the_work(model, divided, tmp_path, capsys):
    np.save(tmp_path / "long.npy", np.ones((1, 78, 4000), np.uint8))
    np.save(tmp_path / "odd.npy", np.ones((1, 78, 40), np.uint8))
    np.save(tmp_path / "odd_labels.npy", np.array([99]))
    for name, said in (
        ("long.npy", "the recordings are longer than the model's"),
        ("odd.npy", "a label is not one of"),
    ):
        given = (
            "--events",
            divided,
            "--report-on",
            tmp_path / name,
            *narrow("dendrite"),
            "-o",
            tmp_path / "out",
        )
        assert explore(model, *given) == 2
        assert said in capsys.readouterr().err
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
    grid = (*narrow("dendrite"), "--engines")
    assert (
        explore(
            model, "--events", events, "--recordings", 3, *grid, "-o", tmp_path / "out", "--quiet"
        )
        == 0
    )
    assert explored(tmp_path / "out")["chosen_on"]["recordings"] == 3
    played, given = np.load(tmp_path / "out/events.npz"), np.load(events)
    assert np.array_equal(played["spikes"], given["spikes"][[0, 2, 4]])
    assert np.array_equal(played["labels"], given["labels"][[0, 2, 4]])


@pytest.mark.parametrize(
    "budget",
    [("--max-spike-error", 1), ("--min-agreement", 0, "--max-spike-error", 1)],
    ids=["one", "both"],
)
def test_a_budget_takes_the_cheapest_that_keeps_it(model, events, small, budget, capsys):
    grid = narrow("dendrite", "reset", bits=(4, 8))
    assert explore(model, "--events", events, *grid, *budget, "-o", small, "--json") == 0
    found = json.loads(capsys.readouterr().out)
    rows = [row for row in found["points"] if row["on_front"]]
    assert (
        found["recommended"]["setting"]
        == min(rows, key=lambda row: row["figures"]["energy_pj"])["setting"]
    )
    assert found["recommended"]["why"].startswith("the least energy, ")


def test_a_budget_that_nothing_keeps_is_a_gate_that_fails(model, events, tmp_path, capsys):
    grid = (*narrow("reset", bits=(1,)), "--engines")
    assert (
        explore(
            model,
            "--events",
            events,
            *grid,
            "--max-spike-error",
            0,
            "-o",
            tmp_path / "out",
            "--json",
        )
        == 3
    )
    printed = capsys.readouterr()
    found = json.loads(printed.out)["recommended"]
    assert found["setting"] is found["command"] is None
    assert found["why"].startswith(
        "no setting keeps --max-spike-error 0; the least spike error is "
    )
    assert printed.err == f"gate failed: {found['why']}.\n"


def test_refused_settings_are_rows_with_their_reason(model, events, tmp_path, capsys):
    """A chip that three compartments a neuron do not fit."""
    text = hw.chip("loihi-sim").document
    chip = tmp_path / "tiny.yaml"
    tiny = text
    for key, old, new in (
        *(("compartments_per_core", 1024, 20), ("cores_per_chip", 128, 1)),
        *(("columns", 8, 1), ("rows", 4, 1), ("cores_per_tile", 4, 1)),
    ):
        tiny = tiny.replace(f"{key}: {old}", f"{key}: {new}")
    chip.write_text(tiny)
    assert tiny != text
    grid = (*narrow("dendrite", "delay-line", "reset"), "--target", chip, "--engines")
    assert explore(model, "--events", events, *grid, "-o", tmp_path / "out") == 0
    found = explored(tmp_path / "out")
    said = [
        line
        for line in capsys.readouterr().out.splitlines()
        if line.startswith("dendrite, 8-bit: ")
    ]
    refused = [row for row in found["points"] if row["refused"]]
    assert [row["setting"]["strategy"] for row in refused] == ["dendrite"]
    assert said == [f"dendrite, 8-bit: {refused[0]['refused']}"]
    assert refused[0]["figures"] is None
    assert not refused[0]["on_front"]


def test_what_all_settings_share_is_one_error(model, tmp_path, capsys):
    long = tmp_path / "long.npz"
    np.savez(long, spikes=np.zeros((2, 78, 41), dtype=np.uint8))
    assert explore(model, "--events", long, "-o", tmp_path / "out") == 2
    wanted = f"events {str(long)!r}: the recordings are longer than the model's (41 steps against 40). Cut them to 40 steps.\n"
    assert capsys.readouterr() == ("", wanted)
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
    wanted = f"events {str(tmp_path / 'some')!r}: it has only a test part, and no setting may be chosen on that. Give other recordings, or say so with --part test.\n"
    assert capsys.readouterr() == ("", wanted)


def test_the_bar_moves_with_each_setting(model, events, tmp_path, monkeypatch):
    moved = []

    @contextmanager
    def bar(title, *, show):
        yield lambda done, total: moved.append((title, done, total))

    monkeypatch.setattr(explore_cli, "progress_bar", bar)
    grid = (*narrow("dendrite", bits=(4, 8)), "--engines")
    assert explore(model, "--events", events, *grid, "-o", tmp_path / "out", "--quiet") == 0
    assert moved == [("exploring", 0, 2), ("exploring", 1, 2), ("exploring", 2, 2)]
