"""The core built with Verilator or Icarus Verilog, once for its sizes, and run on files."""

import atexit
import hashlib
import logging
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from contextlib import suppress
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Literal, get_args

from hw_model.errors import InputError, check_known
from hw_model.io.extras import install_hint
from hw_model.rtl.images import Sizes, parameters

Simulator = Literal["verilator", "icarus"]
SIMULATORS: tuple[Simulator, ...] = get_args(Simulator)
_log = logging.getLogger("locsnn")
_BINARY = {"verilator": "bench", "icarus": "bench.vvp"}
PACKAGES = {"vvp": "iverilog"}
"""Of Debian, where a tool is in a package of another name."""


@cache
def sources() -> dict[str, str]:
    """Return the SystemVerilog files by name, the bench among them."""
    entries = sorted((files("hw_model") / "rtl").iterdir(), key=lambda entry: entry.name)
    return {entry.name: entry.read_text("utf-8") for entry in entries if entry.name.endswith(".sv")}


def built(
    simulator: str, sizes: Sizes, texts: Mapping[str, str], top: str = "bench", **more: int
) -> Path:
    """Return the built simulator, kept in the user's cache folder; a tool that is missing is an ``InputError``.

    ``more``: parameters of the module ``top`` besides the sizes.
    """
    check_known(f"simulator {simulator!r}", "does not exist", simulator, SIMULATORS)
    parameters_by_name = parameters(sizes) | {name.upper(): value for name, value in more.items()}
    named = hashlib.sha256(
        repr((simulator, parameters_by_name, top, sorted(texts.items()))).encode()
    ).hexdigest()[:16]
    binary = kept(f"rtl-{named}-{_BINARY[simulator]}")
    if not binary.exists():
        _log.info("building the core with %s, once for its sizes: up to a minute", simulator)
        with tempfile.TemporaryDirectory(dir=binary.parent) as folder:
            for name, text in texts.items():
                (Path(folder) / name).write_text(text)
            said(
                _command(simulator, parameters_by_name, top, sorted(texts)),
                Path(folder),
                f"simulator {simulator!r}",
            )
            os.replace(Path(folder) / _BINARY[simulator], binary)
    return binary


def kept(name: str) -> Path:
    """Return where what was built is kept: in the user's cache, else in a folder that goes with this process."""
    folder = Path(os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")) / "locsnn"
    # Of who has no home, the "~" stays.
    with suppress(OSError):
        if folder.is_absolute():
            folder.mkdir(parents=True, exist_ok=True)
            if (folder / name).exists() or os.access(folder, os.W_OK):
                return folder / name
    return _passing() / name


@cache
def _passing() -> Path:
    folder = tempfile.mkdtemp(prefix="locsnn-")
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return Path(folder)


def run(binary: Path, folder: Path, patience: int) -> None:
    """Play ``load`` and ``words`` of a folder; what the bench writes lies there, too."""
    said([*command_of(binary), f"+patience={patience}"], folder, "the open core")


def command_of(binary: Path) -> list[str]:
    """Return what starts a built simulator."""
    return [*(["vvp", "-n"] if binary.suffix == ".vvp" else []), str(binary)]


def _command(simulator: str, given: Mapping[str, int], top: str, names: list[str]) -> list[str]:
    prefix = f"-P{top}." if simulator == "icarus" else "-G"
    options = [f"{prefix}{name}={value}" for name, value in given.items()]
    if simulator == "icarus":
        return ["iverilog", "-g2012", "-s", top, "-o", _BINARY[simulator], *options, *names]
    plain = "--binary --timing -j 1 -O3 -CFLAGS -O1 -Wno-lint -Wno-fatal --Mdir ."
    return [
        "verilator",
        *plain.split(),
        "--top-module",
        top,
        "-o",
        _BINARY[simulator],
        *options,
        *names,
    ]


def said(command: list[str], folder: Path, where: str) -> str:
    """Return what a command says; one that is missing or fails is an ``InputError``.

    What pip has installed next to this Python is found, too.
    """
    tool = Path(command[0]).name
    path = f"{os.environ.get('PATH', '')}{os.pathsep}{Path(sys.executable).parent}"
    if shutil.which(command[0], path=path) is None:
        fix = f"Install it with: apt-get install {PACKAGES.get(tool, tool)} (Debian)."
        if tool.startswith("yowasp"):
            fix = install_hint("rtl")
        raise InputError(where, f"{tool} is not installed", fix=fix)
    environment = {**os.environ, "PATH": path}
    process = subprocess.run(
        command, cwd=folder, env=environment, capture_output=True, text=True, check=False
    )
    if process.returncode:
        words = (process.stderr or process.stdout).strip() or f"exit code {process.returncode}"
        raise InputError(where, f"{tool} failed", measured=words, fix="Report it.")
    return process.stdout or process.stderr
