"""Run the mutants: tell which of them the tests find, and write ``results.csv``. Resumable.

Each is in the memory of a process of its own alone, which runs its tests until one fails, in a copy of the tree. What was
found is kept in ``build/mutants/found.jsonl`` and holds as long as the function and the tests stay as they were. At the
end, the tests that found a fault are run once without any: a test that fails nevertheless has found nothing.

    python tests/mutants/run_mutants.py [--jobs 2] [--only TEXT ...] [--dry]
"""

from __future__ import annotations

import argparse
import csv
import hashlib
import json
import os
import re
import resource
import shutil
import sys
import tempfile
import time
from collections import Counter, deque
from dataclasses import replace
from importlib import import_module
from importlib.machinery import ModuleSpec, SourceFileLoader
from importlib.util import spec_from_file_location
from pathlib import Path
from typing import Never

from mutants import HERE, ROOT, Mutant, file_of, mutants

BUILD = ROOT / "build/mutants"
TREE = BUILD / "tree"
FOUND = BUILD / "found.jsonl"
TABLE = HERE / "results.csv"
COLUMNS = ("module", "scope", "old", "new", "outcome", "by")
COPIED = (
    "hw_model",
    "locsnn_compile",
    "tests",
    "examples",
    "docs",
    "pyproject.toml",
    "README.md",
    "Makefile",
)
PRELOADED = ("hypothesis.extra.numpy", "networkx", "numba", "pytest", "scipy.sparse", "yaml")
"""Imported once: runs of the tests are forks. The packages that are tested are not among them."""
MEMORY = 8 << 30
"""Bytes that a run with a fault may take: some faults ask for more and more."""
SECONDS = {False: 40, True: 200}
"""Seconds of the processor that a run may take: several times those of the longest without a fault, interpreted or not."""
HELD = re.compile(r"^(?:FAILED|ERROR) (.+?)(?: - .*)?$", re.MULTILINE)


class Faulty(SourceFileLoader):
    """Loads a module with a fault in it."""

    def __init__(self, mutant: Mutant) -> None:
        super().__init__(mutant.module, str(mutant.path(TREE)))
        self._text = mutant.applied(TREE).encode()

    def find_spec(self, name: str, *_: object) -> ModuleSpec | None:
        """Be the finder of this module, too."""
        return spec_from_file_location(name, self.path, loader=self) if name == self.name else None

    def get_data(self, path: str) -> bytes:
        """Return the faulty text."""
        return self._text

    def path_stats(self, path: str) -> Never:
        """Refuse to tell an age: what is compiled to bytes is neither taken from a cache nor kept."""
        raise OSError


def copy_tree() -> None:
    """Copy what is tested, so that work can go on; files keep their ages, and compiled loops stay valid."""
    shutil.rmtree(TREE, ignore_errors=True)
    TREE.mkdir(parents=True)
    for name in COPIED:
        if (ROOT / name).is_dir():
            shutil.copytree(ROOT / name, TREE / name, ignore=shutil.ignore_patterns("__pycache__"))
        else:
            shutil.copy2(ROOT / name, TREE / name)


class Run:
    """Tests of a mutant in a process of their own: with its fault, within :data:`SECONDS`, or without it."""

    def __init__(self, mutant: Mutant, *, faulty: bool = True) -> None:
        self.mutant, self.faulty = mutant, faulty
        output, self._output = tempfile.mkstemp(dir=BUILD)
        self._compiled = tempfile.mkdtemp(dir=BUILD)
        self.process = os.fork()
        if not self.process:
            os.dup2(output, 1)
            os.dup2(output, 2)
            os._exit(self._run())
        os.close(output)

    def finished(self, code: int) -> tuple[str, str]:
        """Return ``killed`` and the test that did it, or ``survived``; tests that cannot be run end the program."""
        text = Path(self._output).read_text(errors="replace")
        os.unlink(self._output)
        shutil.rmtree(self._compiled)
        held = HELD.search(text)
        file, colons, test = (
            held[1] if held else "crashed, or out of time" if code < 0 else ""
        ).partition("::")
        by = Path(file).name + colons + test
        if code and (not self.faulty or not by):
            fault = self.mutant.name if self.faulty else "without a fault"
            raise SystemExit(
                f"{' '.join(self.mutant.tests)}: pytest fails, {fault}:\n{text[-3000:]}"
            )
        return ("killed", by) if code else ("survived", "")

    def _run(self) -> int:
        os.chdir(TREE)
        here = str(TREE / HERE.relative_to(ROOT))
        os.environ["PYTHONPATH"] = f"{TREE}:{here}"
        sys.path[:] = [
            str(TREE),
            here,
            *(
                p
                for p in sys.path
                if p and (not p.startswith(str(ROOT)) or p.startswith(sys.prefix))
            ),
        ]
        if self.faulty:
            limit = SECONDS[self.mutant.loops]
            resource.setrlimit(resource.RLIMIT_CPU, (limit, limit))
            resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
            sys.meta_path.insert(0, Faulty(self.mutant))  # type: ignore[arg-type]
            if self.mutant.compiled:  # for this process alone: from the shared cache, every later run would load the fault
                os.environ["NUMBA_CACHE_DIR"] = import_module("numba").config.CACHE_DIR = (
                    self._compiled
                )
        names = [
            str(file_of(name, TREE)) + "".join(name.partition("::")[1:])
            for name in self.mutant.tests
        ]
        plugins = [
            "-p",
            "no:cacheprovider",
            "-p",
            "no_shrinking",
            *(["-p", "interpreted"] if self.mutant.loops else []),
        ]
        quiet = ["-x", "-q", "-n0", "--tb=line", "-W", "ignore:Module already imported"]
        return int(import_module("pytest").main([*quiet, *plugins, *names]))


def digests(mutant: Mutant, root: Path = ROOT) -> dict[str, str]:
    """Return a number of all that a result depends on: the faulty function, and the tests."""
    texts = {
        "scope": mutant.faulty_scope(root),
        "tests": "".join(file_of(t, root).read_text() for t in mutant.tests),
    }
    return {key: hashlib.sha256(text.encode()).hexdigest()[:16] for key, text in texts.items()}


def known(every: list[Mutant]) -> dict[str, tuple[str, str]]:
    """Return what earlier runs found, by name.

    A fault that was found stays so while its function is the same, and the test that found it is still there; one that
    was not found, while the tests are the same.
    """
    rows = [json.loads(line) for line in FOUND.read_text().splitlines()] if FOUND.exists() else []
    by_name = {row["name"]: row for row in rows}
    found = {}
    for mutant in every:
        row, now = by_name.get(mutant.name), digests(mutant)
        if row and row["scope"] == now["scope"]:
            holds = (
                _is_there(row["by"]) if row["outcome"] == "killed" else row["tests"] == now["tests"]
            )
            if holds:
                found[mutant.name] = row["outcome"], row["by"]
    return found


def _is_there(by: str) -> bool:
    """Tell whether a test still exists, by its file and the name of its function."""
    file, _, test = by.partition("[")[0].partition("::")
    text = f"def {test.rpartition('::')[2]}("
    return not test or any(text in path.read_text() for path in (ROOT / "tests").rglob(file))


def try_all(wanted: list[Mutant], jobs: int) -> None:
    """Run mutants, so many at once, and keep what is found."""
    waiting, running = deque(wanted), dict[int, Run]()
    begun, done = time.monotonic(), 0
    while waiting or running:
        while waiting and len(running) < jobs:
            run = Run(waiting.popleft())
            running[run.process] = run
        process, status, usage = os.wait4(-1, 0)
        run = running.pop(process)
        outcome, by = run.finished(os.waitstatus_to_exitcode(status))
        seconds, done = round(usage.ru_utime + usage.ru_stime, 1), done + 1
        row = {"name": run.mutant.name, "outcome": outcome, "by": by, "seconds": seconds} | digests(
            run.mutant, TREE
        )
        with FOUND.open("a") as file:
            file.write(json.dumps(row) + "\n")
        passed = time.monotonic() - begun
        print(
            f"{done}/{len(wanted)} {passed:.0f} s, {seconds} s: {outcome}: {run.mutant.name} {by}",
            flush=True,
        )


def check_killers(rows: list[tuple[Mutant, str, str]]) -> None:
    """Run the tests that found a fault without any; one that fails ends the program."""
    for loops in (False, True):
        some = [(mutant, by) for mutant, _, by in rows if mutant.loops == loops and "::" in by]
        if some:
            run = Run(
                replace(some[0][0], tests=tuple(sorted({by for _, by in some}))), faulty=False
            )
            _, status, usage = os.wait4(run.process, 0)
            run.finished(os.waitstatus_to_exitcode(status))
            print(
                f"tests that found a fault, without any: {usage.ru_utime + usage.ru_stime:.1f} s",
                flush=True,
            )


def ready() -> None:
    """Copy the tree, and import what tests need beside the packages."""
    copy_tree()
    os.environ |= {"NUMBA_CACHE_DIR": str(BUILD / "loops"), "OMP_NUM_THREADS": "1"}
    for name in PRELOADED:
        import_module(name)


def outcome_of(mutant: Mutant, found: tuple[str, str]) -> tuple[str, str]:
    """Return the outcome as the table has it, and what tells of it: a test, or the reason."""
    if not mutant.equivalent:
        return found
    return (
        ("equivalent", mutant.equivalent)
        if found[0] == "survived"
        else ("not equivalent", found[1])
    )


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1)
    parser.add_argument(
        "--only",
        nargs="+",
        default=[""],
        metavar="TEXT",
        help="those whose name holds one of these",
    )
    parser.add_argument("--dry", action="store_true", help="only list what is left to run")
    args = parser.parse_args()
    every = mutants()
    kept = known(every)
    left = [m for only in args.only for m in every if only in m.name and m.name not in kept]
    # Those that nothing finds take longest.
    left = sorted(dict.fromkeys(left), key=lambda m: bool(m.equivalent))
    print(f"{len(every)} mutants, {len(left)} of them to run", flush=True)
    if args.dry:
        print("\n".join(m.name for m in left))
        return 0
    ready()
    try_all(left, args.jobs)
    kept = known(every)
    rows = [(m, *outcome_of(m, kept[m.name])) for m in every if m.name in kept]
    if len(rows) == len(every):
        check_killers(rows)
        with TABLE.open("w", newline="") as file:
            writer = csv.writer(file, lineterminator="\n")
            writer.writerow(COLUMNS)
            writer.writerows(
                (m.module, m.scope, m.old, m.new, outcome, by) for m, outcome, by in rows
            )
    print(
        ", ".join(
            f"{n} {outcome}" for outcome, n in Counter(outcome for _, outcome, _ in rows).items()
        )
    )
    wrong = [
        f"{outcome}: {m.name} {by}"
        for m, outcome, by in rows
        if outcome not in ("killed", "equivalent")
    ]
    print("\n".join(wrong))
    return 1 if wrong or any(m.name not in kept for m in left) else 0


if __name__ == "__main__":
    sys.exit(main())
