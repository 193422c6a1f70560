"""Run cases of the byte comparison in this process: ``python same_play.py FOLDER CASE...``, with a tree on the path.

Each case gets a folder of its name, in which its commands run. What they print and their exit codes are written there. A
case whose folder exists belongs to another process, so several processes can share the cases.
"""

from __future__ import annotations

import io
import os
import shutil
import sys
from contextlib import redirect_stderr, redirect_stdout, suppress
from pathlib import Path

from same_cases import CASES, CODES

NOT_COMPARED = ("points", "timings.csv", "timings.svg")
"""Files and folders that are never the same twice: their names hold a digest of the sources, or they hold seconds."""


def main(folder: Path, names: list[str]) -> None:
    check_origin()
    for name in names:
        with suppress(FileExistsError):
            (folder / name).mkdir()
            play(folder / name, CASES[name])


def check_origin() -> None:
    """Check that the packages come from the tree that the path names first.

    With any other copy, the same code would be compared with itself.
    """
    import hw_model
    import locsnn_compile

    tree = Path(os.environ["PYTHONPATH"].split(os.pathsep)[0])
    for package in (hw_model, locsnn_compile):
        assert tree in Path(package.__file__).parents, f"{package.__file__} is not of {tree}"


def play(folder: Path, commands: list[str]) -> None:
    """Run the commands of a case in a folder, and keep what they print."""
    os.chdir(folder)
    codes = []
    for number, command in enumerate(commands):
        stdout = io.StringIO()
        stderr = io.StringIO()
        with redirect_stdout(stdout), redirect_stderr(stderr):
            codes.append(run(command))
        # Progress lines tell the time, which is never the same twice.
        messages = [
            line
            for line in stderr.getvalue().splitlines()
            if not line.startswith(("compiling ", "compiled in "))
        ]
        Path(f"{number}.txt").write_text("\n".join([*messages, stdout.getvalue()]))
    # All paths are found before the first is removed, for a folder must not change while it is walked.
    for path in [path for name in NOT_COMPARED for path in folder.rglob(name)]:
        shutil.rmtree(path) if path.is_dir() else path.unlink()
    Path(CODES).write_text(", ".join(map(str, codes)))


def run(command: str) -> int | str | None:
    """Run a command in this process as its program does; return its exit code."""
    program, *words = command.split()
    from locsnn_compile.cli.compile import main as compile_main
    from locsnn_compile.cli.main import main as locsnn_main

    try:
        return (compile_main if program == "compile" else locsnn_main)(words)
    except SystemExit as end:
        return end.code


if __name__ == "__main__":
    main(Path(sys.argv[1]), sys.argv[2:])
