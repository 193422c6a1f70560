"""Which strategy `auto` chooses for networks with the published structures, next to all others: what-auto-takes.csv.

    python docs/research/accuracy/what_auto_takes.py --data FOLDER --networks FOLDER

The folder of ``--data`` holds Ev-Objects.zip and Ev-Containers.zip. Networks that are missing in the folder of
``--networks`` are trained there with seed 0 and the configurations of examples/configs, for a fifth of the published
epochs.
"""

from __future__ import annotations

import argparse
import csv
import subprocess
import sys
from pathlib import Path

import locsnn_compile as lc
from locsnn_compile.settings import STRATEGIES

HERE = Path(__file__).parent
CONFIGS = HERE.parents[2] / "examples/configs"
EPOCHS = 100
"""Of 500 published ones."""
SETS = {"objects": "Ev-Objects.zip", "containers": "Ev-Containers.zip"}
NETWORKS = {
    "tactile-snn": "tactile-snn-published.yaml",
    "location-tactile-snn": "location-tactile-snn-published.yaml",
    "hybrid": "{}-hybrid-published.yaml",
}
COLUMNS = (
    "network",
    "recordings",
    "strategy",
    "spikes_kept",
    "same_predictions",
    "energy_uj",
    "taken",
)


def trained(name: str, of_set: str, data: Path, networks: Path) -> Path:
    """Return the file of a network for a data set; train it if it is not there."""
    path = networks / f"{name}-{of_set}.pt"
    if not path.exists():
        config = CONFIGS / NETWORKS[name].format(of_set)
        command = [sys.executable, "-m", "locsnn_compile", "train", "--quiet"]
        options = ["--data", str(data / SETS[of_set]), "--config", str(config), "--seed", "0"]
        subprocess.run([*command, *options, "--epochs", str(EPOCHS), "-o", str(path)], check=True)
    return path


def row(path: Path, archive: Path, strategy: str) -> dict[str, object] | None:
    """Return the spikes and predictions that a strategy keeps on the test recordings, and its energy.

    None if the chip cannot hold the network in this way. Weights are rounded for the train part of the same archive.
    """
    network = lc.load(path)
    recordings = str(archive)
    try:
        compiled = lc.compile(
            network, strategy=strategy, events=recordings, calibration=recordings, diagnosis=False
        )
    except lc.TargetError:
        return None
    report = compiled.report
    return {
        "strategy": report["strategy"],
        "spikes_kept": f"{report['match']['spike_agreement']:.3f}",
        "same_predictions": f"{report['match']['prediction_agreement']:.3f}",
        "energy_uj": f"{report['energy']['per_sample_pj'] / 1e6:.2f}",
    }


def rows_of(name: str, of_set: str, data: Path, networks: Path) -> list[dict[str, object]]:
    """Return a row for every strategy with which the chip can hold the network; ``taken`` marks the choice of auto."""
    path = trained(name, of_set, data, networks)
    archive = data / SETS[of_set]
    by_auto = row(path, archive, "auto")
    assert by_auto is not None
    rows = []
    for strategy in STRATEGIES:
        measured = row(path, archive, strategy)
        if measured is not None:
            mark = "yes" if measured["strategy"] == by_auto["strategy"] else ""
            rows.append({"network": name, "recordings": of_set, **measured, "taken": mark})
    return rows


def main() -> None:
    """Measure, and write the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--data", type=Path, required=True)
    parser.add_argument("--networks", type=Path, required=True)
    args = parser.parse_args()
    args.networks.mkdir(parents=True, exist_ok=True)
    with (HERE / "what-auto-takes.csv").open("w", newline="") as file:
        writer = csv.DictWriter(file, COLUMNS, lineterminator="\n")
        writer.writeheader()
        for of_set in SETS:
            for name in NETWORKS:
                writer.writerows(rows_of(name, of_set, args.data, args.networks))
                file.flush()


if __name__ == "__main__":
    main()
