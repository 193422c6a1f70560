"""Build the core with Verilator or Icarus Verilog, and run it on files.

A built simulator depends on the sources and the sizes of the core, and serves all programs that
fit, so it is kept in the user's cache folder.
"""

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
"""Debian packages of tools whose package has another name."""


@cache
def sources() -> dict[str, str]:
    """Return the SystemVerilog files by name, with the test benches."""
    entries = sorted((files("hw_model") / "rtl").iterdir(), key=lambda entry: entry.name)
    return {entry.name: entry.read_text("utf-8") for entry in entries if entry.name.endswith(".sv")}


def built(
    simulator: str, sizes: Sizes, texts: Mapping[str, str], top: str = "bench", **more: int
) -> Path:
    """Return a built simulator from the user's cache folder; build it if it is not there.

    Raise an ``InputError`` if a tool is missing. ``texts`` are the SystemVerilog files by name,
    ``top`` is the module to run, and ``more`` are parameters of it besides the sizes.
    """
    check_known(f"simulator {simulator!r}", "does not exist", simulator, SIMULATORS)
    parameters_by_name = parameters(sizes) | {name.upper(): value for name, value in more.items()}
    # All that a built simulator depends on.
    content = repr((simulator, parameters_by_name, top, sorted(texts.items()))).encode()
    key = hashlib.sha256(content).hexdigest()[:16]
    binary = cache_path(f"rtl-{key}-{_BINARY[simulator]}")
    if not binary.exists():
        _log.info("building the core with %s, once for its sizes: up to a minute", simulator)
        # Next to its place in the cache, so that it can be moved there in one step: another process
        # that builds the same simulator never finds half of it.
        with tempfile.TemporaryDirectory(dir=binary.parent) as temporary:
            folder = Path(temporary)
            for name, text in texts.items():
                (folder / name).write_text(text)
            command = _build_command(simulator, parameters_by_name, top, sorted(texts))
            run_tool(command, folder, f"simulator {simulator!r}")
            os.replace(folder / _BINARY[simulator], binary)
    return binary


def cache_path(name: str) -> Path:
    """Return the path of a file in the user's cache folder.

    Where that cannot be written, and does not hold the file, the path is in a temporary folder that
    is removed when this process ends.
    """
    folder = Path(os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")) / "locsnn"
    # Without a home folder, the "~" stays, and the path is not absolute.
    with suppress(OSError):
        if folder.is_absolute():
            folder.mkdir(parents=True, exist_ok=True)
            if (folder / name).exists() or os.access(folder, os.W_OK):
                return folder / name
    return _temporary_folder() / name


@cache
def _temporary_folder() -> Path:
    """Return a folder that is removed when this process ends, the same in every call."""
    folder = tempfile.mkdtemp(prefix="locsnn-")
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return Path(folder)


def run(binary: Path, folder: Path, patience: int) -> None:
    """Run a built simulator on the files ``load`` and ``words`` of a folder, and write there."""
    run_tool([*command_of(binary), f"+patience={patience}"], folder, "the open core")


def command_of(binary: Path) -> list[str]:
    """Return the command that starts a built simulator.

    Verilator builds a program; Icarus Verilog builds a file for its interpreter, vvp.
    """
    interpreter = ["vvp", "-n"] if binary.suffix == ".vvp" else []
    return [*interpreter, str(binary)]


def _build_command(
    simulator: str, parameters_by_name: Mapping[str, int], top: str, names: list[str]
) -> list[str]:
    """Return the command that builds a simulator of the module ``top`` from files of these names."""
    prefix = f"-P{top}." if simulator == "icarus" else "-G"
    options = [f"{prefix}{name}={value}" for name, value in parameters_by_name.items()]
    if simulator == "icarus":
        return ["iverilog", "-g2012", "-s", top, "-o", _BINARY[simulator], *options, *names]
    # Warnings are off, as texts may hold planted faults; tests lint the sources with all warnings.
    # The C++ is compiled with -O1 only, to build faster.
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


def run_tool(command: list[str], folder: Path, where: str) -> str:
    """Run a command in a folder and return its output, or what it wrote to stderr if there is none.

    Raise an ``InputError`` that names ``where`` if the command is not installed or fails. Tools
    that pip installed next to this Python are found even if they are not on the path.
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
