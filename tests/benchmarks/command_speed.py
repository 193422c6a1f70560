"""Measure how long a user waits for the commands: warm, with nothing compiled yet, and with an earlier version.

    python tests/benchmarks/command_speed.py [--against REV] [--page docs/research/benchmarks.md] [--turns 5] [--cold 1]

Each turn runs every command once, with this version and with ``REV`` (a worktree that is made here), one right after the
other, so what is compared ran on the same machine at about the same time. Figures are medians over the turns, of seconds on
the clock and of processor seconds, which other work on the machine changes less.
"""

from __future__ import annotations

import argparse
import os
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from machine import machine
from page_figures import table
from page_section import put_section
from workloads import RECORDINGS
from write_page import COMMAND_SPEED

HERE = Path(__file__).parent
ROOT = HERE.parents[1]
MODEL, TOUCHES = (
    ROOT / "examples/models/objects-hybrid.pt",
    ROOT / "examples/recordings/touches.npz",
)
COMPILE, RUN = ("-m", "locsnn_compile.cli.compile"), ("-m", "locsnn_compile.cli.main", "run")
IMPORTS = "import numpy, numba, scipy.sparse"


@dataclass(frozen=True)
class Took:
    """The cost of a process: seconds on the clock, processor seconds, and the most memory that it held."""

    seconds: float
    processor: float
    mib: float


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--against", metavar="REV", help="an earlier commit to compare with")
    parser.add_argument(
        "--page",
        type=Path,
        metavar="FILE",
        help="page to write the section into; else it is printed",
    )
    parser.add_argument(
        "--turns", type=int, default=5, help="how often each command is run (default 5)"
    )
    parser.add_argument(
        "--cold", type=int, default=1, help="how often with an empty cache (default 1)"
    )
    parser.add_argument(
        "--only", default="`", metavar="TEXT", help="only the rows whose name holds a text"
    )
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder, worktree(args.against) as before:
        trees = [ROOT, *([before] if before else [])]
        found = measure(trees, Path(folder), args.turns, args.cold, args.only)
    text = section(
        found,
        args.against and git("log", "-1", "--format=%h, %cs", args.against),
        args.turns,
        args.cold,
    )
    if args.page:
        put_section(args.page, COMMAND_SPEED, text)
    else:
        print(text)
    return 0


def measure(
    trees: Sequence[Path], folder: Path, turns: int, cold: int, only: str
) -> dict[str, list[list[Took]]]:
    """Return the costs of all runs, by row and tree.

    The cold runs come first: they compile, and write the program that `locsnn run` plays.
    """
    program, out = folder / "program", folder / "out"
    touches = [str(MODEL), "--events", str(TOUCHES), "--quiet"]
    rows: dict[str, Sequence[str]] = {
        f"`{IMPORTS}`": ["-c", IMPORTS],
        "`locsnn-compile`, 8 recordings": [*COMPILE, *touches, "-o", str(out)],
        "`locsnn-compile --strategy dendrite`, 8 recordings": [
            *COMPILE,
            *touches,
            "-o",
            str(out),
            "--strategy",
            "dendrite",
        ],
        "`locsnn run`, 8 recordings": [*RUN, str(program), "--events", str(TOUCHES)],
    }
    if (objects := RECORDINGS / "Ev-Objects.zip").exists():
        rows["`locsnn-compile`, all of Ev-Objects"] = [
            *COMPILE,
            *touches,
            "--events",
            str(objects),
            "-o",
            str(out),
        ]
    cold_row = "`locsnn-compile`, nothing compiled yet"
    rows = {row: words for row, words in rows.items() if only in row or IMPORTS in row}
    costs: dict[str, list[list[Took]]] = {row: [[] for _ in trees] for row in (*rows, cold_row)}
    caches = [{"NUMBA_CACHE_DIR": str(folder / f"cache-{number}")} for number in range(len(trees))]
    for _ in range(cold):
        for tree, cache, costs_of_tree in zip(trees, caches, costs[cold_row], strict=True):
            shutil.rmtree(cache["NUMBA_CACHE_DIR"], ignore_errors=True)
            # The earlier version's program stays: later ones read it.
            costs_of_tree.append(run(tree, [*COMPILE, *touches, "-o", str(program)], cache))
    for _ in range(turns):
        for row, words in rows.items():
            for tree, cache, costs_of_tree in zip(trees, caches, costs[row], strict=True):
                costs_of_tree.append(run(tree, words, cache))
    return costs


def run(tree: Path, words: Sequence[str], environment: Mapping[str, str]) -> Took:
    """Run Python with the packages of a tree."""
    started = time.perf_counter()
    # Bytecode is kept, as an installation keeps it.
    bytecode_settings = {
        "PYTHONDONTWRITEBYTECODE": "",
        "PYTHONPYCACHEPREFIX": environment["NUMBA_CACHE_DIR"] + "-bytecode",
    }
    process_environment = (
        os.environ | {"PYTHONPATH": str(tree)} | bytecode_settings | dict(environment)
    )
    process = subprocess.Popen(
        [sys.executable, *words], env=process_environment, cwd=tree, stdout=subprocess.DEVNULL
    )
    _, status, usage = os.wait4(process.pid, 0)
    if status:
        raise SystemExit(f"{' '.join(words)} failed in {tree}")
    return Took(
        time.perf_counter() - started, usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 1024
    )


def section(found: dict[str, list[list[Took]]], against: str | None, turns: int, cold: int) -> str:
    """Return the page's section."""
    import_seconds = median(found[f"`{IMPORTS}`"][0], "seconds")
    rows = []
    for row, versions in found.items():
        now = versions[0]
        cells = [
            row,
            f"{median(now, 'seconds'):.2f}",
            f"{median(now, 'seconds') / import_seconds:.1f}",
        ]
        cells += [f"{median(now, 'processor'):.2f}", f"{median(now, 'mib'):.0f}"]
        for before in versions[1:]:
            cells += [f"{median(before, key):.2f}" for key in ("seconds", "processor")]
            cells += [
                f"{median(before, key) / median(now, key):.1f}"
                for key in ("seconds", "processor", "mib")
            ]
        rows.append(cells)
    head = ["", "s", "times the imports", "processor s", "MiB"]
    if against:
        head += [
            "before: s",
            "before: processor s",
            "ratio of s",
            "ratio of processor s",
            "ratio of MiB",
        ]
    before = f" *Before* is commit {against}, run in turns with this version." if against else ""
    return f"""## The command

Made by `python tests/benchmarks/command_speed.py`: new processes, reading, all strategies of `auto`, the check, the reports, files
written. *Nothing compiled yet* has an empty cache of compiled code. Medians of {turns} turns, and of {cold} with nothing
compiled.{before} The goal is 2 s, or six times the imports that it cannot do without.
Measured on {machine()["processor"]}; the average load of other work was {load():.1f}, so processor seconds say more than the clock's.

{table(head, rows)}
"""


def median(runs: Sequence[Took], key: str) -> float:
    """Return the median of a field over runs."""
    return statistics.median(getattr(one, key) for one in runs)


def load() -> float:
    """Return the average load of the last quarter of an hour, less what this script runs."""
    return max(0.0, os.getloadavg()[2] - 1)


@contextmanager
def worktree(commit: str | None) -> Iterator[Path | None]:
    """Give a folder with the code of a commit, removed at the end; None without a commit."""
    if commit is None:
        yield None
        return
    tree = ROOT / "build/command_speed"
    git("worktree", "prune")
    shutil.rmtree(tree, ignore_errors=True)
    git("worktree", "add", "--force", "--detach", str(tree), commit)
    try:
        yield tree
    finally:
        git("worktree", "remove", "--force", str(tree))


def git(*words: str) -> str:
    """Run git in the repository and return what it prints."""
    return subprocess.run(
        ["git", *words], cwd=ROOT, check=True, capture_output=True, text=True
    ).stdout.strip()


if __name__ == "__main__":
    sys.exit(main())
