"""What the results page says beyond accuracy: broken sensors, answers before the end, and energy against accuracy.

    python docs/research/results/chip_studies.py --data FOLDER [--only robustness]

Everything is played on the chip's integers with the test part, by the networks that ship and those of ``run_results.py``. Nothing
is chosen here; only networks that hold a validation part back, for margins, are trained. Figures and networks are files under
``--work``, and what is there is not made again. The tables are ``docs/research/results/NAME.csv``.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from early_answers import margins, seen
from energy_front import front
from robustness import robustness
from study import ROOT, SHIPPED, Shipped, Study
from tables import Table, write_table

import hw_model as hw


def keep_predictions(study: Study) -> None:
    """Write files of what the shipped networks predict for the test part; ``paper_pictures.py`` draws confusions from them."""
    for shipped in SHIPPED:

        def predicted(shipped: Shipped = shipped) -> dict[str, Any]:
            test = study.part(shipped.dataset, "test")
            assert test.labels is not None
            played = hw.simulate(study.program(shipped), test.spikes).prediction
            return {
                "classes": 1 + int(test.labels.max()),
                "labels": test.labels.tolist(),
                "predictions": np.asarray(played).tolist(),
            }

        study.figures(f"predicted-{Path(shipped.file).stem}", predicted)


# What makes the table of each name.
TABLES: Mapping[str, Callable[[Study], Table]] = {
    "robustness": robustness,
    "time-seen": seen,
    "margins": margins,
    "front": front,
}


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--data", type=Path, default=ROOT.parent / "shared/data/neutouch")
    parser.add_argument("--work", type=Path, default=ROOT / "runs/results")
    parser.add_argument("--tables", type=Path, default=ROOT / "docs/research/results")
    parser.add_argument("--only", nargs="*", choices=tuple(TABLES), default=tuple(TABLES))
    args = parser.parse_args(arguments)
    args.work.mkdir(parents=True, exist_ok=True)
    study = Study(args.data, args.work, args.tables)
    keep_predictions(study)
    for name in args.only:
        write_table(args.tables / f"{name}.csv", TABLES[name](study))


if __name__ == "__main__":
    main()
