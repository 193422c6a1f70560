"""Shell completion: the scripts of ``locsnn completion``, and the answers to a shell that asks.

Bash itself is run with the script, and asked how a line goes on.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from locsnn_compile.cli.completion import PROGRAMS
from locsnn_compile.cli.main import main
from locsnn_compile.emitters import EMIT_KINDS

SHELLS = ("bash", "zsh", "fish")
BIN = Path(sys.executable).parent
ENVIRONMENT = {**os.environ, "PATH": f"{BIN}{os.pathsep}{os.environ['PATH']}"}


@pytest.fixture
def folder(tmp_path):
    """A folder with files that can be completed."""
    for name in ("my-chip.yaml", "notes.txt", "net.nir"):
        (tmp_path / name).write_text("")
    return tmp_path


def complete(line, folder):
    """Ask bash, with our script, how a line goes on."""
    script = (
        f'source <(locsnn completion bash); COMP_WORDS=({line}); [[ "$1" == *" " ]] && COMP_WORDS+=("")\n'
        'COMP_LINE="$1"; COMP_POINT=${#1}; COMP_CWORD=$((${#COMP_WORDS[@]} - 1)); COMP_TYPE=9\n'
        '_python_argcomplete "${COMP_WORDS[0]}"; printf "%s\\n" "${COMPREPLY[@]}"\n'
    )
    command = ["bash", "--norc", "-c", script, "bash", line]
    process = subprocess.run(
        command, cwd=folder, env=ENVIRONMENT, capture_output=True, text=True, check=False
    )
    assert process.returncode == 0, process.stderr
    return {word.rstrip() for word in process.stdout.splitlines()}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("line", "completions"),
    [
        ("locsnn t", {"train", "targets"}),
        ("locsnn targets --s", {"--show"}),
        ("locsnn-compile --target ", {"loihi-sim", "my-chip.yaml"}),
        ("locsnn-compile --target xylo-i", {"xylo-imu"}),
        ("locsnn targets --show xylo-a", {"xylo-audio2", "xylo-audio3"}),
        ("locsnn-compile --emit ", set(EMIT_KINDS)),
        ("locsnn-compile n", {"net.nir", "notes.txt"}),
        ("locsnn-compile net.nir --strategy d", {"dendrite", "delay-line"}),
        ("locsnn run build --stop ", {"proven", "margin"}),
        ("locsnn explore net.nir --strategy r", {"reset"}),
        ("locsnn explore net.nir --engines ", {"fast", "reference"}),
        ("locsnn completion ", set(SHELLS)),
    ],
)
def test_bash_completes(line, completions, folder):
    assert completions <= complete(line, folder)


@pytest.mark.parametrize("shell", SHELLS)
def test_a_script_is_one(shell, capsys, tmp_path):
    assert main(["completion", shell]) == 0
    script = capsys.readouterr().out
    for program in PROGRAMS:
        assert program in script
    if shutil.which(shell):
        (tmp_path / "script").write_text(script)
        process = subprocess.run(
            [shell, "-n", tmp_path / "script"], capture_output=True, text=True, check=False
        )
        assert (process.returncode, process.stderr) == (0, "")


def test_other_shells_are_refused(capsys):
    assert main(["completion", "fsh"]) == 2
    assert capsys.readouterr() == ("", "shell fsh: it is not known. Did you mean 'fish'?\n")
