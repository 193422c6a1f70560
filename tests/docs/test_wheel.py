"""The wheel in a clean environment: it installs with what it declares, runs the quick start, and brings its types."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import venv
from pathlib import Path

import pytest

from tests.support.fences import ROOT, fences

pytestmark = pytest.mark.minutes

CLIENT = '''\
"""A program of somebody else, checked strictly against the installed packages."""

import hw_model as hw
import locsnn_compile as lc


def energy_pj(build: str, recordings: str) -> float:
    program: hw.ChipProgram = hw.load_program(build)
    result = hw.simulate(program, lc.read_recordings(recordings).spikes)
    return sum(hw.energy_pj(result.counts, program.chip.profile("davies2018")).values())


def compiled(model: str) -> lc.CompiledModel:
    network: lc.Network = lc.load(model)
    return lc.compile(network, target="tiny-sim", weight_bits=4)
'''
EVERY_MODULE = """\
import importlib, pkgutil, hw_model, locsnn_compile
for package in (hw_model, locsnn_compile):
    for module in pkgutil.walk_packages(package.__path__, f"{package.__name__}."):
        try:
            importlib.import_module(module.name)
        except ModuleNotFoundError as error:
            trains = module.name.startswith(("locsnn_compile.models.", "locsnn_compile.training."))
            films = module.name == "locsnn_compile.data.aedat4_child"
            assert (error.name, trains, films) in (("torch", True, False), ("aedat", False, True)), module.name
"""


def run(*command, cwd, **environment):
    """Run a command that must succeed, and return what it printed."""
    done = subprocess.run(
        [str(word) for word in command],
        cwd=cwd,
        env={**os.environ, **environment},
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, f"{command}\n{done.stdout[-2000:]}{done.stderr[-4000:]}"
    return done.stdout


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    """The wheel, built from the sdist, built from what a checkout has: so the sdist is whole."""
    folder = tmp_path_factory.mktemp("wheel")
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, folder)
    for package in ("hw_model", "locsnn_compile"):
        shutil.copytree(
            ROOT / package, folder / package, ignore=shutil.ignore_patterns("__pycache__")
        )
    run(sys.executable, "-m", "build", "--outdir", "dist", cwd=folder)
    (found,) = (folder / "dist").glob("*.whl")
    return found


def test_an_index_would_take_them(wheel):
    files = sorted(wheel.parent.iterdir())
    assert [file.name.rpartition("0.1.0")[2] for file in files] == ["-py3-none-any.whl", ".tar.gz"]
    said = run(sys.executable, "-m", "twine", "check", "--strict", *files, cwd=wheel.parent)
    assert said.count("PASSED") == 2


def test_the_licences_and_the_viewer_come_along(wheel):
    names = run(sys.executable, "-m", "zipfile", "-l", wheel, cwd=wheel.parent)
    assert ".dist-info/licenses/LICENSE" in names
    for name in (
        "viewer.html",
        "viewer.css",
        "viewer.js",
        "uPlot.iife.min.js",
        "uPlot.min.css",
        "uPlot.LICENSE",
    ):
        assert f"locsnn_compile/report/viewer/{name} " in names


@pytest.fixture(scope="module")
def installed(wheel, tmp_path_factory):
    """The Python of a clean environment with the wheel and what it asks for; and a folder with the examples."""
    folder = tmp_path_factory.mktemp("clean")
    venv.create(folder / "env", with_pip=True)
    python = folder / "env/bin/python"
    run(
        python,
        "-m",
        "pip",
        "install",
        "--quiet",
        "--constraint",
        ROOT / "constraints.txt",
        wheel,
        cwd=folder,
    )
    shutil.copytree(ROOT / "examples", folder / "examples")
    return python, folder


def test_nothing_is_missing(installed):
    python, folder = installed
    run(python, "-m", "pip", "check", cwd=folder, PYTHONPATH="")
    run(python, "-W", "error", "-c", EVERY_MODULE, cwd=folder, PYTHONPATH="")
    assert "torch" not in run(python, "-m", "pip", "list", cwd=folder, PYTHONPATH="").lower()


def test_the_quick_start_runs(installed):
    python, folder = installed
    path = f"{python.parent}{os.pathsep}{os.environ['PATH']}"
    blocks = [
        fence
        for fence in fences(ROOT / "docs/start/quick-start.md")
        # Training needs torch, which the wheel does not install.
        if fence.language in ("python", "sh") and "locsnn train" not in fence.code
    ]
    for block in blocks:
        command = (
            ["bash", "-euo", "pipefail"] if block.language == "sh" else [python, "-W", "error"]
        )
        run(*command, "-c", block.code, cwd=folder, PATH=path, PYTHONPATH="")
    assert len(blocks) >= 4


def test_types_come_along(installed):
    python, folder = installed
    (folder / "client.py").write_text(CLIENT)
    mypy = [sys.executable, "-m", "mypy", "--strict", "--python-executable", python, "client.py"]
    assert run(*mypy, cwd=folder, PYTHONPATH="", MYPY_CACHE_DIR=str(folder / "cache")).startswith(
        "Success"
    )


def test_the_wheel_holds_the_packages_alone(wheel):
    names = run(sys.executable, "-m", "zipfile", "-l", wheel, cwd=wheel.parent)
    held = {line.split("/")[0] for line in names.splitlines()[1:]}
    assert held == {"hw_model", "locsnn_compile", f"{Path(wheel).name.split('-py3')[0]}.dist-info"}
