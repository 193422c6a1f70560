"""Plant faults, one at a time: tell which of them the tests find, and write ``results.csv``. Resumable.

Each is in the memory of a process of its own alone, which runs its tests until one fails, in a copy of the tree. What was
found is kept in ``build/mutants/found.jsonl`` and holds as long as the function and the tests stay as they were. At the
end, the tests that found a fault are run once without any: a test that fails nevertheless has found nothing.

    python tests/mutants/run_mutants.py [--share 0.15] [--jobs 2] [--only TEXT ...] [--dry]

Fails if a fault that ``results.csv`` calls told is told no longer.
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
from importlib import import_module
from importlib.machinery import ModuleSpec, SourceFileLoader
from importlib.util import spec_from_file_location
from pathlib import Path
from typing import Never

from faults import ROOT, Fault
from tested import HERE, Tested, file_of, modules, reasons

BUILD = ROOT / "build/mutants"
TREE = BUILD / "tree"
FOUND = BUILD / "found.jsonl"
TABLE = HERE / "results.csv"
COLUMNS = ("module", "scope", "is", "becomes", "number", "outcome", "by")
SHARE = 0.15
"""Of all faults, those that are planted unless more are asked for."""
TOLD, NOT_TOLD, NOTHING, NOT_NOTHING = (
    "told",
    "not told",
    "changes nothing",
    "told, unlike its reason",
)
"""What comes of a fault."""
Outcome = tuple[str, str]
"""What comes of it, and the test that told it or the reason."""
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

    def __init__(self, fault: Fault) -> None:
        super().__init__(fault.module, str(fault.path(TREE)))
        self._text = fault.applied(TREE).encode()

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
    """Tests of a module in a process of their own: with a fault, within :data:`SECONDS`, or without one."""

    def __init__(self, tested: Tested, fault: Fault | None) -> None:
        self.tested = tested
        self.fault = fault
        output, self._output = tempfile.mkstemp(dir=BUILD)
        self._compiled = tempfile.mkdtemp(dir=BUILD)
        self.process = os.fork()
        if not self.process:
            os.dup2(output, 1)
            os.dup2(output, 2)
            os._exit(self._run())
        os.close(output)

    def finished(self, code: int) -> Outcome:
        """Return whether it was told, and by which test; tests that cannot be run end the program."""
        text = Path(self._output).read_text(errors="replace")
        os.unlink(self._output)
        shutil.rmtree(self._compiled)
        held = HELD.search(text)
        by = ""
        if held:
            file, colons, test = held[1].partition("::")
            by = Path(file).name + colons + test
        elif code < 0:
            by = "crashed, or out of time"
        if code and (self.fault is None or not by):
            fault = self.fault.name if self.fault else "without a fault"
            raise SystemExit(
                f"{' '.join(self.tested.tests)}: pytest fails, {fault}:\n{text[-3000:]}"
            )
        return (TOLD, by) if code else (NOT_TOLD, "")

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
        if self.fault:
            limit = SECONDS[self.tested.loops]
            resource.setrlimit(resource.RLIMIT_CPU, (limit, limit))
            resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
            sys.meta_path.insert(0, Faulty(self.fault))  # type: ignore[arg-type]
            if self.tested.compiled:
                # For this process alone: from the shared cache, every later run would load it.
                os.environ["NUMBA_CACHE_DIR"] = import_module("numba").config.CACHE_DIR = (
                    self._compiled
                )
        names = [
            str(file_of(name, TREE)) + "".join(name.partition("::")[1:])
            for name in self.tested.tests
        ]
        plugins = [
            "-p",
            "no:cacheprovider",
            "-p",
            "no_shrinking",
            *(["-p", "interpreted"] if self.tested.loops else []),
        ]
        quiet = ["-x", "-q", "-n0", "--tb=line", "-W", "ignore:Module already imported"]
        in_seconds = ["-m", "not minutes and not mutants and not peers and not bench"]
        return int(import_module("pytest").main([*quiet, *in_seconds, *plugins, *names]))


def digests(fault: Fault, root: Path = ROOT) -> dict[str, str]:
    """Return a number of all that a result depends on: the function, and the tests."""
    tests = modules()[fault.module].tests
    texts = {
        "scope": fault.scope_text(root),
        "tests": "".join(file_of(test, root).read_text() for test in tests),
    }
    return {key: hashlib.sha256(text.encode()).hexdigest()[:16] for key, text in texts.items()}


def known(wanted: list[Fault]) -> dict[Fault, Outcome]:
    """Return what earlier runs found.

    A fault that was told stays so while its function is the same, and the test that told it is still there; one that
    was not told, while the tests are the same.
    """
    rows = [json.loads(line) for line in FOUND.read_text().splitlines()] if FOUND.exists() else []
    by_name = {row["name"]: row for row in rows}
    found = {}
    for fault in wanted:
        row = by_name.get(fault.name)
        if row is None:
            continue
        now = digests(fault)
        tests_hold = (
            _is_there(row["by"]) if row["outcome"] == TOLD else row["tests"] == now["tests"]
        )
        if row["scope"] == now["scope"] and tests_hold:
            found[fault] = row["outcome"], row["by"]
    return found


def _is_there(by: str) -> bool:
    """Tell whether a test still exists, by its file and the name of its function."""
    file, _, test = by.partition("[")[0].partition("::")
    text = f"def {test.rpartition('::')[2]}("
    return not test or any(text in path.read_text() for path in (ROOT / "tests").rglob(file))


def try_all(wanted: list[Fault], jobs: int) -> None:
    """Plant faults, so many at once, and keep what is found."""
    waiting = deque(wanted)
    running: dict[int, Run] = {}
    begun = time.monotonic()
    done = 0
    while waiting or running:
        while waiting and len(running) < jobs:
            fault = waiting.popleft()
            run = Run(modules()[fault.module], fault)
            running[run.process] = run
        process, status, usage = os.wait4(-1, 0)
        run = running.pop(process)
        assert run.fault is not None
        outcome, by = run.finished(os.waitstatus_to_exitcode(status))
        seconds = round(usage.ru_utime + usage.ru_stime, 1)
        done += 1
        row = {"name": run.fault.name, "outcome": outcome, "by": by, "seconds": seconds}
        row |= digests(run.fault, TREE)
        with FOUND.open("a") as file:
            file.write(json.dumps(row) + "\n")
        passed = time.monotonic() - begun
        print(
            f"{done}/{len(wanted)} {passed:.0f} s, {seconds} s: {outcome}: {run.fault.name} {by}",
            flush=True,
        )


def check_tests(found: dict[Fault, Outcome]) -> None:
    """Run the tests that told a fault without any; one that fails ends the program."""
    for loops in (False, True):
        told_by = {
            by
            for fault, (_, by) in found.items()
            if "::" in by and modules()[fault.module].loops == loops
        }
        if not told_by:
            continue
        run = Run(Tested("", tuple(sorted(told_by)), loops=loops), None)
        _, status, usage = os.wait4(run.process, 0)
        run.finished(os.waitstatus_to_exitcode(status))
        seconds = usage.ru_utime + usage.ru_stime
        print(f"tests that told a fault, without any: {seconds:.1f} s", flush=True)


def ready() -> None:
    """Copy the tree, and import what tests need beside the packages."""
    copy_tree()
    os.environ |= {"NUMBA_CACHE_DIR": str(BUILD / "loops"), "OMP_NUM_THREADS": "1"}
    for name in PRELOADED:
        import_module(name)


def outcome_of(fault: Fault, found: Outcome) -> Outcome:
    """Return the outcome as the table has it."""
    reason = reasons().get(fault.name)
    if reason is None:
        return found
    outcome, by = found
    return (NOTHING, reason) if outcome == NOT_TOLD else (NOT_NOTHING, by)


def recorded() -> dict[tuple[str, ...], str]:
    """Return the outcomes of the last whole run, by the columns that name a fault."""
    if not TABLE.exists():
        return {}
    with TABLE.open(newline="") as file:
        return {tuple(row[c] for c in COLUMNS[:5]): row["outcome"] for row in csv.DictReader(file)}


def lost_since(outcomes: dict[Fault, Outcome]) -> list[str]:
    """Return the faults that the last whole run told and this one does not, by name."""
    before = recorded()
    return [
        fault.name
        for fault, (outcome, _) in outcomes.items()
        if outcome == NOT_TOLD and before.get(key_of(fault)) == TOLD
    ]


def key_of(fault: Fault) -> tuple[str, ...]:
    """Return the columns that name a fault."""
    return (fault.module, fault.scope, fault.old, fault.new, str(fault.number))


def write_table(outcomes: dict[Fault, Outcome]) -> None:
    """Write the table of a whole run."""
    with TABLE.open("w", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(COLUMNS)
        writer.writerows((*key_of(fault), *outcome) for fault, outcome in outcomes.items())


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--share", type=float, default=SHARE, help="of all faults (default: 0.15)")
    parser.add_argument(
        "--only",
        nargs="+",
        metavar="TEXT",
        help="those whose name holds one of these, all of them; writes no table",
    )
    parser.add_argument("--dry", action="store_true", help="only list what is left to run")
    args = parser.parse_args()
    every = [fault for tested in modules().values() for fault in tested.faults]
    if args.only:
        wanted = [fault for fault in every if any(text in fault.name for text in args.only)]
    else:
        wanted = [fault for fault in every if fault.is_in(args.share)]
    kept = known(wanted)
    # Those that nothing tells take longest.
    left = sorted((f for f in wanted if f not in kept), key=lambda fault: fault.name in reasons())
    print(f"{len(every)} faults, {len(wanted)} wanted, {len(left)} of them to run", flush=True)
    if args.dry:
        print("\n".join(fault.name for fault in left))
        return 0
    ready()
    try_all(left, args.jobs)
    found = known(wanted)
    outcomes = {fault: outcome_of(fault, outcome) for fault, outcome in found.items()}
    lost = lost_since(outcomes)
    if not args.only:
        check_tests(found)
        write_table(outcomes)
    counts = Counter(outcome for outcome, _ in outcomes.values())
    print(", ".join(f"{number} {outcome}" for outcome, number in counts.items()))
    for outcome in (NOT_TOLD, NOT_NOTHING):
        print("\n".join(f"{outcome}: {f.name}" for f, (o, _) in outcomes.items() if o == outcome))
    print("\n".join(f"told before, and no longer: {name}" for name in lost))
    return 1 if lost or counts[NOT_NOTHING] else 0


if __name__ == "__main__":
    sys.exit(main())
