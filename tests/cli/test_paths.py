"""Paths that cannot be used: one line, whichever option they are given to, and nothing written."""

from __future__ import annotations

import os
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from locsnn_compile.cli.compile import main as compile_main
from locsnn_compile.cli.main import main as locsnn_main
from locsnn_compile.data.synthetic import synthetic_touches
from locsnn_compile.data.write import write_recordings
from tests.support.marks import first_quick

ROOT = Path(__file__).parents[2]
MODEL = ROOT / "examples/models/objects-hybrid.pt"
BAD = {
    "too long": ("n" * 300, "the name is too long ({bytes} bytes). Shorten it."),
    "with a NUL": ("a\0b", "it contains a NUL character. Give the path of a file."),
}
COMPILE = f"locsnn-compile {MODEL}"
# By id: a command in which BAD stands for a name that no file can have, and how the message begins.
OPTIONS = {
    "MODEL": ("locsnn-compile BAD.pt", "MODEL"),
    "--events": (f"{COMPILE} --events BAD.npz", "--events"),
    "--events, a folder": (f"{COMPILE} --events BAD", "--events"),
    "--events, in a folder": (f"{COMPILE} --events BAD/a.npz", "--events"),
    "--config": (f"{COMPILE} --config BAD.yaml", "--config"),
    "--calibration": (f"{COMPILE} --calibration BAD.zip", "--calibration"),
    "--target": (f"{COMPILE} --target BAD.yaml", "--target"),
    "--profile": (f"{COMPILE} --profile BAD.yaml", "--profile"),
    "-o": (f"{COMPILE} -o BAD", "output"),
    "--junit": (f"{COMPILE} --max-cores 9 --junit BAD.xml", "--junit"),
    "train --data": ("locsnn train --data BAD.npz", "--data"),
    "train --config": ("locsnn train --data d.npz --config BAD.yaml", "--config"),
    "train --from": ("locsnn train --data d.npz --from BAD.pt", "--from"),
    "train --target": ("locsnn train --data d.npz --target BAD.yaml", "--target"),
    "train -o": ("locsnn train --data d.npz -o BAD.pt", "-o"),
    "run DIR": ("locsnn run BAD --events d.npz", "folder"),
    "run --events": ("locsnn run build --events BAD.npz", "path"),
    "run --profile": ("locsnn run build --events d.npz --profile BAD.yaml", "path"),
    "run --calibrate": (
        "locsnn run build --events d.npz --stop margin --calibrate BAD.npz",
        "path",
    ),
    "events": ("locsnn events BAD.npz", "FILE"),
    "events -o": ("locsnn events d.npz -o BAD.svg", "-o"),
    "events --to": ("locsnn events d.npz --to BAD.npz", "--to"),
    "events --to, a folder": ("locsnn events d.npz --to BAD", "output"),
    "explore": ("locsnn explore BAD.pt", "MODEL"),
    "explore --report-on": (f"locsnn explore {MODEL} --report-on BAD.npz", "--report-on"),
    "explore -o": (f"locsnn explore {MODEL} -o BAD", "output"),
    "diff": ("locsnn diff BAD BAD", "build"),
    "pack": ("locsnn pack BAD.pt -o d.pt", "MODEL"),
    "pack -o": (f"locsnn pack {MODEL} -o BAD", "--output"),
    "diff --html": ("locsnn diff build build --html BAD.html", "--html"),
    "rtl sim DIR": ("locsnn rtl sim BAD --events d.npz", "folder"),
    "rtl sim --events": ("locsnn rtl sim build --events BAD.npz", "path"),
    "rtl fit DIR": ("locsnn rtl fit BAD --device ecp5-25f", "folder"),
    "rtl stream DIR": ("locsnn rtl stream BAD --events d.npz --port sim:icarus", "folder"),
    "rtl stream --events": ("locsnn rtl stream build --events BAD.npz --port sim:icarus", "path"),
    "stress --target": ("locsnn stress --target BAD.yaml", "path"),
    "stress -o": ("locsnn stress -o BAD.md", "-o"),
    "targets": ("locsnn targets --show BAD.yaml", "path"),
}


@pytest.fixture(scope="module")
def build(tmp_path_factory):
    """A program with recordings for it, which reading must not change."""
    place = tmp_path_factory.mktemp("build")
    write_recordings(place / "d.npz", synthetic_touches(3, steps=20, classes=2, seed=1))
    arguments = [str(MODEL), "--events", str(place / "d.npz"), "--strategy", "dendrite", "--quiet"]
    assert compile_main([*arguments, "-o", str(place / "build")]) == 0
    return place


@pytest.fixture
def here(build, monkeypatch):
    """Run in the folder of the build, so that commands need no paths."""
    monkeypatch.chdir(build)
    return build


def run(command):
    """Run a command as typed; return its exit code."""
    program, *arguments = shlex.split(command)
    return (compile_main if program == "locsnn-compile" else locsnn_main)(arguments)


@pytest.mark.parametrize(("name", "fault"), BAD.values(), ids=BAD)
@pytest.mark.parametrize(("command", "where"), OPTIONS.values(), ids=OPTIONS)
def test_names_that_no_file_can_have(command, where, name, fault, here, capsys):
    assert run(command.replace("BAD", name)) == 2
    stdout, stderr = capsys.readouterr()
    assert stdout == ""
    assert stderr.count("\n") == 1
    assert stderr.startswith(where)
    assert stderr.endswith(fault.split("{bytes}")[-1] + "\n")
    assert fault.split("{bytes}")[0] in stderr
    assert sorted(path.name for path in here.iterdir()) == ["build", "d.npz"]


# Each row: its id, a command, and the line on standard error.
LINES = [
    ("below a file, read", "locsnn events d.npz/a.npz", "file 'd.npz/a.npz': it does not exist. Check the path."),
    ("below a file, written", "locsnn events d.npz --to d.npz/a.npz", "--to 'd.npz/a.npz': its folder does not exist. Make the folder first."),
    ("below a file, built", f"{COMPILE} -o d.npz/build", "output 'd.npz/build': 'd.npz' is a file. Choose a folder with -o."),
    ("the root, a build", f"{COMPILE} -o /", "output '/': cannot be written: it is the root of the file system. With -o, choose a folder that you may write to."),
    ("the root, an exploration", f"locsnn explore {MODEL} -o /", "output '/': cannot be written: it is the root of the file system. With -o, choose a folder that you may write to."),
    ("the root, a model", "locsnn train --data d.npz -o /", "output '/': it is not a .pt file in an existing folder. Correct -o."),
    ("the root, a page", "locsnn stress -o /", "-o '/': it is a folder. Give the name of a file."),
    ("the root, a comparison", "locsnn diff build build --html /", "--html '/': it is a folder. Give the name of a file."),
    ("the root, recordings", "locsnn events d.npz --to /", "output '/': cannot be written: it is the root of the file system. With -o, choose a folder that you may write to."),
    ("the root, a program", "locsnn run / --events d.npz", "program '/', program.yaml: it cannot be read (No such file or directory). Give the folder that the compiler wrote."),
    ("a program that is not there", "locsnn run build/nope --events d.npz", "program 'build/nope', program.yaml: it cannot be read (No such file or directory). Give the folder that the compiler wrote."),
    ("a file as a program", "locsnn run d.npz --events d.npz", "program 'd.npz', program.yaml: it cannot be read (Not a directory). Give the folder that the compiler wrote."),
]  # fmt: skip


@pytest.mark.parametrize(
    ("command", "line"), [row[1:] for row in LINES], ids=[row[0] for row in LINES]
)
def test_places_where_nothing_is_or_nothing_may_be_written(command, line, here, capsys):
    assert (run(command), capsys.readouterr()) == (2, ("", f"{line}\n"))
    assert sorted(path.name for path in here.iterdir()) == ["build", "d.npz"]


GONE = "working directory: it does not exist any more. Change to one that does.\n"
# By id: a command in which D stands for recordings, and its exit code.
FROM_NOWHERE = {
    "a relative model": ("locsnn-compile m.pt", 2),
    "a build beside": (f"locsnn-compile {MODEL} --events D", 2),
    "recordings that are elsewhere": ("locsnn events D", 0),
    "training": ("locsnn train --data D", 2),
    "an exploration": (f"locsnn explore {MODEL} --events D", 2),
    "chips": ("locsnn targets", 0),
}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("command", "code"), first_quick(FROM_NOWHERE.values(), 3), ids=FROM_NOWHERE
)
def test_a_working_directory_that_was_deleted(command, code, build, tmp_path):
    """In a process of its own, whose directory is removed before the command begins."""
    gone = tmp_path / "gone"
    gone.mkdir()
    program, *arguments = shlex.split(command.replace("D", str(build / "d.npz")))
    module = "compile" if program == "locsnn-compile" else "main"
    script = (
        f"import os, shutil; os.chdir({str(gone)!r}); shutil.rmtree({str(gone)!r})\n"
        f"from locsnn_compile.cli.{module} import main\nraise SystemExit(main({arguments!r}))"
    )
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    process = subprocess.run(
        [sys.executable, "-c", script],
        env=environment,
        capture_output=True,
        text=True,
        check=False,
        cwd=tmp_path,
    )
    assert (process.returncode, process.stderr) == (code, GONE if code else "")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("command", "first"),
    [
        ("events d.npz", "d.npz: 3 recordings"),
        (
            "compile MODEL --strategy dendrite --events d.npz -o again",
            "objects-hybrid on loihi-sim",
        ),
        ("diff build build", "The builds are equal."),
    ],
    ids=["events", "compile", "diff"],
)
def test_a_reader_that_goes_away(build, command, first):
    """``locsnn events | head -1`` leaves without a word, and with 0: what was to be done is done."""
    command = f"{shlex.quote(sys.executable)} -m locsnn_compile.cli.main {command.replace('MODEL', str(MODEL))} | head -n 1"
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    process = subprocess.run(
        ["bash", "-o", "pipefail", "-c", command],
        env=environment, cwd=build, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert (process.returncode, process.stdout.startswith(first), process.stderr) == (0, True, "")


@pytest.mark.skipif(
    not shutil.which("setpriv") and os.geteuid() == 0, reason="root may read and write anywhere"
)
def test_places_that_are_closed(build, tmp_path):
    closed = tmp_path / "closed"
    closed.mkdir()
    (closed / "d.npz").write_bytes((build / "d.npz").read_bytes())
    closed.chmod(0)
    without_rights = (
        ["setpriv", "--bounding-set=-all", "--inh-caps=-all"] if os.geteuid() == 0 else []
    )
    lines = {
        f"events {closed}/d.npz": "file 'd.npz': it cannot be read (Permission denied). Check the path.\n",
        f"events {build}/d.npz --to {closed}/a.npz": f"--to '{closed}/a.npz': it cannot be used (Permission denied). Check the path.\n",
    }
    try:
        for command, line in lines.items():
            arguments = [
                *without_rights,
                sys.executable,
                "-m",
                "locsnn_compile.cli.main",
                *shlex.split(command),
            ]
            environment = {**os.environ, "PYTHONPATH": str(ROOT)}
            process = subprocess.run(
                arguments, env=environment, capture_output=True, text=True, check=False
            )
            assert (process.returncode, process.stdout) == (2, "")
            assert process.stderr.count("\n") == 1, process.stderr
            assert "ermission denied" in process.stderr, line
    finally:
        closed.chmod(0o755)
