"""The packages run from a folder: from an archive they say so in one line, and end with an error."""

from __future__ import annotations

import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


@pytest.mark.parametrize("package", ["locsnn_compile", "hw_model"])
def test_a_package_in_an_archive_is_refused_in_one_line(package, tmp_path):
    archive = tmp_path / "packages.zip"
    with zipfile.ZipFile(archive, "w") as packed:
        for path in (ROOT / package).glob("__*__.py"):
            packed.write(path, f"{package}/{path.name}")
    # Without site packages there is no other copy to import; lazy_loader is imported by both.
    stub = tmp_path / "lazy_loader.py"
    stub.write_text("def attach_stub(name, file): return None, None, []\n")
    script = f"import sys; sys.path[:0] = [{str(archive)!r}, {str(tmp_path)!r}]; import {package}"
    done = subprocess.run(
        [sys.executable, "-S", "-I", "-c", script], capture_output=True, text=True, check=False
    )
    message = (
        f"ImportError: {package}: it reads files of its own, and an archive has none. Unpack it, or "
        "install it with pip."
    )
    assert done.returncode == 1
    assert done.stderr.splitlines()[-1] == message


def test_the_command_of_an_archive_is_refused_in_one_line(tmp_path):
    archive = tmp_path / "packages.zip"
    with zipfile.ZipFile(archive, "w") as packed:
        for path in (ROOT / "locsnn_compile").glob("__*__.py"):
            packed.write(path, f"locsnn_compile/{path.name}")
    (tmp_path / "lazy_loader.py").write_text("def attach_stub(name, file): return None, None, []\n")
    script = (
        f"import runpy, sys; sys.path[:0] = [{str(archive)!r}, {str(tmp_path)!r}]; "
        "runpy._run_module_as_main('locsnn_compile')"
    )
    done = subprocess.run(
        [sys.executable, "-S", "-I", "-c", script], capture_output=True, text=True, check=False
    )
    (line,) = done.stderr.splitlines()
    assert done.returncode == 1
    assert "locsnn_compile: it reads files of its own, and an archive has none." in line
