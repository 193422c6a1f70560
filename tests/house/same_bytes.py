"""Compare everything that the commands write with what an earlier commit wrote, byte for byte.

    python tests/house/same_bytes.py --against REV [--quick]

For a change that must not change any output. The code of ``REV`` (in a worktree that this script makes and removes) and
the code of this tree get the same inputs, written by ``same_inputs.py``, and run the same commands, listed in
``same_cases.py``: all shipped models on all shipped recordings, the strategies, files of other tools, and the other
commands. For each file that differs, the changed keys, lines or arrays are printed. Only the digest of the sources that
``explore`` writes may differ. The exit code is 1 if anything else does. The output of an earlier commit is kept in
build/same_bytes until inputs or cases change; ``--quick`` runs some of the cases.
"""

from __future__ import annotations

import argparse
import hashlib
import os
import shutil
import subprocess
import sys
from pathlib import Path

from differences import differences
from same_cases import CASES, CODES, QUICK

HERE = Path(__file__).parent
ROOT = HERE.parents[1]
PROCESSES = 2
"""Processes that run the cases of one tree side by side; chosen by hand."""
MOST_LINES = 12
"""Lines printed for a file that differs, unless `--all-lines` is given."""


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--against", default="HEAD", metavar="REV", help="the earlier commit (default HEAD)"
    )
    parser.add_argument("--quick", action="store_true", help="a part of the cases")
    parser.add_argument(
        "--work", type=Path, default=ROOT / "build/same_bytes", help="folder to write"
    )
    parser.add_argument(
        "--all-lines", action="store_true", help="say every changed key and line of a file"
    )
    args = parser.parse_args()
    commit = git("rev-parse", f"{args.against}^{{commit}}")
    names = QUICK if args.quick else tuple(CASES)

    inputs = args.work.resolve() / "inputs"
    run_script("same_inputs.py", ROOT, inputs)
    before = args.work.resolve() / f"{commit[:12]}-{digest(inputs)}"
    after = args.work.resolve() / "now"
    # The file of exit codes is written last, so a case without it was not run to its end.
    if missing := [name for name in names if not (before / name / CODES).exists()]:
        play_commit(commit, before, missing)
    shutil.rmtree(after, ignore_errors=True)
    play(ROOT, after, names)

    most = None if args.all_lines else MOST_LINES
    by_case = {name: differences(before / name, after / name) for name in names}
    for name, files in by_case.items():
        print("\n".join(case_lines(name, (after / name / CODES).read_text(), files, most)))
    by_file = [lines for files in by_case.values() for lines in files.values()]
    same = by_file.count([])
    print(f"{same} files the same, {len(by_file) - same} differ, against {commit[:12]}")
    # A comparison of no files at all is a failure too.
    return 0 if by_file and not any(by_file) else 1


def case_lines(name: str, codes: str, files: dict[str, list[str]], most: int | None) -> list[str]:
    """Return the lines to print for a case: the number of equal files, and the differences of each other file.

    `files` holds the differences by file, and `most` how many are printed for a file (None: all).
    """
    same = sum(not differing for differing in files.values())
    lines = [f"{name}: {same} of {len(files)} files the same (exit codes {codes})"]
    for file, differing in files.items():
        if not differing:
            continue
        lines.append(f"  {file}")
        lines += [f"    {line}" for line in differing[:most]]
        if most is not None and len(differing) > most:
            lines.append(f"    and {len(differing) - most} more")
    return lines


def play_commit(commit: str, folder: Path, names: list[str]) -> None:
    """Run cases with the code of a commit, in a worktree made for it."""
    tree = folder.parent / "tree"
    # A run that was ended half-way has left its worktree behind.
    git("worktree", "prune")
    if tree.exists():
        git("worktree", "remove", "--force", str(tree))
    git("worktree", "add", "--detach", str(tree), commit)
    try:
        play(tree, folder, names)
    finally:
        git("worktree", "remove", "--force", str(tree))


def play(tree: Path, folder: Path, names: list[str] | tuple[str, ...]) -> None:
    """Run cases with the code of a tree, in processes that each take the next case that no other has taken."""
    for name in names:
        shutil.rmtree(folder / name, ignore_errors=True)
    folder.mkdir(parents=True, exist_ok=True)
    players = [start_script("same_play.py", tree, folder, *names) for _ in range(PROCESSES)]
    # A list, not a generator: all processes are waited for, also after one has failed.
    if any([player.wait() for player in players]):
        raise SystemExit(f"the cases did not end with the code of {tree}")


def run_script(script: str, tree: Path, *words: Path | str) -> None:
    """Run a script of this folder to its end; end this program if it fails."""
    if start_script(script, tree, *words).wait():
        raise SystemExit(f"{script} failed")


def start_script(script: str, tree: Path, *words: Path | str) -> subprocess.Popen[bytes]:
    """Start a script of this folder that imports the packages of a tree."""
    import_path = os.pathsep.join(map(str, (tree, ROOT / "tests/frontends")))
    # A fixed width, so that help texts are wrapped alike in every terminal.
    environment = os.environ | {"PYTHONPATH": import_path, "COLUMNS": "120"}
    return subprocess.Popen([sys.executable, HERE / script, *words], env=environment, cwd=ROOT)


def digest(inputs: Path) -> str:
    """Return a digest of the inputs and the cases. Output kept under another digest cannot be compared."""
    input_files = sorted(path for path in inputs.rglob("*") if path.is_file())
    files = [HERE / "same_cases.py", HERE / "same_play.py", *input_files]
    digests = b"".join(hashlib.sha256(path.read_bytes()).digest() for path in files)
    return hashlib.sha256(digests).hexdigest()[:12]


def git(*words: str) -> str:
    """Run git in this checkout, and return what it prints."""
    return subprocess.run(
        ["git", *words], cwd=ROOT, check=True, capture_output=True, text=True
    ).stdout.strip()


if __name__ == "__main__":
    sys.exit(main())
