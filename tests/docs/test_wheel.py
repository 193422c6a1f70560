"""The wheel works in a clean environment.

It is built from the source distribution and installed with only the dependencies that it declares.
There it imports, runs the quick start of the documentation, and is typed for strict type checkers.
"""

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
"""A program of a user, which mypy checks."""
IMPORT_EVERY_MODULE = """\
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
"""A script that imports all modules. Only those that train or read AEDAT 4 may miss a package, of an extra."""


def run(*command, cwd, **environment):
    """Run a command that must succeed, and return what it prints."""
    process = subprocess.run(
        [str(word) for word in command],
        cwd=cwd,
        env={**os.environ, **environment},
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        check=False,
    )
    assert process.returncode == 0, f"{command}\n{process.stdout[-2000:]}{process.stderr[-4000:]}"
    return process.stdout


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    """Build the source distribution from the files of a checkout, and the wheel from it; return the wheel.

    A file that the source distribution lacks is thereby missing in the wheel too, where tests find it.
    """
    folder = tmp_path_factory.mktemp("wheel")
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, folder)
    for package in ("hw_model", "locsnn_compile"):
        shutil.copytree(
            ROOT / package, folder / package, ignore=shutil.ignore_patterns("__pycache__")
        )
    run(sys.executable, "-m", "build", "--outdir", "dist", cwd=folder)
    (wheel,) = (folder / "dist").glob("*.whl")
    return wheel


def test_twine_accepts_the_wheel_and_the_source_distribution(wheel):
    files = sorted(wheel.parent.iterdir())
    assert [file.name.rpartition("0.1.0")[2] for file in files] == ["-py3-none-any.whl", ".tar.gz"]
    stdout = run(sys.executable, "-m", "twine", "check", "--strict", *files, cwd=wheel.parent)
    assert stdout.count("PASSED") == 2


def test_the_wheel_holds_the_licences_and_the_files_of_the_viewer(wheel):
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
    """Install the wheel into a clean environment; return its Python, and a folder with the examples."""
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


def test_every_module_imports_without_torch(installed):
    python, folder = installed
    run(python, "-m", "pip", "check", cwd=folder, PYTHONPATH="")
    run(python, "-W", "error", "-c", IMPORT_EVERY_MODULE, cwd=folder, PYTHONPATH="")
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


def test_a_program_that_uses_the_installed_packages_passes_strict_type_checks(installed):
    python, folder = installed
    (folder / "client.py").write_text(CLIENT)
    mypy = [sys.executable, "-m", "mypy", "--strict", "--python-executable", python, "client.py"]
    assert run(*mypy, cwd=folder, PYTHONPATH="", MYPY_CACHE_DIR=str(folder / "cache")).startswith(
        "Success"
    )


def test_the_wheel_holds_the_packages_alone(wheel):
    listing = run(sys.executable, "-m", "zipfile", "-l", wheel, cwd=wheel.parent)
    top_folders = {line.split("/")[0] for line in listing.splitlines()[1:]}
    name_and_version = Path(wheel).name.split("-py3")[0]
    assert top_folders == {"hw_model", "locsnn_compile", f"{name_and_version}.dist-info"}
