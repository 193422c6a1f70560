"""Plant faults, one at a time, run the tests, and write which faults they detect to ``results.csv``. Resumable.

A fault that a test detects is called "told". Each fault exists only in the memory of a process of its own, which runs the
tests of its module until one fails, in a copy of the tree. Results are kept in ``build/mutants/found.jsonl`` and stay valid
while the function and the tests are unchanged. At the end, all tests that detected a fault run once without any: one that
fails even then has detected nothing.

    python tests/mutants/run_mutants.py [--share 0.15] [--jobs 2] [--only TEXT ...] [--dry]

Fails if a fault that is told in ``results.csv`` is told no longer.
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
"""The share of all faults that is planted by default; chosen by hand for a run of bearable length."""
TOLD, NOT_TOLD, NOTHING, NOT_NOTHING = (
    "told",
    "not told",
    "changes nothing",
    "told, unlike its reason",
)
"""Outcomes of a fault. ``changes-nothing.yaml`` gives reasons why some faults cannot be detected."""
Outcome = tuple[str, str]
"""An outcome, and the test that detected the fault or the reason why none can."""
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
RECORDINGS = "shared"
"""The folder of recordings, next to the repository: ``tests/support/real_recordings.py``."""
PRELOADED = ("hypothesis.extra.numpy", "networkx", "numba", "pytest", "scipy.sparse", "yaml")
"""Packages that are imported once, since runs are forks of this process. The packages under test are not among them."""
MEMORY = 8 << 30
"""Bytes that a run with a fault may take, since some faults allocate without end; chosen by hand."""
SECONDS = {False: 40, True: 200}
"""Processor seconds that a run may take, by whether loops are interpreted: several times the longest without a fault."""
FAILED_TEST = re.compile(r"^(?:FAILED|ERROR) (.+?)(?: - .*)?$", re.MULTILINE)
"""The line of pytest's summary that names the test that failed."""


class Faulty(SourceFileLoader):
    """The import hook that loads one module with a fault in it."""

    def __init__(self, fault: Fault) -> None:
        super().__init__(fault.module, str(fault.path(TREE)))
        self._text = fault.applied(TREE).encode()

    def find_spec(self, name: str, *_: object) -> ModuleSpec | None:
        """Find this one module; leave all others to the usual finders."""
        return spec_from_file_location(name, self.path, loader=self) if name == self.name else None

    def get_data(self, path: str) -> bytes:
        """Return the faulty text."""
        return self._text

    def path_stats(self, path: str) -> Never:
        """Refuse to give the file's age, so that Python neither reads bytecode of the sound module nor keeps the faulty one's."""
        raise OSError


def copy_tree() -> None:
    """Copy the tested files, so that the checkout may change meanwhile.

    Files keep their ages, so that the cache of compiled loops stays valid.
    Recordings next to the repository are linked next to the copy, where tests look for them.
    """
    shutil.rmtree(TREE, ignore_errors=True)
    TREE.mkdir(parents=True)
    for name in COPIED:
        if (ROOT / name).is_dir():
            shutil.copytree(ROOT / name, TREE / name, ignore=shutil.ignore_patterns("__pycache__"))
        else:
            shutil.copy2(ROOT / name, TREE / name)
    link = BUILD / RECORDINGS
    link.unlink(missing_ok=True)
    if (ROOT.parent / RECORDINGS).is_dir():
        link.symlink_to((ROOT.parent / RECORDINGS).resolve(), target_is_directory=True)


class Run:
    """The tests of a module, in a process of their own: with a fault, within :data:`SECONDS`, or without one."""

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
        """Return the outcome of the ended process, given its exit code (below 0: the signal that ended it).

        Raise SystemExit if the tests fail without a fault, or cannot be run.
        """
        text = Path(self._output).read_text(errors="replace")
        os.unlink(self._output)
        shutil.rmtree(self._compiled)
        failed = FAILED_TEST.search(text)
        by = ""
        if failed:
            file, colons, test = failed[1].partition("::")
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
        """Run the tests in the child process, and return the exit code of pytest."""
        os.chdir(TREE)
        here = str(TREE / HERE.relative_to(ROOT))
        os.environ["PYTHONPATH"] = f"{TREE}:{here}"
        # The copy takes the place of the checkout on the path; the virtual environment in it stays.
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
    """Return digests of the function and of the tests, on which a result depends."""
    tests = modules()[fault.module].tests
    texts = {
        "scope": fault.scope_text(root),
        "tests": "".join(file_of(test, root).read_text() for test in tests),
    }
    return {key: hashlib.sha256(text.encode()).hexdigest()[:16] for key, text in texts.items()}


def known(wanted: list[Fault]) -> dict[Fault, Outcome]:
    """Return the outcomes of earlier runs that are still valid.

    All are valid only while the function is unchanged. A detected fault also needs the test that
    detected it to exist still; an undetected one needs all tests to be unchanged.
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
    """Return whether a test still exists, by its file and the name of its function."""
    file, _, test = by.partition("[")[0].partition("::")
    text = f"def {test.rpartition('::')[2]}("
    return not test or any(text in path.read_text() for path in (ROOT / "tests").rglob(file))


def try_all(wanted: list[Fault], jobs: int) -> None:
    """Plant faults in `jobs` processes at a time, and keep the outcomes."""
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
    """Run all tests that detected a fault without any fault; raise SystemExit if one fails."""
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
    """Copy the tree, and import the packages of others that the tests need."""
    copy_tree()
    os.environ |= {"NUMBA_CACHE_DIR": str(BUILD / "loops"), "OMP_NUM_THREADS": "1"}
    for name in PRELOADED:
        import_module(name)


def outcome_of(fault: Fault, found: Outcome) -> Outcome:
    """Return the outcome that the table shows, which takes the known reasons into account."""
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
