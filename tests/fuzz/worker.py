"""Read damaged files, case after case, under limits. This runs in a process of its own, because a case may end it.

``run`` writes ``case N`` before each case and a JSON line for each fault. Limits: 10 s of the processor, 2 GiB more than
before, no process, no connection, no file but those that are read.
"""

import json
import os
import resource
import shutil
import signal
import sys
import time
import traceback
import warnings
from pathlib import Path

from mutate import case_chance, mutated

from locsnn_compile.errors import LocsnnError

SECONDS = 10
"""Processor time of a case."""
BYTES = 2 << 30
"""Memory that a case may take beyond what the process had before."""
MOST_CHARACTERS = 3600
"""Of a message: each of its parts is cut, so that a longer one is a fault."""
# Audit events of Python that begin with these are faults: a reader starts nothing, connects to
# nothing, and changes no file.
FORBIDDEN = (
    "os.system",
    "os.exec",
    "os.fork",
    "os.posix_spawn",
    "os.spawn",
    "subprocess.",
    "socket.",
    "shutil.",
    "ftplib.",
    "os.remove",
    "os.rename",
    "os.rmdir",
    "os.mkdir",
    "os.link",
    "os.symlink",
    "os.truncate",
    "os.chmod",
    "winreg.",
)


class Watch:
    """Notes what a reader does that no reader may, while it reads."""

    def __init__(self):
        self.reading = False
        self.seen = []
        # Python calls it for every event of the process, and it cannot be taken away again.
        sys.addaudithook(self)

    def __call__(self, event, args):
        if not self.reading:
            return
        writes = (
            event == "open"
            and isinstance(args[2], int)
            and args[2] & (os.O_WRONLY | os.O_RDWR | os.O_CREAT)
        )
        if writes or event.startswith(FORBIDDEN):
            self.seen.append(f"{event} {args[:1]}"[:200])


def peak_bytes():
    """Return the most memory that this process has held: VmHWM, which clear_refs resets."""
    for line in Path("/proc/self/status").read_text().splitlines():
        if line.startswith("VmHWM"):
            return int(line.split()[1]) * 1024
    return 0


def fault_of(read):
    """Return what a reader did wrong, or "" if nothing, and whether it refused the file."""
    try:
        read()
    except LocsnnError as error:
        line = str(error)
        if not line.isprintable():
            return f"its message does not print: {line!r}", True
        if len(line) > MOST_CHARACTERS:
            return f"its message is long: {len(line)} characters", True
        return "", True
    except Exception as error:
        frame = traceback.extract_tb(error.__traceback__)[-1]
        place = f"{Path(frame.filename).name}:{frame.lineno}"
        text = f"{type(error).__name__}: {error}"[:200]
        return f"{text} at {place}", False
    return "", False


def run(folder, reader, first, last, out):
    """Read cases from ``first`` up to, without, ``last`` in ``folder``; write lines about them to ``out``."""
    (folder / "here").mkdir(parents=True)
    os.chdir(folder / "here")
    whole = folder / "whole"
    whole.mkdir()
    names = reader.make(whole)
    watch = Watch()
    # Whole files are read first: what is imported or compiled on first use is no fault of a case.
    for name in names:
        reader.read(whole, name)
    address_space = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    # A gibibyte more than is counted as a fault, so that most cases that take too much are measured
    # instead of ended.
    limit = address_space + BYTES + (1 << 30)
    resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
    warnings.simplefilter("error")
    case = folder / "case"
    for number in range(first, last):
        print(f"case {number}", file=out, flush=True)
        chance = case_chance(reader.name, number)
        name = chance.choice(names)
        shutil.rmtree(case, ignore_errors=True)
        # Links instead of copies are quicker; the damaged file is replaced below, not written to.
        shutil.copytree(whole, case, copy_function=os.link)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            data = mutated((whole / name).read_bytes(), reader.kind, chance)
        (case / name).unlink()
        (case / name).write_bytes(data)
        if reader.mend:
            (case / "program.yaml").unlink()
            shutil.copy(whole / "program.yaml", case / "program.yaml")
            reader.mend(case, name)
        names_before = sorted(os.listdir(folder))
        Path("/proc/self/clear_refs").write_text("5")  # resets the peak of memory
        bytes_before = peak_bytes()
        signal.setitimer(signal.ITIMER_PROF, SECONDS)  # ends the process with SIGPROF
        watch.reading = True
        start = time.process_time()
        fault, is_refused = fault_of(lambda name=name: reader.read(case, name))
        seconds = time.process_time() - start
        watch.reading = False
        signal.setitimer(signal.ITIMER_PROF, 0)
        bytes_taken = peak_bytes() - bytes_before
        faults = [fault, *watch.seen]
        if bytes_taken > BYTES:
            faults.append(f"{bytes_taken} bytes")
        if sorted(os.listdir(folder)) != names_before or sorted(os.listdir()) != []:
            faults.append("it left a file")
        watch.seen.clear()
        for text in filter(None, faults):
            print(json.dumps({"case": number, "file": name, "fault": text}), file=out, flush=True)
        outcome = "refused" if is_refused else "read"
        if any(faults):
            outcome = "faults"
        figures = {outcome: 1, "slowest_ms": 1000 * seconds, "peak_mib": bytes_taken / 2**20}
        print(json.dumps({"figures": figures}), file=out, flush=True)
    print("end", file=out, flush=True)
