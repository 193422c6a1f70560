"""Train on the chip's integers, five seeds, both data sets, every strategy, and measure what the programs do.

    python tests/benchmarks/target_aware.py --data FOLDER --page docs/research/accuracy/target-aware-training.md

``FOLDER`` holds Ev-Objects.zip and Ev-Containers.zip. Every network and its figures are a file under ``--work``; what is
there is not made again, so the script goes on where it was stopped. With ``--validate`` it tries the settings on
validation recordings instead, with float networks that have not seen these, and prints a line each; with ``--speed`` it
compares an epoch with one in float.
"""

from __future__ import annotations

import argparse
import json
import statistics
import time
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from page_section import put_section

import hw_model as hw
import locsnn_compile as lc
from locsnn_compile.data.read import read_recordings
from locsnn_compile.data.recordings import Recordings
from locsnn_compile.models.checkpoint import Checkpoint
from locsnn_compile.models.checkpoint_reader import read_checkpoint
from locsnn_compile.settings import TRAINABLE
from locsnn_compile.training.config import TrainingConfig, config_from_mapping, read_config
from locsnn_compile.training.describe import FINE_TUNING, fine_tuning_config
from locsnn_compile.training.export import export_checkpoint, training_entry
from locsnn_compile.training.state import load_state, run_key
from locsnn_compile.training.train import train

ROOT = Path(__file__).parents[2]
DATASETS = ("objects", "containers")
SEEDS = range(5)
VALIDATION_SEEDS = range(3)


@dataclass(frozen=True)
class Row:
    """One row of the table: strategy and weight bits, and further options by data set (``own``)."""

    name: str
    strategy: str
    weight_bits: int = 8
    own: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)

    def options(self, dataset: str) -> dict[str, Any]:
        """Return the training options of the row for a data set."""
        same = {"target": "loihi-sim", "strategy": self.strategy, "weight_bits": self.weight_bits}
        return same | dict(self.own.get(dataset, {}))


PRUNED = {
    "objects": {"pruned": 0.33, "epochs": 150, "learning_rate": 0.006},
    "containers": {"pruned": 0.4},
}
ROWS = (
    Row("dendrite-8", "dendrite"),
    Row("delay-line-8", "delay-line"),
    Row("reset-8", "reset"),
    Row("reset-8-pruned", "reset", own=PRUNED),
    Row("dendrite-4", "dendrite", weight_bits=4),
)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--data", type=Path, required=True)
    parser.add_argument("--work", type=Path, default=ROOT / "build" / "target-aware")
    parser.add_argument("--page", type=Path, help="write the table into this page")
    parser.add_argument(
        "--validate", action="store_true", help="try the settings on validation recordings"
    )
    parser.add_argument(
        "--speed", action="store_true", help="compare an epoch with one in float instead"
    )
    parser.add_argument("--rows", nargs="*", default=[row.name for row in ROWS], metavar="NAME")
    args = parser.parse_args()
    torch.set_num_threads(1)
    (args.work / "float").mkdir(parents=True, exist_ok=True)
    (args.work / "tuned").mkdir(exist_ok=True)
    if args.speed:
        compare_epochs(args)
        return
    rows = [row for row in ROWS if row.name in args.rows]
    for row in rows:
        for seed in VALIDATION_SEEDS if args.validate else SEEDS:
            for dataset in DATASETS:
                (validate if args.validate else measure)(args, row, dataset, seed)
    if args.page is not None:
        put_section(args.page, "target-aware", page(args.work))


def float_network(
    args: argparse.Namespace, dataset: str, seed: int, *, seen_all: bool
) -> Checkpoint:
    """Return the float network of a seed: refitted on the whole train part, or (not ``seen_all``) the one before the refit.

    The latter has not seen the validation part, so settings can be compared there.
    """
    path = args.work / "float" / f"{dataset}-{seed}{'' if seen_all else '-select'}.pt"
    if not path.exists():
        train_float(args, dataset, seed)
    return read_checkpoint(path)


def train_float(args: argparse.Namespace, dataset: str, seed: int) -> None:
    """Train a float network and write both of its checkpoints; the one before the refit is taken from the state of the run."""
    folder = args.work / "float"
    config = replace(base_config(dataset), seed=seed)
    recordings, test = parts(args.data, dataset)
    state_path = folder / f"{dataset}-{seed}.state"
    result = train(
        recordings,
        config,
        name=f"{dataset}-hybrid",
        classes=classes_of(recordings, test),
        state_path=state_path,
    )
    state = load_state(state_path, run_key(config, recordings), result.network.state_dict())
    assert state is not None
    selected = {
        name.removesuffix(".weight"): weight.numpy()
        for name, weight in state.chosen_weights.items()
    }
    entry = training_entry(
        result, replace(config, refit=False), recordings, test=None, confused=None
    )
    Checkpoint(result.network.description, selected, training=entry).save(
        folder / f"{dataset}-{seed}-select.pt"
    )
    export_checkpoint(folder / f"{dataset}-{seed}.pt", result, config, recordings, test, carried=0)
    state_path.unlink()


def measure(args: argparse.Namespace, row: Row, dataset: str, seed: int) -> None:
    """Fine-tune on the whole train part, then compile, and play all test recordings to network and program."""
    path = args.work / "tuned" / f"{dataset}-{row.name}-{seed}.pt"
    if path.with_suffix(".json").exists():
        return
    start = float_network(args, dataset, seed, seen_all=True)
    recordings, test = parts(args.data, dataset)
    config = fine_tuning(row, dataset, seed, start)
    before = time.perf_counter()
    result = train(recordings, config, name=f"{dataset}-hybrid-loihi", start=start)
    seconds = time.perf_counter() - before
    export_checkpoint(path, result, config, recordings, test, carried=0, start=start)

    compiled = lc.compile(lc.load(path), target="loihi-sim", events=test, diagnosis=False)
    with torch.no_grad():
        spikes_in_training = result.network(torch.from_numpy(test.spikes.copy()).double())
    played = hw.simulate(compiled.program, test.spikes)
    report = compiled.report
    figures = {
        "dataset": dataset,
        "row": row.name,
        "seed": seed,
        "float_accuracy": start.training["test_accuracy"],
        "accuracy": report["accuracy"]["chip"],
        "mismatches": sum(
            int((played.spikes[name] != spikes.numpy()).sum())
            for name, spikes in spikes_in_training.items()
        ),
        "spikes": sum(int(spikes.sum()) for spikes in spikes_in_training.values()),
        "energy_pj": report["energy"]["per_sample_pj"],
        "synapses": report["resources"]["synapses"],
        "compartments": report["resources"]["compartments"],
        "at_limit": sum(
            int((np.abs(mantissas) == result.network.chip.populations[name].grid.high).sum())
            for name, mantissas in result.network.mantissas().items()
        ),
        "wraps": report["match"]["wraps"],
        "clips": report["match"]["clips"],
        "seconds": round(seconds, 1),
    }
    path.with_suffix(".json").write_text(json.dumps(figures, indent=1) + "\n", encoding="utf-8")
    print(json.dumps(figures), flush=True)


def validate(args: argparse.Namespace, row: Row, dataset: str, seed: int) -> None:
    """Fine-tune a network that has not seen the validation part, and print its accuracy and loss there, last ten epochs."""
    start = float_network(args, dataset, seed, seen_all=False)
    recordings, test = parts(args.data, dataset)
    fraction = base_config(dataset).validation_fraction
    config = replace(
        fine_tuning(row, dataset, seed, start), validation_fraction=fraction, refit=False
    )
    history = train(recordings, config, start=start, classes=classes_of(recordings, test)).history
    last = history[-10:]
    figures = {
        "dataset": dataset,
        "row": row.name,
        "seed": seed,
        "accuracy": statistics.mean(epoch.validation_accuracy or 0.0 for epoch in last),
        "loss": statistics.mean(epoch.validation_loss or 0.0 for epoch in last),
        "float_accuracy": start.training["validation_accuracy"],
    }
    print(json.dumps(figures), flush=True)


def compare_epochs(args: argparse.Namespace, repeats: int = 8) -> None:
    """Print the least processor time of an epoch of Objects on the chip's integers over that of an epoch in float, by strategy.

    A third of the recordings is enough for a ratio.
    """
    start = read_checkpoint(ROOT / "examples/models/objects-hybrid.pt")
    recordings = parts(args.data, "objects")[0]
    recordings = recordings.subset(np.arange(0, len(recordings), 3))
    base = fine_tuning_config(TrainingConfig(epochs=1, validation_fraction=0.0), start.description)
    configs = {"float": base} | {
        strategy: replace(base, target="loihi-sim", strategy=strategy) for strategy in TRAINABLE
    }
    best = dict.fromkeys(configs, float("inf"))
    for _ in range(repeats):
        for name, config in configs.items():
            before = time.process_time()
            train(recordings, config, start=start)
            best[name] = min(best[name], time.process_time() - before)
    print(json.dumps({name: round(seconds / best["float"], 2) for name, seconds in best.items()}))


def fine_tuning(row: Row, dataset: str, seed: int, start: Checkpoint) -> TrainingConfig:
    """Return the training options of a row: those of the configuration that ships, with the row's own over them."""
    base = read_config(ROOT / f"examples/configs/{dataset}-hybrid-loihi.yaml")
    config = config_from_mapping(FINE_TUNING | base | row.options(dataset) | {"seed": seed})
    return fine_tuning_config(config, start.description)


def base_config(dataset: str) -> TrainingConfig:
    """Return the training options of the float network of a data set."""
    return config_from_mapping(read_config(ROOT / f"examples/configs/{dataset}-hybrid.yaml"))


def parts(data: Path, dataset: str) -> tuple[Recordings, Recordings]:
    """Return the train and the test part of a data set."""
    archive = data / f"Ev-{dataset.title()}.zip"
    return read_recordings(archive, split="train"), read_recordings(archive, split="test")


def classes_of(*recordings: Recordings) -> int:
    """Return the number of classes over some recordings; a part of a data set may lack the last ones."""
    return 1 + max(int(part.labels.max()) for part in recordings if part.labels is not None)


def page(work: Path) -> str:
    """Return the table of the section, from the files of figures that are there."""
    all_figures = [
        json.loads(path.read_text(encoding="utf-8"))
        for path in sorted((work / "tuned").glob("*.json"))
    ]
    head = (
        "| network | strategy | bits | accuracy | against float | spike mismatches | energy, µJ | against `dendrite` | compartments | synapses |",
        "| --- | --- | --- | --- | --- | --- | --- | --- | --- | --- |",
    )
    lines = [*head]
    for dataset in DATASETS:
        floats = {f["seed"]: f["float_accuracy"] for f in all_figures if f["dataset"] == dataset}
        if floats:
            lines.append(
                f"| {dataset.title()} | float | 32 | {spread(list(floats.values()))} | | | | | | |"
            )
        dendrite_energies_pj = [
            f["energy_pj"]
            for f in all_figures
            if (f["dataset"], f["row"]) == (dataset, "dendrite-8")
        ]
        for row in ROWS:
            row_figures = [
                f for f in all_figures if (f["dataset"], f["row"]) == (dataset, row.name)
            ]
            if row_figures:
                lines.append(line(dataset, row, row_figures, dendrite_energies_pj))
    return "\n".join(lines)


def line(dataset: str, row: Row, mine: list[dict[str, Any]], whole: list[float]) -> str:
    """Return a line of the table: ``mine``, the figures of its seeds; ``whole``, energies of 8-bit `dendrite` to compare with."""

    def mean(key: str) -> float:
        return statistics.mean(f[key] for f in mine)

    lost = statistics.mean(f["accuracy"] - f["float_accuracy"] for f in mine)
    share = f"{mean('energy_pj') / statistics.mean(whole):.2f}" if whole else ""
    pruned = row.options(dataset).get("pruned", 0.0)
    what = row.strategy + (f", {pruned:.0%} pruned" if pruned else "")
    return (
        f"| {dataset.title()} | {what} | {row.weight_bits} | {spread([f['accuracy'] for f in mine])} | {lost:+.3f} "
        f"| {sum(f['mismatches'] for f in mine)} of {sum(f['spikes'] for f in mine):,} | {mean('energy_pj') / 1e6:.2f} "
        f"| {share} | {mean('compartments'):.0f} | {mean('synapses'):,.0f} |"
    )


def spread(values: list[float]) -> str:
    """Return the mean and the sample standard deviation."""
    deviation = f" ± {statistics.stdev(values):.3f}" if len(values) > 1 else ""
    return f"{statistics.mean(values):.3f}{deviation}"


if __name__ == "__main__":
    main()
