"""Everything that ``make results`` does: train and measure every row of the results over five seeds, then write the pages.

    python docs/research/results/run_results.py --data FOLDER

``FOLDER`` holds Ev-Objects.zip and Ev-Containers.zip. Every network and its figures are files under ``--work``: what is
there is not made again, and a killed training goes on, so the script takes up where it was stopped. All of it takes many
hours on one core; ``--rows``, ``--datasets`` and ``--seeds`` make a part of it, ``--page-only`` writes the pages from what is
there, and the page says which rows are missing.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from measure_run import make
from result_pictures import draw
from result_rows import DATASETS, ROW_NAMES, ROWS, SEEDS
from results_page import pages, read, write_tables
from tables import read_table

ROOT = Path(__file__).parents[3]


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--data", type=Path, default=ROOT.parent / "shared/data/neutouch")
    parser.add_argument("--work", type=Path, default=ROOT / "runs/results")
    parser.add_argument("--page", type=Path, default=ROOT / "docs/research/results.md")
    parser.add_argument("--rows", nargs="*", default=ROW_NAMES, choices=ROW_NAMES, metavar="NAME")
    parser.add_argument(
        "--datasets", nargs="*", default=tuple(DATASETS), choices=tuple(DATASETS), metavar="NAME"
    )
    parser.add_argument("--seeds", nargs="*", type=int, default=tuple(SEEDS), metavar="N")
    parser.add_argument("--page-only", action="store_true")
    args = parser.parse_args()
    args.work.mkdir(parents=True, exist_ok=True)
    if not args.page_only:
        for seed in args.seeds:
            for row in ROWS:
                for name in args.datasets:
                    if row.name in args.rows and row.only in (None, name):
                        make(args.work, args.data, row, DATASETS[name], seed)
    runs = read(args.work)
    draw(runs, args.page.parent / "images")
    folder = args.page.with_suffix("")
    tables = write_tables(runs, folder)
    texts = pages(tables, read_table(folder / "splits.csv"))
    args.page.write_text(texts["results"], encoding="utf-8")
    (folder / "operations.md").write_text(texts["operations"], encoding="utf-8")


if __name__ == "__main__":
    main()
