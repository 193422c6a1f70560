"""Play the main job with the lowest and with the newest versions of everything that the project asks for.

Each set of versions has an environment of its own, in a temporary folder, that ``uv`` fills. Both must compile the
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
LOWEST, NEWEST = "lowest-direct", "highest"
"""How uv chooses versions: of what the project itself asks for, or of everything."""
NAMES = ("llvmlite", "numba", "numpy", "scipy", "h5py", "pyyaml", "rich", "argcomplete", "pyvcd")
MODEL, EVENTS = "examples/models/objects-hybrid.pt", "examples/recordings/touches.npz"
FIGURES = ("match", "operations", "resources")
"""Parts of report.json that are made of integers, or of one division."""


def play(resolution: str, folder: Path) -> tuple[bytes, dict[str, object]]:
    """Install into a new environment, run the main job there, and return its program and its figures."""
    python = folder / "bin/python"
    run([UV, "venv", "--quiet", "--python", sys.executable, folder])
    run([UV, "pip", "install", "--quiet", "--python", python, "--resolution", resolution, ROOT])
    shown = run([UV, "pip", "list", "--quiet", "--python", python, "--format", "json"])
    versions = {package["name"]: package["version"] for package in json.loads(shown)}
    print(f"{resolution}:", *(f"{name} {versions[name]}" for name in NAMES), flush=True)

    build = folder / "build"
    command = [folder / "bin/locsnn-compile", ROOT / MODEL, "--events", ROOT / EVENTS, "--quiet"]
    run([*command, "-o", build])
    run([folder / "bin/locsnn", "run", build, "--events", ROOT / EVENTS, "--stream", "--json"])
    report = json.loads((build / "report.json").read_text("utf-8"))
    print(f"{resolution}: the main job plays", flush=True)
    return (build / "program.npz").read_bytes(), {name: report[name] for name in FIGURES}


def run(command: list[str | Path]) -> str:
    """Run a command outside of the checkout, and return what it prints; end with its error where it fails."""
    usual = {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")}
    done = subprocess.run(
        command, cwd=ROOT.parent, env=usual, capture_output=True, text=True, check=False
    )
    if done.returncode:
        said = (done.stderr or done.stdout).strip()
        sys.exit(f"{' '.join(map(str, command))}: exit code {done.returncode}\n{said}")
    return done.stdout


def main() -> None:
    """Play with the versions that are asked for, and compare what they give."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--lowest", action="store_true", help="leave out the newest versions")
    resolutions = [LOWEST] if parser.parse_args().lowest else [LOWEST, NEWEST]
    with TemporaryDirectory() as place:
        outcomes = [play(resolution, Path(place) / resolution) for resolution in resolutions]
    if any(outcome != outcomes[0] for outcome in outcomes):
        sys.exit("the lowest and the newest versions do not give the same program and figures")


if __name__ == "__main__":
    main()
