"""Kill a process while it replaces output, at each of its file operations or at random times, and look at what is left.

    kill_writer.py exchange|no exchange|journal|file|random FOLDER

Prints ``{"killed": n, "old": n, "new": n, "other": [...]}``: how often it killed, how often the output was then wholly
old or wholly new, and every other outcome. ``test_atomic_output.py`` runs it as a process of its own, because it forks.
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
"""Files of the user in the same folder, which must stay."""
RANDOM_KILLS = 40
"""Chosen by hand: some 20 ms each, and both outcomes occur."""


def tree(folder):
    """Return the content of a file or, by path, of all files of a folder that a reader would see."""
    if folder.is_file():
        return folder.read_bytes()
    files = {
        file.relative_to(folder).as_posix(): file for file in folder.rglob("*") if file.is_file()
    }
    # Files under a partial name are being written: readers ignore them.
    return {name: file.read_bytes() for name, file in files.items() if ".partial-" not in name}


def everything(root):
    """Return the paths of all files, hidden ones too."""
    return sorted(
        file.relative_to(root).as_posix() for file in root.rglob("*") if not file.is_dir()
    )


def everything_of(target, files):
    """Return what :func:`everything` should return if there is nothing but the output."""
    if isinstance(files, dict):
        return sorted(f"{target.name}/{name}" for name in files)
    return [target.name]


def set_up(mode, root):
    """Write the old output; return its path, and what a reader sees of the old and of the new output."""
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
    """Replace the old output by the new one."""
    if mode == "file":
        replace_file(target, b"new", "out")
    else:
        folders.replace_entries(target, NEW)


def die_at(point):
    """Kill this process before its ``point``-th audited operation. Python audits every operation on files."""
    operations_left = point

    def count(event, _):
        nonlocal operations_left
        operations_left -= 1
        if operations_left == 0:
            os.kill(os.getpid(), signal.SIGKILL)

    sys.addaudithook(count)


def child(work):
    """Run ``work`` in a forked process, and return its number."""
    pid = os.fork()
    if pid == 0:
        work()
        os._exit(0)
    return pid


def add_outcome(outcomes, content, old, new):
    """Count what is left after a kill as old or new, or list it as another outcome."""
    if content == old:
        outcomes["old"] += 1
    elif content == new:
        outcomes["new"] += 1
    else:
        outcomes["other"].append([outcomes["killed"], sorted(content)])


def at_every_operation(mode, root):
    """Kill the writer before its first operation, then before its second one, and so on until it finishes."""
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
        add_outcome(outcomes, tree(target), old, new)
        # A later writer finishes the work, and removes what the killed one left.
        write_new(mode, target)
        if tree(target) != new or everything(root) != everything_of(target, new):
            outcomes["other"].append([outcomes["killed"], "leftovers", everything(root)])


def at_random_times(root):
    """Kill a writer that replaces one output by the other again and again, at random times."""
    outcomes = {"killed": 0, "old": 0, "new": 0, "other": []}
    chance = random.Random(8)  # seed
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
        time.sleep(chance.uniform(0.001, 0.03))  # some replacements take this long
        os.kill(pid, signal.SIGKILL)
        os.waitpid(pid, 0)
        outcomes["killed"] += 1
        add_outcome(outcomes, tree(target), old, new)
    folders.replace_entries(target, NEW)
    if os.listdir(root) != [target.name]:
        outcomes["other"].append(os.listdir(root))
    return outcomes


def main(mode, root):
    """Print the outcomes of a mode, after patching away what the mode must do without."""
    # Killing a process loses nothing in the buffers of the system, so there is no need to wait for the disk.
    os.fsync = lambda handle: None
    if mode == "no exchange":
        folders._renameat2 = lambda: None
    if mode == "journal":
        folders._must_stay = lambda folder: True
    print(json.dumps(at_random_times(root) if mode == "random" else at_every_operation(mode, root)))


if __name__ == "__main__":
    main(sys.argv[1], Path(sys.argv[2]))
