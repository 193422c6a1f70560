"""Compile and run a shipped model with the lowest and with the newest supported versions of all dependencies.

``uv`` installs each set of versions into an environment of its own, in a temporary folder. Both must compile the
shipped hybrid into the same program, check every spike, and write a report whose figures are the same.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

ROOT = Path(__file__).resolve().parents[2]
UV = Path(sys.executable).with_name("uv")
LOWEST = "lowest-direct"
"""uv's way to choose the lowest versions that ``pyproject.toml`` allows, and any of their own dependencies."""
NEWEST = "highest"
"""uv's way to choose the newest versions of everything."""
NAMES = ("llvmlite", "numba", "numpy", "scipy", "h5py", "pyyaml", "rich", "argcomplete", "pyvcd")
"""Packages whose versions are printed."""
MODEL = "examples/models/objects-hybrid.pt"
EVENTS = "examples/recordings/touches.npz"
FIGURES = ("match", "operations", "resources")
"""Parts of report.json that hold integers, or one division of integers, so that no version may round differently."""


def play(resolution: str, folder: Path) -> tuple[bytes, dict[str, object]]:
    """Install into a new environment, compile and run the model there, and return its program and its figures."""
    python = folder / "bin/python"
    run([UV, "venv", "--quiet", "--python", sys.executable, folder])
    run([UV, "pip", "install", "--quiet", "--python", python, "--resolution", resolution, ROOT])
    installed = run([UV, "pip", "list", "--quiet", "--python", python, "--format", "json"])
    versions = {package["name"]: package["version"] for package in json.loads(installed)}
    print(f"{resolution}:", *(f"{name} {versions[name]}" for name in NAMES), flush=True)

    build = folder / "build"
    command = [folder / "bin/locsnn-compile", ROOT / MODEL, "--events", ROOT / EVENTS, "--quiet"]
    run([*command, "-o", build])
    run([folder / "bin/locsnn", "run", build, "--events", ROOT / EVENTS, "--stream", "--json"])
    report = json.loads((build / "report.json").read_text("utf-8"))
    print(f"{resolution}: the main job plays", flush=True)
    return (build / "program.npz").read_bytes(), {name: report[name] for name in FIGURES}


def run(command: list[str | Path]) -> str:
    """Run a command outside of the checkout, and return what it prints; end this program if it fails.

    In the checkout, or with its PYTHONPATH, the sources would be imported instead of the installed packages.
    """
    environment = {
        name: value for name, value in os.environ.items() if not name.startswith("PYTHON")
    }
    process = subprocess.run(
        command, cwd=ROOT.parent, env=environment, capture_output=True, text=True, check=False
    )
    if process.returncode:
        message = (process.stderr or process.stdout).strip()
        sys.exit(f"{' '.join(map(str, command))}: exit code {process.returncode}\n{message}")
    return process.stdout


def main() -> None:
    """Run with both sets of versions, or with the lowest alone, and compare programs and figures."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--lowest", action="store_true", help="leave out the newest versions")
    resolutions = [LOWEST] if parser.parse_args().lowest else [LOWEST, NEWEST]
    with TemporaryDirectory() as folder:
        outcomes = [play(resolution, Path(folder) / resolution) for resolution in resolutions]
    if any(outcome != outcomes[0] for outcome in outcomes):
        sys.exit("the lowest and the newest versions do not give the same program and figures")


if __name__ == "__main__":
    main()
