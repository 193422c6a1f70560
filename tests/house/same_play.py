"""Run cases of the byte comparison in this process: ``python same_play.py FOLDER CASE...``, with a tree on the path.

Each case gets a folder of its name, in which its commands run; what they print, and their exit codes, are files there. A
case that has its folder is another process's, so as many of these as wanted share the cases.
"""

from __future__ import annotations

import io
import os
import shutil
import sys
from contextlib import redirect_stderr, redirect_stdout, suppress
from pathlib import Path

from same_cases import CASES, CODES

UNLIKE = ("points", "timings.csv", "timings.svg")
"""What a command writes under a digest of its sources, or by a clock."""


def main(folder: Path, names: list[str]) -> None:
    check_origin()
    for name in names:
        with suppress(FileExistsError):
            (folder / name).mkdir()
            play(folder / name, CASES[name])


def check_origin() -> None:
    """Fail where the packages are not those of the tree that the path names first: all would be the same."""
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
        text, errors = io.StringIO(), io.StringIO()
        with redirect_stdout(text), redirect_stderr(errors):
            codes.append(run(command))
        said = [
            line
            for line in errors.getvalue().splitlines()
            if not line.startswith(("compiling ", "compiled in "))
        ]
        Path(f"{number}.txt").write_text("\n".join([*said, text.getvalue()]))
    for path in [path for name in UNLIKE for path in folder.rglob(name)]:
        shutil.rmtree(path) if path.is_dir() else path.unlink()
    Path(CODES).write_text(", ".join(map(str, codes)))


def run(command: str) -> int | str | None:
    """Run a command of this package as its program does; return its exit code."""
    program, *words = command.split()
    from locsnn_compile.cli.compile import main as compile_main
    from locsnn_compile.cli.main import main as locsnn_main

    try:
        return (compile_main if program == "compile" else locsnn_main)(words)
    except SystemExit as end:
        return end.code


if __name__ == "__main__":
    main(Path(sys.argv[1]), sys.argv[2:])
