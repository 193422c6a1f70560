"""Make one environment for each peer under ``.peers/``, or write down why it cannot be made.

The peers' requirements exclude each other's and ours, so none is ever imported by this project. Running this again makes
only environments that are missing or were made by another recipe; names on the command line restrict it to these. A patch
changes a line of a peer that a later Python refuses; it is applied only to the file with the known hash.
"""

from __future__ import annotations

import hashlib
import shutil
import subprocess
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2] / ".peers"
PYTHON = sys.executable if sys.version_info[:2] == (3, 11) else "python3.11"
"""nengo-loihi needs a numpy that later Pythons do not have; brian2-loihi and lava-dl run on it too."""

RECIPES: Mapping[str, Sequence[str]] = {
    "nengo-loihi": ("numpy<1.24 scipy jinja2 nengo==3.2.0 nengo-loihi==1.1.0",),
    "brian2-loihi": ("numpy<2 brian2==2.9.0 brian2-loihi==0.5.2",),
    "lava-dl": (
        "torch==2.13.0",
        "--no-deps --ignore-requires-python lava-dl==0.6.0 lava-nc==0.10.0",
        "numpy<2 scipy h5py pyyaml matplotlib networkx asteval scikit-image",
    ),
    "lava": (
        "--no-deps --ignore-requires-python lava-nc==0.10.0",
        "numpy<2 scipy h5py pyyaml matplotlib networkx asteval",
    ),
    "sanafe": ("numpy<3 sanafe==2.2.9",),
    "spinnaker": ("spynnaker==1!7.4.1 unicorn==2.1.4",),
    "xylosim": ("numpy<3 scipy bitstruct==8.24.0 packaging==26.4 rockpool==3.1.0 xylosim==0.1.3",),
    "snntorch": ("numpy<3 torch==2.13.0 snntorch==1.0.0 nir==1.0.8 nirtorch==2.6",),
    "norse": ("norse==1.1.0 nir==1.0.8 nirtorch==2.6",),
    "sinabs": ("torch==2.13.0 sinabs==3.1.3 nir==1.0.4 nirtorch==2.0.2",),
    "spikingjelly": ("numpy<3 torch==2.13.0 spikingjelly==2.0.0 nir==1.0.8 nirtorch==2.6",),
}
"""The calls of ``pip install`` that fill an environment; lava-dl's own requirements cannot be met together."""


@dataclass(frozen=True)
class Patch:
    """Replaces the one place of a text in a file below ``site-packages``, whose SHA-256 is known."""

    path: str
    sha256: str
    text: str
    replacement: str

    def apply(self, packages: Path) -> None:
        """Change the file. Raise ``ValueError`` if it is another file than the one that the patch was written for."""
        file = packages / self.path
        content = file.read_bytes()
        digest = hashlib.sha256(content).hexdigest()
        if digest != self.sha256 or content.decode().count(self.text) != 1:
            raise ValueError(f"{self.path}: is not the file that the patch is for ({digest})")
        file.write_text(content.decode().replace(self.text, self.replacement), encoding="utf-8")


PATCHES: Mapping[str, Sequence[Patch]] = {
    # lava-nc asks for Python 3.10; 3.11 refuses a default value that cannot be hashed.
    "lava": (
        Patch(
            "lava/magma/compiler/var_model.py",
            "3b8acb73dc3ff38d159065aa0339b90f371f99f162e68d10a3117afbd916afa8",
            "@dataclass\nclass ByteEncoder",
            "@dataclass(unsafe_hash=True)\nclass ByteEncoder",
        ),
    ),
}


def python_of(name: str) -> Path:
    """Return the interpreter of an environment, made or not."""
    return ROOT / name / "bin" / "python"


def why_missing(name: str) -> str | None:
    """Return why an environment cannot be used, or None if it can."""
    if _stamp(name).exists():
        followed = _stamp(name).read_text() == _recipe(name)
        return None if followed else "made by another recipe: run `make peers`"
    note = _note(name)
    return note.read_text().strip() if note.exists() else "not made yet: run `make peers`"


def make(name: str) -> str | None:
    """Make an environment unless it was already made by this recipe; return why it could not be made, or None.

    The stamp, a copy of the recipe, is written last, so an interrupted environment is made again.
    """
    recipe, folder = RECIPES[name], ROOT / name
    if _stamp(name).exists() and _stamp(name).read_text() == _recipe(name):
        return None
    shutil.rmtree(folder, ignore_errors=True)
    _note(name).unlink(missing_ok=True)
    ROOT.mkdir(exist_ok=True)
    calls = [[PYTHON, "-m", "venv", str(folder)]]
    calls += [
        [str(python_of(name)), "-m", "pip", "install", "--quiet", *line.split()] for line in recipe
    ]
    try:
        for call in calls:
            subprocess.run(call, check=True, capture_output=True, text=True)
        for patch in PATCHES.get(name, ()):
            patch.apply(folder / "lib" / "python3.11" / "site-packages")
    except (OSError, ValueError, subprocess.CalledProcessError) as error:
        reason = (getattr(error, "stderr", None) or str(error)).strip().splitlines()[-1]
        _note(name).write_text(f"cannot be made: {reason}\n")
        return why_missing(name)
    _stamp(name).write_text(_recipe(name))
    return None


def _recipe(name: str) -> str:
    """Return what a stamp holds: the calls and, where there are any, the patches."""
    return "\n".join([*RECIPES[name], *map(str, PATCHES.get(name, ()))])


def _stamp(name: str) -> Path:
    """Return the file in an environment that holds the recipe by which it was made."""
    return ROOT / name / "recipe"


def _note(name: str) -> Path:
    """Return the file that says why an environment could not be made."""
    return ROOT / f"{name}.missing"


if __name__ == "__main__":
    for environment in sys.argv[1:] or RECIPES:
        print(f"{environment}: {make(environment) or 'ready'}", flush=True)
