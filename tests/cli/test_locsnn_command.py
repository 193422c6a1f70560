"""``locsnn run``, ``diff``, ``targets`` and the help of all commands.

Figures of a run are compared with the report of the build, which other code computed.
"""

import json
import re
from pathlib import Path

import numpy as np
import pytest
import yaml

import hw_model as hw
from hw_model.spinnaker.chips import spinnaker_chip_names
from hw_model.xylo.chips import xylo_chip_names
from locsnn_compile.cli.compile import main as compile_main
from locsnn_compile.cli.main import main

ROOT = Path(__file__).parents[2]
MODEL = ROOT / "examples/models/objects-hybrid.pt"


@pytest.fixture(scope="module")
def build(tmp_path_factory):
    """A folder with three random recordings, and a program that was checked on them."""
    folder = tmp_path_factory.mktemp("build")
    r = np.random.default_rng(0)
    np.save(folder / "few.npy", (r.random((3, 78, 60)) < 0.1).astype(np.uint8))
    np.save(folder / "few_labels.npy", np.array([0, 1, 2]))
    arguments = [MODEL, "--events", folder / "few.npy", "-o", folder / "out", "--quiet"]
    assert compile_main([str(a) for a in arguments]) == 0
    return folder


@pytest.mark.slow
@pytest.mark.parametrize("engine", ["fast", "reference"])
def test_run_predicts_as_the_report_counted(build, capsys, engine):
    assert (
        main(
            [
                "run",
                str(build / "out"),
                "--events",
                str(build / "few.npy"),
                "--engine",
                engine,
                "--json",
            ]
        )
        == 0
    )
    document = json.loads(capsys.readouterr().out)
    report = json.loads((build / "out/report.json").read_text())
    right = sum(
        row["prediction"] == row["label"] and not row["tied"] for row in document["recordings"]
    )
    assert right / 3 == report["accuracy"]["chip"]
    assert document["counts"]["spikes"] / 3 == report["operations"]["per_sample"]["spikes"]
    assert sum(document["energy_pj"].values()) / 3 == pytest.approx(
        report["energy"]["per_sample_pj"]
    )


@pytest.mark.slow
def test_run_prints_a_line_a_recording(build, capsys):
    assert main(["run", str(build / "out"), "--events", str(build / "few.npy")]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split(":")[0] for line in lines[:3]] == [
        "recording 0",
        "recording 1",
        "recording 2",
    ]
    assert lines[3].startswith("accuracy ")
    assert "profile davies2018" in lines[4]


def test_where_all_classes_tie_run_predicts_nothing_as_the_report_does(build, tmp_path, capsys):
    np.save(tmp_path / "silent.npy", np.zeros((2, 78, 60), np.uint8))
    # The first class, which ties would go to.
    np.save(tmp_path / "silent_labels.npy", np.array([0, 0]))
    assert main(["run", str(build / "out"), "--events", str(tmp_path / "silent.npy")]) == 0
    assert capsys.readouterr().out.splitlines()[:3] == [
        "recording 0: all classes tie  label 0  0 spikes",
        "recording 1: all classes tie  label 0  0 spikes",
        "accuracy 0.000 on 2 recordings",
    ]
    stop = ["--stop", "silence", "--silence", "5"]
    assert (
        main(["run", str(build / "out"), "--events", str(tmp_path / "silent.npy"), "--json", *stop])
        == 0
    )
    document = json.loads(capsys.readouterr().out)
    assert document["recordings"][0]["tied"] is True
    assert (document["stop"]["accuracy"], document["stop"]["whole_accuracy"]) == (0.0, 0.0)


def test_run_refuses_labels_of_classes_that_the_program_does_not_have(build, tmp_path, capsys):
    np.save(tmp_path / "others.npy", np.zeros((2, 78, 60), np.uint8))
    np.save(tmp_path / "others_labels.npy", np.array([35, 36]))
    assert main(["run", str(build / "out"), "--events", str(tmp_path / "others.npy")]) == 2
    line = "labels of --events: no class has this number (36 against 35). Check that the recordings belong to this program.\n"  # fmt: skip
    assert capsys.readouterr() == ("", line)


def test_run_refuses_recordings_of_another_sensor(build, tmp_path, capsys):
    few = tmp_path / "few.npz"
    np.savez(few, spikes=np.zeros((2, 5, 250), dtype=np.uint8))
    assert main(["run", str(build / "out"), "--events", str(few)]) == 2
    what = "the channel count differs from the program's (5 channels against 78)"
    assert capsys.readouterr() == ("", f"events '{few}': {what}. Give recordings of 78 channels.\n")


def test_run_refuses_programs_of_several_inputs(tmp_path, capsys):
    builder = hw.ProgramBuilder(hw.chip("tiny-sim"), name="two")
    output = builder.add_compartments("y", 1, threshold=1)
    for name in ("x", "z"):
        builder.connect(builder.add_input(name, 2), output, [[2, 4]])
    builder.read_out(output)
    builder.build().save(tmp_path / "two")
    np.save(tmp_path / "few.npy", np.ones((1, 2, 5), np.uint8))
    assert (
        main(
            [
                "run",
                str(tmp_path / "two"),
                "--events",
                str(tmp_path / "few.npy"),
                "--axes",
                "samples,channels,steps",
            ]
        )
        == 2
    )
    line = f"events {str(tmp_path / 'few.npy')!r}: the program has several inputs, and a file holds one (x, z). Play it in Python, by hw.simulate.\n"
    assert capsys.readouterr() == ("", line)


def test_run_refuses_recordings_that_last_longer_than_the_program(build, tmp_path, capsys):
    """What comes after its last step was left out silently, where locsnn-compile refuses it."""
    long = tmp_path / "long.npz"
    np.savez(long, spikes=np.ones((1, 78, 251), dtype=np.uint8), step_seconds=0.02)
    assert main(["run", str(build / "out"), "--events", str(long)]) == 2
    line = f"events '{long}': the recordings are longer than the program (251 steps against 250). Cut them with --steps 250.\n"
    assert capsys.readouterr() == ("", line)
    assert main(["run", str(build / "out"), "--events", str(long), "--steps", "250"]) == 0
    assert capsys.readouterr().out.endswith(
        "binning: 78 of 19578 events dropped: 78 outside the steps\n"
    )


@pytest.mark.parametrize(
    ("arguments", "line"),
    [
        (["run", "gone", "--events", "few.npy"], "program 'gone', program.yaml: it cannot be read (No such file or directory). Give the folder that the compiler wrote."),
        (["diff", "gone", "gone"], "build 'gone', report.json: it cannot be read (No such file or directory). Give a folder that locsnn-compile wrote."),
        (["targets", "--show", "loihi"], "target 'loihi': no chip of this name ships. Did you mean 'loihi-sim'? A chip file of your own ends in .yaml."),
    ],
    ids=["no program", "no build", "no chip"],
)  # fmt: skip
def test_bad_input_is_one_line(arguments, line, capsys):
    assert main(arguments) == 2
    assert capsys.readouterr() == ("", line + "\n")


def test_targets_lists_and_shows(capsys):
    assert main(["targets"]) == 0
    lines = capsys.readouterr().out.splitlines()
    names = [line.split(":")[0] for line in lines if not line.startswith(" ")]
    assert names == [*hw.chip_names(), *xylo_chip_names(), *spinnaker_chip_names()]
    assert lines[:2] == [
        "ecp5-25f: the open core on a Lattice ECP5 with 24,288 LUTs and 56 block RAMs",
        "  a program may have 512 compartments, 1024 sources of spikes, 16384 synapses, 16 slots; cycles are exact, "
        "energy is not known",
    ]
    assert main(["targets", "--show", "loihi-sim"]) == 0
    assert yaml.safe_load(capsys.readouterr().out)["name"] == "loihi-sim"


@pytest.mark.parametrize(
    "command",
    ["train", "pack", "run", "explore", "diff", "rtl sim", "rtl fit", "rtl stream", "targets"],
)
def test_every_help_shows_an_example(command, capsys):
    with pytest.raises(SystemExit) as caught:
        main([*command.split(), "--help"])
    assert caught.value.code == 0
    assert f"example:\n  locsnn {command} " in capsys.readouterr().out


@pytest.mark.slow
def test_diff_names_what_changed(build, tmp_path, capsys):
    arguments = [
        MODEL,
        "--events",
        build / "few.npy",
        "-o",
        tmp_path / "four",
        "--quiet",
        "--weight-bits",
        "4",
    ]
    assert compile_main([str(a) for a in arguments]) == 0
    assert main(["diff", str(build / "out"), str(tmp_path / "four"), "--json"]) == 0
    changed = json.loads(capsys.readouterr().out)
    assert changed["weight_bits"] == {"before": 8, "after": 4}
    assert "model.sha256" not in changed
    assert not [key for key in changed if "histogram" in key]
    assert main(["diff", str(build / "out"), str(tmp_path / "four"), "--all"]) == 0
    stdout = capsys.readouterr().out
    assert "weight_bits: 8 -> 4 (-50.0 %)" in stdout.splitlines()
    assert "The chips differ" not in stdout
    page = tmp_path / "diff.html"
    assert main(["diff", str(build / "out"), str(tmp_path / "four"), "--html", str(page)]) == 0
    summary = capsys.readouterr().out
    html = page.read_text(encoding="utf-8")
    assert "<h1>out → four</h1>" in html
    lines = summary.splitlines()
    assert lines[0] == "out → four"
    assert lines[-1] == "--all lists every figure that changed."
    assert re.search(r"^  spikes on one side only \d", summary, flags=re.MULTILINE)
    assert len(lines) < 40
    for question in (
        "Does it match as well?",
        "Does it cost less?",
        "Does it use fewer resources?",
    ):
        assert question in html
        assert question in summary
    assert main(["diff", str(build / "out"), str(build / "out")]) == 0
    assert capsys.readouterr().out == "The builds are equal.\n"


def test_diff_refuses_a_report_that_is_not_of_its_program(build, tmp_path, capsys):
    report = json.loads((build / "out/report.json").read_text())
    synapses = report["resources"]["synapses"]
    report["resources"]["synapses"] += 1
    for name in ("program.yaml", "program.npz"):
        (tmp_path / name).write_bytes((build / "out" / name).read_bytes())
    (tmp_path / "report.json").write_text(json.dumps(report))
    assert main(["diff", str(build / "out"), str(tmp_path)]) == 2
    line = f"build {str(tmp_path)!r}: report.json counts other synapses than the program has ({synapses + 1} against {synapses}). Compile again.\n"  # fmt: skip
    assert capsys.readouterr() == ("", line)


@pytest.mark.parametrize(
    ("content", "line"),
    [
        ("{", "report.json is damaged"),
        ("[]", "report.json is not a report"),
        ('{"schema": 1}', "report.json is not a report"),
    ],
    ids=["damaged", "list", "other"],
)
def test_reports_that_are_none(tmp_path, content, line, capsys):
    (tmp_path / "report.json").write_text(content)
    assert main(["diff", str(tmp_path), str(tmp_path)]) == 2
    message = f"build {str(tmp_path)!r}: {line}. Give a folder that locsnn-compile wrote.\n"
    assert capsys.readouterr() == ("", message)


@pytest.mark.parametrize("columns", ["40", "80"])
@pytest.mark.parametrize("command", ["run", "train", "explore", "stress", "rtl sim"])
def test_help_breaks_no_name_at_a_hyphen(command, columns, monkeypatch, capsys):
    monkeypatch.setenv("COLUMNS", columns)
    with pytest.raises(SystemExit):
        main([*command.split(), "--help"])
    help_ = capsys.readouterr().out.partition("options:")[2]
    assert [line for line in help_.splitlines() if line.endswith("-")] == []
