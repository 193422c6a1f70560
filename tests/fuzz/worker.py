"""Read damaged files, case after case, under limits; a process of its own, for a case may end it.

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

SECONDS, BYTES = 10, 2 << 30
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
)
FORBIDDEN += (
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
        self.reading, self.seen = False, []
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
    for line in Path("/proc/self/status").read_text().splitlines():
        if line.startswith("VmHWM"):
            return int(line.split()[1]) * 1024
    return 0


def fault_of(read):
    """Return what a reader did wrong, "" where nothing; and whether it refused the file."""
    try:
        read()
    except LocsnnError as error:
        line = str(error)
        if not line.isprintable():
            return f"its message does not print: {line!r}", True
        return (f"its message is long: {len(line)} characters" if len(line) > 3600 else ""), True
    except Exception as error:
        frame = traceback.extract_tb(error.__traceback__)[-1]
        return f"{type(error).__name__}: {error}"[
            :200
        ] + f" at {Path(frame.filename).name}:{frame.lineno}", False
    return "", False


def run(folder, reader, first, last, out):
    """Read cases ``first`` to ``last`` of a reader, each in ``folder``; tell of them on the stream ``out``."""
    (folder / "here").mkdir(parents=True)
    os.chdir(folder / "here")
    whole = folder / "whole"
    whole.mkdir()
    names = reader.make(whole)
    watch = Watch()
    for name in names:
        reader.read(whole, name)
    limit = (
        int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
        + BYTES
        + (1 << 30)
    )
    resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
    warnings.simplefilter("error")
    case = folder / "case"
    for number in range(first, last):
        print(f"case {number}", file=out, flush=True)
        chance = case_chance(reader.name, number)
        name = chance.choice(names)
        shutil.rmtree(case, ignore_errors=True)
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
        inside = sorted(os.listdir(folder))
        Path("/proc/self/clear_refs").write_text("5")
        before = peak_bytes()
        signal.setitimer(signal.ITIMER_PROF, SECONDS)
        watch.reading, began = True, time.process_time()
        fault, refused = fault_of(lambda name=name: reader.read(case, name))
        took, watch.reading = time.process_time() - began, False
        signal.setitimer(signal.ITIMER_PROF, 0)
        more = peak_bytes() - before
        faults = [fault, *watch.seen, f"{more} bytes" if more > BYTES else ""]
        if sorted(os.listdir(folder)) != inside or sorted(os.listdir()) != []:
            faults.append("it left a file")
        watch.seen.clear()
        for text in filter(None, faults):
            print(json.dumps({"case": number, "file": name, "fault": text}), file=out, flush=True)
        outcome = "faults" if any(faults) else "refused" if refused else "read"
        figures = {outcome: 1, "slowest_ms": 1000 * took, "peak_mib": more / 2**20}
        print(json.dumps({"figures": figures}), file=out, flush=True)
    print("end", file=out, flush=True)
