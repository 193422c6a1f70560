"""Read damaged files of every kind, in processes under limits, and count what came of it.

    python tests/fuzz/fuzz.py [--cases N] [--first N] [--reader NAME] [--jobs N] [--json]

A case is a reader and a number, and the same for ever: both together are its seed. Exit code 1 where there is a fault.
"""

import argparse
import json
import os
import selectors
import signal
import sys
import tempfile
import time
import traceback
from dataclasses import dataclass, field
from pathlib import Path

from readers import READERS
from worker import run

WALL_SECONDS = 100
"""A case that waits for something takes no processor; on a busy machine others wait too."""
COUNTED = ("read", "refused", "faults")
"""Figures of a reader that are added over its cases."""
LARGEST = ("slowest_ms", "peak_mib")
"""Figures of which the largest counts."""


@dataclass
class Job:
    """The cases of a reader that are left, from ``first`` up to ``last``, and what came of those that are done.

    ``at`` is the case that is being read, ``ended`` whether the process came to its end, and ``heard`` when its last
    line came.
    """

    reader: object
    first: int
    last: int
    figures: dict = field(default_factory=lambda: dict.fromkeys(("cases", *COUNTED, *LARGEST), 0))
    faults: list = field(default_factory=list)
    at: int = -1
    ended: bool = False
    heard: float = 0.0

    def hear(self, line):
        """Take a line of the process."""
        self.heard = time.monotonic()
        if line.startswith("case "):
            self.at = int(line.split()[1])
            return
        if line == "end\n":
            self.ended = True
            return
        document = json.loads(line)
        if "fault" in document:
            self.faults.append(document)
        for key, value in document.get("figures", {}).items():
            self.figures[key] = (
                self.figures[key] + value if key in COUNTED else max(self.figures[key], value)
            )

    def end(self, status):
        """Note the end of the process; return whether cases are left, because one of them ended it."""
        if self.ended:
            return False
        self.faults.append({"case": self.at, "fault": f"it ended the process: status {status}"})
        self.figures["faults"] += 1
        if self.at < self.first:
            # It ended before its first case, and would do so again.
            return False
        self.first = self.at + 1
        return self.first < self.last


def start(job, folder):
    """Fork a process for a job; return its number and the stream of its lines."""
    reading, writing = os.pipe()
    job.ended, job.heard = False, time.monotonic()
    sys.stdout.flush()
    pid = os.fork()
    if pid:
        os.close(writing)
        return pid, os.fdopen(reading)
    code = 1
    try:
        os.close(reading)
        with os.fdopen(writing, "w") as out:
            run(Path(folder), job.reader, job.first, job.last, out)
        code = 0
    except BaseException:
        traceback.print_exc()
    finally:
        # Nothing of the parent's is to be tidied up here.
        sys.stderr.flush()
        os._exit(code)


def run_jobs(jobs, at_once):
    """Run all jobs, some at once."""
    waiting, running = list(jobs), selectors.DefaultSelector()
    with tempfile.TemporaryDirectory() as root:
        number = 0
        while waiting or running.get_map():
            while waiting and len(running.get_map()) < at_once:
                number += 1
                job = waiting.pop(0)
                pid, lines = start(job, Path(root) / str(number))
                running.register(lines, selectors.EVENT_READ, (job, pid))
            for key, _ in running.select(timeout=1):
                job, pid = key.data
                line = key.fileobj.readline()
                if line:
                    job.hear(line)
                    continue
                running.unregister(key.fileobj)
                key.fileobj.close()
                if job.end(os.waitpid(pid, 0)[1]):
                    waiting.append(job)
            for key in list(running.get_map().values()):
                job, pid = key.data
                if time.monotonic() - job.heard > WALL_SECONDS:
                    os.kill(pid, signal.SIGKILL)


def table(jobs):
    """Return the figures as lines."""
    rows = {job.reader.name: job.figures for job in jobs}
    sums = {key: sum(row[key] for row in rows.values()) for key in ("cases", *COUNTED)}
    rows["all"] = sums | {key: max(row[key] for row in rows.values()) for key in LARGEST}
    lines = [
        "| reader | cases | read | refused | faults | slowest ms | most MiB |",
        "| --- | --- | --- | --- | --- | --- | --- |",
    ]
    for name, row in rows.items():
        lines.append(
            f"| {name} | "
            + " | ".join(f"{row[key]:,.0f}" for key in ("cases", *COUNTED, *LARGEST))
            + " |"
        )
    return lines


def main():
    """Read cases and print what came of them; return 1 if there is a fault."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cases", type=int, default=22_950, help="of all readers together")
    parser.add_argument(
        "--first", type=int, default=0, help="number of the first case of each reader"
    )
    parser.add_argument("--reader", action="append", choices=[reader.name for reader in READERS])
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--json", action="store_true")
    args = parser.parse_args()
    readers = [reader for reader in READERS if reader.name in (args.reader or [reader.name])]
    share = -(-args.cases // len(readers))  # rounded up
    jobs = [Job(reader, args.first, args.first + share) for reader in readers]
    for job in jobs:
        job.figures["cases"] = share
    run_jobs(jobs, args.jobs)
    faults = [{"reader": job.reader.name, **fault} for job in jobs for fault in job.faults]
    if args.json:
        print(
            json.dumps(
                {"figures": {job.reader.name: job.figures for job in jobs}, "faults": faults}
            )
        )
    else:
        print("\n".join([*table(jobs), *map(str, faults)]))
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
