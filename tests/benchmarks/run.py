"""Everything that ``make bench`` does: make the peers' environments, run the benchmarks, write the pages.

``--quick`` only tries whether all of it runs.
"""

from __future__ import annotations

import argparse
import shutil
import subprocess
import sys
from pathlib import Path

HERE = Path(__file__).parent
ROOT = HERE.parents[1]


def main() -> int:
    """Return 0, or the exit code of the first part that failed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--quick", action="store_true", help="few rounds, small sizes; the page stays in build/"
    )
    parser.add_argument(
        "--against", metavar="REV", help="an earlier commit, which the command is compared with"
    )
    args = parser.parse_args()
    quick, against = args.quick, ["--against", args.against] if args.against else []
    results = ROOT / ("build/bench-quick" if quick else "build/bench")
    shutil.rmtree(results, ignore_errors=True)
    results.mkdir(parents=True)
    page = results / "benchmarks.md" if quick else ROOT / "docs/research/benchmarks.md"
    picture = results / "benchmarks.svg" if quick else ROOT / "docs/research/images/benchmarks.svg"
    measure = [
        "-m",
        "pytest",
        str(HERE),
        "-m",
        "bench",
        "--results",
        str(results),
        *(["--quick"] if quick else []),
    ]
    parts = (
        [str(HERE.parent / "peers/make_environments.py")],
        [*measure, "--benchmark-json", str(results / "pytest-benchmark.json")],
        [str(HERE / "write_page.py"), str(results), str(page), str(picture)],
        [
            str(HERE / "command_speed.py"),
            "--page",
            str(page),
            "--turns",
            "1" if quick else "9",
            *against,
        ],
    )
    for part in parts:
        code = subprocess.run([sys.executable, *part], cwd=ROOT).returncode
        if code:
            return code
    return 0


if __name__ == "__main__":
    sys.exit(main())
