"""Kill a process that replaces output at every one of its file operations, and look at what is left.

    kill_writer.py exchange|no exchange|journal|file|random FOLDER

Prints ``{"killed": n, "old": n, "new": n, "other": [...]}``. Run as a process of its own: it forks.
"""

import json
import os
import random
import shutil
import signal
import sys
import time
from pathlib import Path

from hw_model.io import folders
from hw_model.io.files import replace_file

OLD = {"program.yaml": b"old", "program.npz": b"o" * 100_000, "vectors/gone.hex": b"old"}
NEW = {
    "program.yaml": b"new",
    "program.npz": b"n" * 100_000,
    "vectors/come.hex": b"new",
    "report.json": b"{}",
}
MINE = {"notes.txt": b"mine", "mine/deep/er.txt": b"mine"}
RANDOM_KILLS = 40


def tree(folder):
    if folder.is_file():
        return folder.read_bytes()
    files = {
        file.relative_to(folder).as_posix(): file for file in folder.rglob("*") if file.is_file()
    }
    # What is hidden under a partial name is no output yet.
    return {name: file.read_bytes() for name, file in files.items() if ".partial-" not in name}


def everything(root):
    """Return all names, hidden ones too, but for folders."""
    return sorted(
        file.relative_to(root).as_posix() for file in root.rglob("*") if not file.is_dir()
    )


def everything_of(target, files):
    return (
        sorted(f"{target.name}/{name}" for name in files)
        if isinstance(files, dict)
        else [target.name]
    )


def set_up(mode, root):
    shutil.rmtree(root, ignore_errors=True)
    root.mkdir()
    target = root / "out"
    if mode == "file":
        replace_file(target, b"old", "out")
        return target, b"old", b"new"
    folders.replace_entries(target, OLD)
    for name, content in MINE.items():
        (target / name).parent.mkdir(parents=True, exist_ok=True)
        (target / name).write_bytes(content)
    (target / "link").symlink_to("notes.txt")
    mine = MINE | {"link": b"mine"}
    return target, OLD | mine, NEW | mine


def write_new(mode, target):
    if mode == "file":
        replace_file(target, b"new", "out")
    else:
        folders.replace_entries(target, NEW)


def die_at(point):
    """Kill this process before its ``point``-th operation that Python audits: all on files are."""
    left = point

    def count(event, _):
        nonlocal left
        left -= 1
        if left == 0:
            os.kill(os.getpid(), signal.SIGKILL)

    sys.addaudithook(count)


def child(work):
    pid = os.fork()
    if pid == 0:
        work()
        os._exit(0)
    return pid


def at_every_operation(mode, root):
    outcomes = {"killed": 0, "old": 0, "new": 0, "other": []}
    while True:
        target, old, new = set_up(mode, root)

        def work(target=target, point=outcomes["killed"] + 1):
            die_at(point)
            write_new(mode, target)

        _, status = os.waitpid(child(work), 0)
        if status == 0:
            return outcomes
        assert os.WTERMSIG(status) == signal.SIGKILL, status
        outcomes["killed"] += 1
        if mode in ("no exchange", "journal"):
            folders.recover_folder(target)
        left = tree(target)
        kind = "old" if left == old else "new" if left == new else "other"
        outcomes[kind] = (
            [*outcomes["other"], [outcomes["killed"], sorted(left)]]
            if kind == "other"
            else outcomes[kind] + 1
        )
        write_new(mode, target)
        if tree(target) != new or everything(root) != everything_of(target, new):
            outcomes["other"].append([outcomes["killed"], "leftovers", everything(root)])


def at_random_times(root):
    outcomes = {"killed": 0, "old": 0, "new": 0, "other": []}
    chance = random.Random(8)
    target, old, new = set_up("exchange", root)

    contents = [NEW | {"vectors/gone.hex": b"new"}, OLD | {"report.json": b"old"}]

    def work():
        while True:
            for content in contents:
                folders.replace_entries(target, content)

    new |= {"vectors/gone.hex": b"new"}
    old |= {"report.json": b"old"}
    folders.replace_entries(target, OLD | {"report.json": b"old"})
    while outcomes["killed"] < RANDOM_KILLS:
        contents.reverse()
        pid = child(work)
        time.sleep(chance.uniform(0.001, 0.03))
        os.kill(pid, signal.SIGKILL)
        os.waitpid(pid, 0)
        outcomes["killed"] += 1
        left = tree(target)
        kind = "old" if left == old else "new" if left == new else "other"
        outcomes[kind] = (
            [*outcomes["other"], sorted(left)] if kind == "other" else outcomes[kind] + 1
        )
    folders.replace_entries(target, NEW)
    if os.listdir(root) != [target.name]:
        outcomes["other"].append(os.listdir(root))
    return outcomes


def main(mode, root):
    # A kill takes nothing from the system's buffers, and waiting for the disk takes most of the time.
    os.fsync = lambda handle: None
    if mode == "no exchange":
        folders._renameat2 = lambda: None
    if mode == "journal":
        folders._must_stay = lambda folder: True
    print(json.dumps(at_random_times(root) if mode == "random" else at_every_operation(mode, root)))


if __name__ == "__main__":
    main(sys.argv[1], Path(sys.argv[2]))
