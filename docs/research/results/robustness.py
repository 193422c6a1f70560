"""The accuracy on the chip if the sensor is not what it was in training: ``docs/research/results/robustness.csv``."""

from __future__ import annotations

import statistics
from pathlib import Path

import numpy as np
from broken_sensors import Change, changes
from study import SHIPPED, Shipped, Study
from tables import Table

import hw_model as hw


def robustness(study: Study) -> Table:
    """Return the accuracy of the shipped networks for each change of the sensor (``broken_sensors.py``), mean and deviation."""
    rows = []
    for what, change, draws in changes():
        cells = [what]
        for shipped in SHIPPED:

            def measured(
                shipped: Shipped = shipped, change: Change = change, draws: int = draws
            ) -> list[float]:
                test = study.part(shipped.dataset, "test")
                accuracies_of_draws = []
                for draw in range(draws):
                    rng = np.random.Generator(np.random.PCG64([draw, 18]))
                    played = hw.simulate(study.program(shipped), change(test.spikes, rng))
                    accuracies_of_draws.append(float((played.prediction == test.labels).mean()))
                return accuracies_of_draws

            found = study.figures(
                f"robust-{Path(shipped.file).stem}-{what.replace(' ', '-')}", measured
            )
            deviation = f" ± {statistics.stdev(found):.3f}" if len(found) > 1 else ""
            cells.append(f"{statistics.mean(found):.3f}{deviation}")
        rows.append(cells)
    return ["what is wrong", *(shipped.label for shipped in SHIPPED)], rows
