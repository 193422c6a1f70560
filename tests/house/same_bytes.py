"""Everything that the commands write, byte for byte as an earlier commit wrote it: for a change that must change nothing.

    python tests/house/same_bytes.py --against REV [--quick]

The code of ``REV`` (a worktree that this script makes and removes) and the code of this tree get the same inputs, those of
``same_inputs.py``, and run the same commands, those of ``same_cases.py``: all shipped models on all shipped recordings, the
strategies, files of other tools, and the commands around the compiler. Each file is the same, or its changed keys, lines or
arrays are said. Only the digest of the sources that ``explore`` writes may differ. Exit code 1 where anything does. What an
earlier commit wrote is kept in build/same_bytes until inputs or cases change; ``--quick`` runs a part of the cases.
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
MOST_LINES = 12


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
    before, after = (
        args.work.resolve() / f"{commit[:12]}-{digest(inputs)}",
        args.work.resolve() / "now",
    )
    if missing := [name for name in names if not (before / name / CODES).exists()]:
        play_commit(commit, before, missing)
    shutil.rmtree(after, ignore_errors=True)
    play(ROOT, after, names)

    most = None if args.all_lines else MOST_LINES
    found = {name: differences(before / name, after / name) for name in names}
    for name, files in found.items():
        print("\n".join(case_lines(name, (after / name / CODES).read_text(), files, most)))
    differ = [file for files in found.values() for file in files.values()]
    print(
        f"{differ.count([])} files the same, {len(differ) - differ.count([])} differ, against "
        f"{commit[:12]}"
    )
    return 0 if differ and not any(differ) else 1


def case_lines(name: str, codes: str, files: dict[str, list[str]], most: int | None) -> list[str]:
    """Return what to say of a case: how many of its files are the same, and of each other one what differs."""
    same = sum(not found for found in files.values())
    lines = [f"{name}: {same} of {len(files)} files the same (exit codes {codes})"]
    for file, found in files.items():
        lines += [f"  {file}"] if found else []
        lines += [f"    {line}" for line in found[:most]]
        lines += (
            [f"    and {len(found) - most} more"] if most is not None and len(found) > most else []
        )
    return lines


def play_commit(commit: str, folder: Path, names: list[str]) -> None:
    """Play cases with the code of a commit, in a worktree made for it."""
    tree = folder.parent / "tree"
    git("worktree", "prune")
    if tree.exists():
        git("worktree", "remove", "--force", str(tree))
    git("worktree", "add", "--detach", str(tree), commit)
    try:
        play(tree, folder, names)
    finally:
        git("worktree", "remove", "--force", str(tree))


def play(tree: Path, folder: Path, names: list[str] | tuple[str, ...]) -> None:
    """Play cases with the code of a tree, in processes that each take the next case that no other has taken."""
    for name in names:
        shutil.rmtree(folder / name, ignore_errors=True)
    folder.mkdir(parents=True, exist_ok=True)
    players = [start_script("same_play.py", tree, folder, *names) for _ in range(PROCESSES)]
    if any([player.wait() for player in players]):
        raise SystemExit(f"the cases did not end with the code of {tree}")


def run_script(script: str, tree: Path, *words: Path | str) -> None:
    if start_script(script, tree, *words).wait():
        raise SystemExit(f"{script} failed")


def start_script(script: str, tree: Path, *words: Path | str) -> subprocess.Popen[bytes]:
    """Start a script of this folder that imports the packages of a tree."""
    places = (tree, ROOT / "tests/frontends")
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(map(str, places)), "COLUMNS": "120"}
    return subprocess.Popen([sys.executable, HERE / script, *words], env=environment, cwd=ROOT)


def digest(inputs: Path) -> str:
    """Return what stands for the inputs and the cases: with others, what was kept says nothing."""
    files = [
        HERE / "same_cases.py",
        HERE / "same_play.py",
        *sorted(p for p in inputs.rglob("*") if p.is_file()),
    ]
    return hashlib.sha256(
        b"".join(hashlib.sha256(path.read_bytes()).digest() for path in files)
    ).hexdigest()[:12]


def git(*words: str) -> str:
    """Run git here, and return what it prints."""
    return subprocess.run(
        ["git", *words], cwd=ROOT, check=True, capture_output=True, text=True
    ).stdout.strip()


if __name__ == "__main__":
    sys.exit(main())
