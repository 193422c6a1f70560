"""``locsnn-compile`` end to end: the files that it writes, what it prints and returns, and its messages for bad input.

Messages are compared whole; the program of a build is simulated again and compared with the report.
"""

import json
import os
import pickle
import re
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
import torch
import yaml

import hw_model as hw
from locsnn_compile.cli.build import written_names
from locsnn_compile.cli.compile import main
from locsnn_compile.emitters import EMITTERS, LEVEL_KINDS, NAMES_IN_FOLDERS

ROOT = Path(__file__).parents[2]
MODEL = ROOT / "examples/models/objects-hybrid.pt"
COARSEST = "--weight-bits 1 --split-weights 0"
"""Weights so coarse that predictions change."""
FILES = {"program.yaml", "program.npz", "report.json", "report.md", "report.html"}
EMITTED = {
    "vectors",
    "rtl",
    "waves.vcd",
    "trace.json",
    "sanafe",
    "program.graphml",
    "program.dot",
    "csv",
    "events.npz",
}


@pytest.fixture(scope="module")
def few(tmp_path_factory):
    """Three short recordings: enough to compare on, quick to run."""
    path = tmp_path_factory.mktemp("events") / "few.npy"
    r = np.random.default_rng(0)
    np.save(path, (r.random((3, 78, 60)) < 0.1).astype(np.uint8))
    return path


def run(*arguments):
    """Run ``locsnn-compile``; return the exit code."""
    return main([str(argument) for argument in arguments])


def build(few, folder, *arguments):
    """Build quietly with a strategy given, where it does not matter which one ``auto`` would choose."""
    return run(
        MODEL, "--events", few, "-o", folder, "--quiet", "--strategy", "dendrite", *arguments
    )


@pytest.mark.slow
def test_a_build_is_whole_and_its_program_runs(few, tmp_path, capsys):
    assert run(MODEL, "--events", few, "-o", tmp_path / "out") == 0
    assert {path.name for path in (tmp_path / "out").iterdir()} == FILES
    program = hw.load_program(tmp_path / "out")
    report = json.loads((tmp_path / "out/report.json").read_text())
    # The recordings have 60 steps, and silence follows them up to the 250 of the model.
    spikes = np.pad(np.load(few).transpose(0, 2, 1), ((0, 0), (0, 250 - 60), (0, 0)))
    result = hw.simulate(program, spikes)
    assert result.counts.synaptic_ops / 3 == report["operations"]["per_sample"]["synaptic_ops"]
    stdout = capsys.readouterr().out
    assert "objects-hybrid" in stdout
    assert str(tmp_path / "out") in stdout


@pytest.mark.slow
def test_what_an_earlier_build_emitted_is_named(few, tmp_path, capsys):
    out = tmp_path / "out"
    out.mkdir()
    (out / "trace.json").write_text("mine")
    first = ("--emit", "vectors", "csv", "vcd", "network")
    assert build(few, out, *first) == 0
    assert build(few, out) == 0
    assert build(few, out, "--emit", "csv") == 0
    assert capsys.readouterr() == ("", ""), "the same build"
    assert build(few, out, "--weight-bits", "4", "--emit", "csv") == 0
    names = "network.txt, vectors/, waves.vcd and trace.json"
    warning = (
        f"-o {str(out)!r}: an earlier build left {names} there. Emit them again, or remove them.\n"
    )
    assert capsys.readouterr() == ("", warning)
    assert (out / "waves.vcd").is_file()
    assert (out / "trace.json").read_text() == "mine"


@pytest.mark.slow
def test_json_prints_the_report_and_nothing_else(few, tmp_path, capsys):
    assert run(MODEL, "--events", few, "-o", tmp_path, "--json") == 0
    captured = capsys.readouterr()
    assert captured.out == (tmp_path / "report.json").read_text()
    assert captured.err == ""
    keys = list(json.loads(captured.out))
    assert keys[:13] == [
        "schema", "model", "target", "strategy", "weight_bits", "match", "accuracy", "operations", "energy", "latency",
        "resources", "ann_comparison", "skipped",
    ]  # fmt: skip


@pytest.mark.slow
def test_a_chip_of_ones_own_brings_its_own_profile(few, tmp_path, capsys):
    document = yaml.safe_load(hw.chip("loihi-sim").document)
    document["profiles"] = {"bench": document["profiles"]["sanafe"]}
    (tmp_path / "mine.yaml").write_text(yaml.safe_dump(document))
    assert (
        run(
            MODEL,
            "--events",
            few,
            "-o",
            tmp_path / "out",
            "--target",
            tmp_path / "mine.yaml",
            "--json",
        )
        == 0
    )
    report = json.loads(capsys.readouterr().out)
    assert (report["energy"]["profile"], report["latency"]["profile"]) == ("bench", "bench")
    assert report["energy"]["other_profiles_pj"] == {}


def test_quiet_prints_nothing(few, tmp_path, capsys):
    assert build(few, tmp_path) == 0
    assert capsys.readouterr() == ("", "")


@pytest.mark.slow
def test_two_runs_write_the_same_bytes(few, tmp_path):
    """In fresh interpreters with different hash seeds: nothing may depend on the order of a set."""
    # For other chips, or for networks or chips without something that this one has.
    unwritable = ("lava", "nir", "net", "pynn", "viewer", "xylo")
    kinds = [emitter.kind for emitter in EMITTERS if emitter.kind not in unwritable]
    for name, seed in (("one", "1"), ("two", "2")):
        command = [
            sys.executable,
            "-m",
            "locsnn_compile.cli.compile",
            str(MODEL),
            "--events",
            str(few),
            "--quiet",
        ]
        command += ["-o", str(tmp_path / name), "--emit", *kinds]
        process = subprocess.run(
            command,
            env={**os.environ, "PYTHONHASHSEED": seed},
            capture_output=True,
            text=True,
            check=False,
        )
        assert (process.returncode, process.stdout, process.stderr) == (0, "", "")
    first_build, second_build = tmp_path / "one", tmp_path / "two"
    levels = {f"{kind}.txt" for kind in LEVEL_KINDS}
    assert {path.name for path in first_build.iterdir()} == FILES | levels | EMITTED
    written = {path.relative_to(first_build) for path in first_build.rglob("*")}
    assert {path.name for path in first_build.iterdir()} == {
        name.strip("/") for name in written_names(kinds)
    }
    nested = [
        name.as_posix()
        for name in written
        if len(name.parts) > 1 and (first_build / name).is_file()
    ]
    assert [name for name in nested if not re.fullmatch(NAMES_IN_FOLDERS, name)] == []
    assert written == {path.relative_to(second_build) for path in second_build.rglob("*")}
    for name in written:
        assert (first_build / name).is_dir() or (first_build / name).read_bytes() == (
            second_build / name
        ).read_bytes(), name


@pytest.mark.slow
def test_without_events_the_check_is_on_synthetic_touches_and_says_so(tmp_path, capsys):
    assert run(MODEL, "-o", tmp_path, "--json") == 0
    report = json.loads(capsys.readouterr().out)
    assert report["match"]["events_source"] == "synthetic touches"
    assert report["accuracy"] is None


@pytest.mark.slow
def test_a_build_replaces_the_one_before_and_leaves_other_files(few, tmp_path):
    (tmp_path / "notes.txt").write_text("mine")
    (tmp_path / "report.md").write_text("old")
    assert build(few, tmp_path) == 0
    assert (tmp_path / "notes.txt").read_text() == "mine"
    assert (tmp_path / "report.md").read_text() != "old"
    assert {path.name for path in tmp_path.iterdir()} == FILES | {"notes.txt"}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("gate", "value", "failure"),
    [
        pytest.param("--min-agreement", "0", None, id="agreement kept"),
        pytest.param("--min-agreement", f"1 {COARSEST}", lambda report: f"prediction agreement is {report['match']['prediction_agreement']:.4f}, below 1", id="agreement"),
        pytest.param("--max-spike-error", "0", lambda report: f"{1 - report['match']['spike_agreement']:.4f} of the spikes differ, above 0", id="spikes"),
        pytest.param("--max-cores", "2", None, id="cores kept"),
        pytest.param("--max-cores", "1", lambda report: "the program takes 2 cores, above 1", id="cores"),
        pytest.param("--max-energy-nj", "1", lambda report: f"a recording takes {report['energy']['per_sample_pj'] / 1e3:.1f} nJ, above 1", id="energy"),
        pytest.param("--max-latency-us", "1e6", None, id="latency kept"),
        pytest.param("--max-latency-us", "1", lambda report: f"a recording takes {report['latency']['per_sample_ns'] / 1e3:.1f} µs, above 1", id="latency"),
    ],
)  # fmt: skip
def test_gates(few, tmp_path, capsys, gate, value, failure):
    code = build(few, tmp_path, gate, *value.split())
    lines = capsys.readouterr().err.splitlines()
    report = json.loads((tmp_path / "report.json").read_text())
    assert (code, lines[:1]) == (
        (0, []) if failure is None else (3, [f"gate failed: {gate}: {failure(report)}."])
    )
    # A budget that no setting keeps is a line of its own, with what came nearest.
    is_unmet_bound = gate in ("--min-agreement", "--max-spike-error") and failure is not None
    assert [line[:16] for line in lines[1:]] == ["no setting keeps"] * is_unmet_bound


@pytest.mark.parametrize(
    ("gate", "value", "accepted"),
    [
        ("--max-spike-error", "5", "from 0 to 1"),
        ("--min-agreement", "-0.1", "from 0 to 1"),
        ("--min-agreement", "99", "from 0 to 1"),
        ("--max-score-error", "-0.1", "from 0 up"),
    ],
)
def test_a_bound_that_no_program_decides_is_refused(few, tmp_path, capsys, gate, value, accepted):
    """And one that would let nothing pass; above all a share given in percent: no more than all spikes can differ."""
    assert build(few, tmp_path / "out", gate, value) == 2
    assert (
        capsys.readouterr().err
        == f"{gate} {value}: it is out of range. Give a number {accepted}.\n"
    )
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
def test_gates_as_junit_xml(few, tmp_path, capsys):
    gates = (
        "--max-cores",
        "1",
        "--max-latency-us",
        "1e9",
        "--min-agreement",
        "0",
        "--max-energy-nj",
        "1",
    )
    assert build(few, tmp_path / "out", *gates, "--junit", tmp_path / "g.xml") == 3
    root = ElementTree.parse(tmp_path / "g.xml").getroot()
    (suite,) = root
    for element in (root, suite):
        assert {k: element.get(k) for k in ("tests", "failures", "errors")} == {
            "tests": "4",
            "failures": "2",
            "errors": "0",
        }
    cases = {case.get("name"): case for case in suite}
    assert list(cases) == ["--min-agreement", "--max-energy-nj", "--max-latency-us", "--max-cores"]
    assert {case.get("classname") for case in suite} == {"objects-hybrid"}
    failed = {
        name: case.find("failure").get("message")
        for name, case in cases.items()
        if case.find("failure") is not None
    }
    assert failed["--max-cores"] == "the program takes 2 cores, above 1"
    lines = [f"gate failed: {name}: {message}.\n" for name, message in failed.items()]
    assert capsys.readouterr().err == "".join(lines)
    assert cases["--max-latency-us"].find("system-out").text.startswith("a recording takes ")


@pytest.mark.slow
def test_a_build_with_fewer_vectors_leaves_none_of_the_old(few, tmp_path):
    stale = tmp_path / "vectors/core99/spikes.hex"
    stale.parent.mkdir(parents=True)
    stale.write_text("")
    assert build(few, tmp_path, "--emit", "vectors", "--recording", "2") == 0
    assert not stale.exists()
    manifest = yaml.safe_load((tmp_path / "vectors" / "manifest.yaml").read_text())
    assert manifest["recording"] == "recording 2 of few.npy"
    assert [path.name for path in tmp_path.iterdir() if path.name.startswith(".")] == []


# Bad input ------------------------------------------------------------------------------------------------------------


def changed(tmp_path, change):
    """Return the path of the example's checkpoint with its dictionary changed."""
    entries = torch.load(MODEL, weights_only=True)
    change(entries)
    path = tmp_path / "model.pt"
    torch.save(entries, path)
    return path


class _Runs:
    """A pickle that would run a command when it is read."""

    def __init__(self, path):
        self.path = path

    def __reduce__(self):
        return os.system, (f"touch {self.path}",)


def truncated(tmp_path):
    """Write a checkpoint whose end is missing; return its path."""
    path = tmp_path / "model.pt"
    path.write_bytes(MODEL.read_bytes()[:20_000])
    return path


def hostile(tmp_path):
    """Write a checkpoint that would run a command when it is unpickled."""
    path = tmp_path / "model.pt"
    torch.save({"format": _Runs(tmp_path / "ran")}, path)
    return path


def plain_pickle(tmp_path):
    """Write a pickle that torch did not write, and that would run a command."""
    path = tmp_path / "model.pt"
    path.write_bytes(pickle.dumps(_Runs(tmp_path / "ran")))
    return path


def set_weight(population, value):
    """Return a change that sets one weight of a population."""

    def change(entries):
        entries["weights"][population][3, 5] = value

    return change


def cut_weights(entries):
    """Remove the last input of the weights onto the output."""
    entries["weights"]["time_output"] = entries["weights"]["time_output"][:, :-1].clone()


def repeat_taxel(entries):
    """Name a taxel twice in the order of the location branch."""
    entries["location_order"]["taxels"][4] = entries["location_order"]["taxels"][2]


# Each row: its id, a function that writes the model into a folder, and the line on standard error.
BAD_MODELS = [
    ("missing", lambda t: t / "gone.pt", "checkpoint 'gone.pt': it cannot be read (No such file or directory). Check the path."),
    ("truncated", truncated, "checkpoint 'model.pt': it is damaged, truncated or not a torch file. Write it again with 'locsnn train'."),
    ("hostile", hostile, "checkpoint 'model.pt': it contains objects that would run code when read, so it was not read (posix.system). Save tensors and plain values only."),
    ("plain pickle", plain_pickle, "checkpoint 'model.pt': it is a pickle that torch.save did not write, and nothing in it was run. Save tensors with torch.save."),
    ("nan", lambda t: changed(t, set_weight("time_hidden", float("nan"))), "checkpoint 'model.pt', population 'time_hidden': weight [3, 5] is not finite (got nan, 1 such weights). Train the network again."),
    ("infinite", lambda t: changed(t, set_weight("location_output", float("-inf"))), "checkpoint 'model.pt', population 'location_output': weight [3, 5] is not finite (got -inf, 1 such weights). Train the network again."),
    ("shape", lambda t: changed(t, cut_weights), "checkpoint 'model.pt', population 'time_output': its weights have another shape (out, in) ((36, 31) against (36, 32)). Write it again with 'locsnn train'."),
    ("order", lambda t: changed(t, repeat_taxel), "checkpoint 'model.pt', location order: taxel 3 is repeated at entry 5. Give every taxel from 1 to 39 exactly once."),
    ("no ending", lambda t: t / "model", "model 'model': files without an ending are not read. Give a checkpoint (.pt) that `locsnn train` wrote, a NIR graph (.nir), or a lava-dl network (.net)."),
    ("suffix", lambda t: t / "model.onnx", "model 'model.onnx': files ending in '.onnx' are not read. Give a checkpoint (.pt) that `locsnn train` wrote, a NIR graph (.nir), or a lava-dl network (.net)."),
]  # fmt: skip


@pytest.mark.parametrize(
    ("make", "line"), [row[1:] for row in BAD_MODELS], ids=[row[0] for row in BAD_MODELS]
)
def test_bad_models_are_one_line_and_exit_code_2(make, line, tmp_path, capsys):
    model = make(tmp_path)
    assert run(model, "-o", tmp_path / "out") == 2
    assert capsys.readouterr() == ("", as_typed(line, model) + "\n")
    assert not (tmp_path / "out").exists()
    assert not (tmp_path / "ran").exists()


def as_typed(line, *paths):
    """Return a message with the paths as they were typed where it has the names of the files."""
    for path in paths:
        line = line.replace(repr(path.name), repr(str(path)))
    return line


def wrong_channels(tmp_path):
    """Write recordings of twice the channels of the model."""
    path = tmp_path / "wide.npy"
    np.save(path, np.zeros((2, 156, 250), dtype=np.uint8))
    return path


# Each row: its id, a function that returns the options, and the line on standard error.
BAD_OPTIONS = [
    ("target", lambda t: ("--target", "loihi-sin"), "target 'loihi-sin': no chip of this name ships. Did you mean 'loihi-sim'? A chip file of your own ends in .yaml."),
    ("channels", lambda t: ("--events", wrong_channels(t)), "events 'wide.npy': the channel count differs from the model's (156 channels against 78). Give recordings of 78 channels."),
    ("strategy", lambda t: ("--strategy", "dendrites"), "--strategy dendrites: it is not known. Did you mean 'dendrite'?"),
    ("bits", lambda t: ("--weight-bits", "7"), "--weight-bits: no synapse format has 7 bits. Choose one of 1, 2, 3, 4, 5, 6, 8."),
    ("config", lambda t: ("--config", "net.yaml"), "model 'objects-hybrid.pt': config was given, but a checkpoint contains this itself. Leave config out."),
    ("emit", lambda t: ("--emit", "programm"), "--emit programm: it is not known. Did you mean 'program'?"),
    ("probe", lambda t: ("--probe", "time_output[3]"), "--probe: no emitted file shows a neuron. Add --emit vcd."),
    ("probed", lambda t: ("--strategy", "dendrite", "--emit", "vcd", "--probe", "time_outptu[3]"), "probe 'time_outptu[3]': there is no population 'time_outptu'. Did you mean 'time_output'?"),
    ("recording", lambda t: ("--emit", "vcd", "--recording", "16"), "--recording 16: there is no such recording (16 in synthetic touches). Count from 0 to 15."),
    ("before the first", lambda t: ("--emit", "vcd", "--recording", "-1"), "--recording -1: there is no such recording (16 in synthetic touches). Count from 0 to 15."),
    ("junit alone", lambda t: ("--junit", str(t / "gates.xml")), "--junit: no gate is asked for. Add one of --min-agreement, --max-spike-error, --max-score-error, --max-energy-nj, --max-latency-us, --max-cores."),
    ("junit folder", lambda t: ("--junit", "gone/gates.xml", "--max-cores", "2"), "--junit 'gone/gates.xml': its folder does not exist. Make the folder first."),
]  # fmt: skip


@pytest.mark.parametrize(
    ("options", "line"), [row[1:] for row in BAD_OPTIONS], ids=[row[0] for row in BAD_OPTIONS]
)
def test_bad_options_are_one_line_and_exit_code_2(options, line, tmp_path, capsys):
    assert run(MODEL, "-o", tmp_path / "out", *options(tmp_path)) == 2
    assert capsys.readouterr() == ("", as_typed(line, MODEL, tmp_path / "wide.npy") + "\n")
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("arguments", "line"),
    [
        (
            [],
            "locsnn-compile: the following arguments are required: MODEL. See locsnn-compile --help.",
        ),
        (
            ["m.pt", "--bits", "8"],
            "locsnn-compile: unrecognized arguments: --bits 8. See locsnn-compile --help.",
        ),
        (
            ["m.pt", "--weight-bits", "x"],
            "locsnn-compile: argument --weight-bits: invalid int value: 'x'. See locsnn-compile --help.",
        ),
    ],
    ids=["nothing", "unknown", "type"],
)
def test_wrong_usage_is_one_line_and_exit_code_2(arguments, line, capsys):
    with pytest.raises(SystemExit) as caught:
        main(arguments)
    assert caught.value.code == 2
    assert capsys.readouterr() == ("", line + "\n")


def test_a_folder_without_write_permission(few, tmp_path, capsys):
    """As an ordinary user: permissions do not hold for root."""
    # Once as root, for what is imported late lies where an ordinary user may not read.
    assert build(few, tmp_path / "open") == 0
    locked = tmp_path / "locked"
    locked.mkdir(mode=0o555)
    was_root = os.geteuid() == 0
    if was_root:
        for folder in (tmp_path, *tmp_path.parents):
            if folder.name.startswith(("test_", "popen-", "pytest-")):
                folder.chmod(0o755)
        os.seteuid(65534)
    try:
        code = build(few, locked / "out")
    finally:
        if was_root:
            os.seteuid(0)
    line = f"output {str(locked / 'out')!r}: cannot be written: permission denied. With -o, choose a folder that you may write to.\n"
    assert (code, capsys.readouterr()) == (2, ("", line))
    assert list(locked.iterdir()) == []


def test_an_output_that_is_a_file(few, tmp_path, capsys):
    (tmp_path / "out").write_text("")
    assert run(MODEL, "--events", few, "-o", tmp_path / "out" / "deeper") == 2
    assert capsys.readouterr() == (
        "",
        f"output {str(tmp_path / 'out/deeper')!r}: 'out' is a file. Choose a folder with -o.\n",
    )


def test_a_model_that_the_chip_cannot_hold_is_exit_code_1(tmp_path, capsys):
    model = changed(tmp_path, lambda entries: entries["neuron"].update(tau_sr=100_000.0))
    assert run(model, "-o", tmp_path / "out") == 1
    assert capsys.readouterr() == (
        "",
        "population 'time_hidden': tau_sr: the decay rounds to 0, so the potential would never decay "
        "(100000 steps against at most 8191). Use a shorter time constant or a longer step.\n",
    )
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
def test_a_write_that_fails_half_way_leaves_the_old_build(few, tmp_path, monkeypatch, capsys):
    out = tmp_path / "out"
    assert build(few, out) == 0
    before = {path.name: path.read_bytes() for path in out.iterdir()}
    real = Path.write_bytes

    def full(self, content):
        if self.name == "report.html":
            raise OSError(28, "No space left on device")
        return real(self, content)

    monkeypatch.setattr(Path, "write_bytes", full)
    assert build(few, out, "--weight-bits", "4") == 2
    assert capsys.readouterr().err == (
        f"output {str(out)!r}: cannot be written: no space left on device. With -o, choose a folder that you may write to.\n"
    )
    assert {path.name: path.read_bytes() for path in out.iterdir()} == before
    assert [path.name for path in tmp_path.iterdir()] == ["out"]
