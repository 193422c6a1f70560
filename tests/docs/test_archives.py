"""The packages cannot be imported from a zip archive, because they read data files of their own.

They refuse it with a single line, as a module and as a command.
"""

from __future__ import annotations

import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


def run_from_archive(package, statement, folder):
    """Run a statement in a Python that finds a package in an archive alone; return the ended process."""
    archive = folder / "packages.zip"
    with zipfile.ZipFile(archive, "w") as packed:
        for path in (ROOT / package).glob("__*__.py"):
            packed.write(path, f"{package}/{path.name}")
    # -S and -I leave the installed packages out, so that no other copy is imported. Both packages
    # import lazy_loader first, which is then missing too: an empty module stands in for it.
    stub = folder / "lazy_loader.py"
    stub.write_text("def attach_stub(name, file): return None, None, []\n")
    script = f"import runpy, sys; sys.path[:0] = [{str(archive)!r}, {str(folder)!r}]; {statement}"
    return subprocess.run(
        [sys.executable, "-S", "-I", "-c", script], capture_output=True, text=True, check=False
    )


@pytest.mark.parametrize("package", ["locsnn_compile", "hw_model"])
def test_a_package_in_an_archive_is_refused_in_one_line(package, tmp_path):
    process = run_from_archive(package, f"import {package}", tmp_path)
    message = (
        f"ImportError: {package}: it reads files of its own, and an archive has none. Unpack it, or "
        "install it with pip."
    )
    assert process.returncode == 1
    assert process.stderr.splitlines()[-1] == message


def test_the_command_of_an_archive_is_refused_in_one_line(tmp_path):
    run_as_command = "runpy._run_module_as_main('locsnn_compile')"
    process = run_from_archive("locsnn_compile", run_as_command, tmp_path)
    (line,) = process.stderr.splitlines()
    assert process.returncode == 1
    assert "locsnn_compile: it reads files of its own, and an archive has none." in line
