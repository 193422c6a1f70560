"""Commands in unusual surroundings: locales, streams, terminals, homes, networks and names.

A build must have the same bytes everywhere.
"""

from __future__ import annotations

import os
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).parents[2]
BIN = Path(sys.executable).parent
NAMES = ("plain", "ein Weg", "Händedruck ü [red]ß", "触覚 $(x) 'q' &")
PLAIN = {
    name: value
    for name, value in os.environ.items()
    if not name.startswith(("LC_", "LANG", "PYTHON"))
}

ENVIRONMENTS = {
    "C": {"LC_ALL": "C"},
    "C, ASCII alone": {"LC_ALL": "C", "PYTHONCOERCECLOCALE": "0", "PYTHONUTF8": "0"},
    "German": {"LC_ALL": "de_DE.UTF-8"},
    "Turkish": {"LC_ALL": "tr_TR.UTF-8"},
    "Latin-1": {"PYTHONIOENCODING": "latin-1"},
    "ASCII": {"PYTHONIOENCODING": "ascii"},
    "no home": {"HOME": "/dev/null", "XDG_CACHE_HOME": "/dev/null/cache"},
    "narrow": {"COLUMNS": "1", "TERM": "dumb"},
    "warnings are errors": {"PYTHONWARNINGS": "error"},
    "no network": {"PYTHONPATH": f"offline{os.pathsep}{ROOT}"},
}
STREAMS = {
    "no input": "<&-",
    "no output": ">&-",
    "no errors": "2>&-",
    "nothing": "<&- >&- 2>&-",
}
OFFLINE = """\
import socket

def refuse(*arguments, **options):
    raise RuntimeError("the network was asked for")

socket.getaddrinfo = socket.socket.connect = socket.socket.connect_ex = refuse
"""


@pytest.fixture
def folder(tmp_path):
    """A folder with a network of leaky neurons, recordings, and a Python that knows no network."""
    nir = pytest.importorskip("nir")
    rng = np.random.default_rng(0)
    np.savez(tmp_path / "few.npz", spikes=(rng.random((4, 8, 40)) < 0.2).astype(np.uint8))
    three = np.ones(3)
    neurons = nir.LIF(
        tau=1e-3 * three, r=10 * three, v_leak=0 * three, v_threshold=three, v_reset=0 * three
    )
    nodes = {
        "input": nir.Input(input_type=np.array([8])),
        "fc": nir.Linear(weight=rng.normal(0.2, 0.3, (3, 8))),
        "lif": neurons,
        "output": nir.Output(output_type=np.array([3])),
    }
    edges = [("input", "fc"), ("fc", "lif"), ("lif", "output")]
    nir.write(tmp_path / "net.nir", nir.NIRGraph(nodes=nodes, edges=edges))
    (tmp_path / "offline").mkdir()
    (tmp_path / "offline/sitecustomize.py").write_text(OFFLINE)
    return tmp_path


def run(folder, command, environment=None, redirect=""):
    """Run a command in a shell without a terminal; return its exit code, output and errors."""
    path = f"{BIN}{os.pathsep}{os.environ['PATH']}"
    # Bash warns of locales.
    assignments = shlex.join(f"{name}={value}" for name, value in (environment or {}).items())
    process = subprocess.run(
        ["bash", "-c", f"exec env {assignments} {command} {redirect}"],
        cwd=folder,
        env={**PLAIN, "PATH": path, "PYTHONPATH": str(ROOT)},
        stdin=subprocess.DEVNULL,
        capture_output=True,
        start_new_session=True,
        check=False,
    )
    return process.returncode, process.stdout, process.stderr


@pytest.mark.slow
@pytest.mark.parametrize("environment", ENVIRONMENTS.values(), ids=ENVIRONMENTS)
def test_the_surroundings_change_nothing(environment, folder):
    """A light command, whose raster has letters that not every locale knows."""
    code, output, errors = run(folder, "locsnn events few.npz", environment)
    assert (code, errors) == (0, b"")
    assert output.startswith(b"few.npz")


@pytest.mark.parametrize("columns", ["0", "1", "x"])
def test_a_terminal_without_columns_shows_the_summary_even_so(columns, monkeypatch, capsys):
    from locsnn_compile.cli.shell import terminal

    monkeypatch.setenv("COLUMNS", columns)
    terminal().print("fits", soft_wrap=True)
    assert capsys.readouterr().out == "fits\n"


@pytest.mark.parametrize("redirect", STREAMS.values(), ids=STREAMS)
def test_streams_may_be_closed(redirect, folder):
    code, output, errors = run(folder, "locsnn events few.npz", redirect=redirect)
    assert (code, errors) == (0, b"")
    assert output.startswith(b"few.npz") == (">&-" not in redirect.split())


def test_errors_are_said_even_so(folder):
    assert run(folder, "locsnn events gone.npz", redirect="2>&-") == (2, b"", b"")
    line = b"file 'gone.npz': it does not exist. Check the path.\n"
    assert run(folder, "locsnn events gone.npz", redirect=">&-") == (2, b"", line)


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no device that is always full")
def test_a_full_disk_behind_the_output_is_one_line(folder):
    line = b"standard output: it cannot be written: No space left on device. Write it elsewhere.\n"
    assert run(folder, "locsnn events few.npz", redirect=">/dev/full") == (2, b"", line)


def test_names_that_are_no_text_are_one_line(folder):
    line = (
        b"locsnn: argument 'net\\udcff.nir' is not text in this locale; rename the file, or choose a UTF-8 locale. "
        b"See locsnn --help.\n"
    )
    assert run(folder, "locsnn events $'net\\xff.nir'") == (2, b"", line)


@pytest.mark.parametrize("name", NAMES)
def test_names_may_have_any_letters(name, folder, monkeypatch, capsys):
    from locsnn_compile.cli.compile import main as compile_main
    from locsnn_compile.cli.main import main as locsnn_main

    monkeypatch.chdir(folder)
    Path(name).mkdir()
    for file in ("net.nir", "few.npz"):
        shutil.copy(file, f"{name}/{name}{Path(file).suffix}")
    model, events, build = f"{name}/{name}.nir", f"{name}/{name}.npz", f"{name}/build {name}"
    emit = ("network", "program", "vcd", "trace", "graphml", "dot", "nir")
    assert compile_main([model, "--events", events, "-o", build, "--emit", *emit]) == 0
    assert f"wrote {build}/: " in capsys.readouterr().out
    assert locsnn_main(["run", build, "--events", events]) == 0
    assert locsnn_main(["diff", build, build]) == 0
    assert capsys.readouterr().err == ""


@pytest.mark.minutes
@pytest.mark.parametrize(
    "name", ["C, ASCII alone", "Latin-1", "no home", "warnings are errors", "no network"]
)
def test_the_surroundings_change_no_build(name, folder):
    environment = ENVIRONMENTS[name]
    files = [
        f"build/{name}"
        for name in ("program.yaml", "program.npz", "report.json", "report.md", "report.html")
    ]
    assert run(folder, "locsnn-compile net.nir --events few.npz -o build --quiet") == (0, b"", b"")
    expected = [(folder / file).read_bytes() for file in files]
    shutil.rmtree(folder / "build")
    code, output, errors = run(
        folder, "locsnn-compile net.nir --events few.npz -o build", environment
    )
    assert (code, errors) == (0, b"")
    assert (
        b"wrote build/: program.npz, program.yaml, report.json, report.md, report.html"
        in b" ".join(output.split())
    )
    assert [(folder / file).read_bytes() for file in files] == expected
    code, output, errors = run(folder, "locsnn run build --events few.npz --stream", environment)
    assert (code, errors) == (0, b"")
    assert b"recording 3" in output


@pytest.mark.minutes
@pytest.mark.parametrize("home", ["read-only home", "home of one's own"])
def test_installed_where_nothing_can_be_written(home, folder):
    """The packages, and the home, are read-only, for root too: loops are compiled, and kept only where they can be."""
    without_rights = ["setpriv", "--bounding-set=-all"] if os.geteuid() == 0 else []
    if without_rights and not shutil.which("setpriv"):
        pytest.skip("root may write anywhere, and there is no setpriv")
    site = folder / "site"
    for package in ("hw_model", "locsnn_compile"):
        shutil.copytree(
            ROOT / package, site / package, ignore=shutil.ignore_patterns("__pycache__")
        )
    (folder / "home").mkdir()
    for path in [site, *site.rglob("*"), *([folder / "home"] if home == "read-only home" else [])]:
        path.chmod(0o555 if path.is_dir() else 0o444)
    environment = {**PLAIN, "PYTHONPATH": str(site), "HOME": str(folder / "home")}
    environment.pop("XDG_CACHE_HOME", None)
    command = [
        sys.executable,
        "-W",
        "error",
        "-m",
        "locsnn_compile.cli.compile",
        "net.nir",
        "--events",
        "few.npz",
    ]
    process = subprocess.run(
        [*without_rights, *command],
        cwd=folder,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert (process.returncode, process.stderr) == (0, "")
    assert (folder / "build/net/report.html").exists()
    assert not list(site.rglob("__pycache__"))
    assert bool(list((folder / "home").rglob("*.nbi"))) == (home != "read-only home")
    for path in [site, *site.rglob("*")]:
        path.chmod(0o755)
