"""Train one network of the results, and measure what the page needs of it.

A run leaves a checkpoint (.pt), a log of its epochs (.csv) and a file of figures (.json). Training that was killed goes on from
its .state file.
"""

from __future__ import annotations

import json
import time
from pathlib import Path
from typing import Any

import numpy as np
from join_branches import write
from result_rows import Dataset, Row, command
from slip_recordings import slip_recordings

import hw_model as hw
import locsnn_compile as lc
from locsnn_compile.baselines.operations import additions_of_recordings
from locsnn_compile.data.read import read_recordings
from locsnn_compile.data.recordings import Recordings
from locsnn_compile.models.checkpoint import Checkpoint
from locsnn_compile.models.checkpoint_reader import read_checkpoint
from locsnn_compile.network.neurons import SrmAlpha
from locsnn_compile.training.config import TrainingConfig, config_from_mapping, read_config
from locsnn_compile.training.export import export_checkpoint
from locsnn_compile.training.train import train
from locsnn_compile.verification.observation import Observed
from locsnn_compile.verification.over_time import OverTime, over_time

CONFIGS = Path(__file__).parents[3] / "examples/configs"


def parts(data: Path, dataset: Dataset) -> tuple[Recordings, Recordings]:
    """Return the train and the test part of a data set; those without an archive are synthetic."""
    if dataset.archive is None:
        return slip_recordings()
    archive = data / dataset.archive
    return read_recordings(archive, split="train"), read_recordings(archive, split="test")


def config_of(row: Row, dataset: Dataset, seed: int) -> TrainingConfig:
    """Return the training options of the row's command."""
    values = read_config(CONFIGS / row.config_for(dataset))
    return config_from_mapping(values | dict(row.options) | {"seed": seed})


def make(work: Path, data: Path, row: Row, dataset: Dataset, seed: int) -> None:
    """Train unless there is a checkpoint, and measure unless there are figures."""
    name = f"{dataset.name}-{row.name}-{seed}"
    path, figures = work / f"{name}.pt", work / f"{name}.json"
    if figures.exists():
        return
    recordings, test = parts(data, dataset)
    if not path.exists() and row.parts:
        _join(path, row, dataset, seed, recordings, test)
    elif not path.exists():
        train_network(path, config_of(row, dataset, seed), recordings, test)
    run_figures = measure(path, row, dataset, test) | {"command": command(row, dataset, seed)}
    figures.write_text(json.dumps(run_figures) + "\n", encoding="utf-8")


def train_network(
    path: Path,
    config: TrainingConfig,
    recordings: Recordings,
    test: Recordings | None,
    start: Checkpoint | None = None,
) -> None:
    """Train a network, from ``start`` on if it is given; ``test`` None leaves its test part unread."""
    state = path.with_suffix(".state")
    assert recordings.labels is not None
    before = time.process_time()
    log = path.with_suffix(".csv")
    result = train(recordings, config, name=path.stem, start=start, state_path=state, log_path=log)
    export_checkpoint(path, result, config, recordings, test, carried=0, start=start)
    state.unlink()
    print(f"{path.stem}: trained in {time.process_time() - before:.0f} s", flush=True)


def _join(
    path: Path, row: Row, dataset: Dataset, seed: int, recordings: Recordings, test: Recordings
) -> None:
    """Train the networks that a row joins on the whole train part, join them, and measure the joined network.

    The parts themselves never play the test part.
    """
    networks = []
    for part in row.parts:
        part_file = path.with_name(f"{dataset.name}-{part}-whole-{seed}.pt")
        if not part_file.exists():
            train_network(part_file, part_config(part, dataset, seed), recordings, test=None)
        networks.append(read_checkpoint(part_file))
    hybrid, *windows = networks
    if row.further is not None:
        further_file = path.with_name(f"{dataset.name}-{row.further}-whole-{seed}.pt")
        if not further_file.exists():
            train_network(
                further_file,
                part_config(row.further, dataset, seed),
                recordings,
                test=None,
                start=hybrid,
            )
        hybrid = read_checkpoint(further_file)
    write(path, hybrid, windows, test)


def part_config(part: str, dataset: Dataset, seed: int) -> TrainingConfig:
    """Return the training options of a part of a joined network: nothing is held out, so no epoch is chosen."""
    overrides = {"seed": seed, "validation_fraction": 0.0, "refit": False}
    return config_from_mapping(read_config(CONFIGS / f"{dataset.name}-{part}.yaml") | overrides)


def measure(path: Path, row: Row, dataset: Dataset, test: Recordings) -> dict[str, Any]:
    """Return the figures of a checkpoint on the test part."""
    checkpoint = read_checkpoint(path)
    training = checkpoint.training
    run_figures: dict[str, Any] = {
        "epochs": training.get("epochs")
        or f"{training['hybrid_epochs']} and {training['windows_epochs']}",
        "chosen_epoch": training.get("chosen_epoch", "all"),
        "validation_accuracy": training.get("validation_accuracy"),
        "test_accuracy": training["test_accuracy"],
        "test_recordings": len(test),
        "steps": test.spikes.shape[1],
        "fingertips": checkpoint.description.input.sensor.surfaces,
        "classes": checkpoint.description.classes,
    }
    return (
        run_figures | _on_chip(path, row, dataset, test)
        if checkpoint.description.structure.spiking
        else run_figures
    )


def _on_chip(path: Path, row: Row, dataset: Dataset, test: Recordings) -> dict[str, Any]:
    """Compile a spiking network as ``locsnn-compile --strategy STRATEGY`` does, and play the test part.

    Networks without spike response neurons have no strategies, and are compiled with ``auto``.
    """
    assert test.labels is not None
    network = lc.load(path)
    strategy = (
        row.strategy if any(isinstance(p.neuron, SrmAlpha) for p in network.populations) else "auto"
    )
    compiled = lc.compile(
        network, target="loihi-sim", strategy=strategy, events=test, diagnosis=False
    )
    played = hw.simulate(compiled.program, test.spikes)
    spikes_of_source = {view.name: view.play(test.spikes) for view in network.views} | dict(
        played.spikes
    )
    accuracy_over_time = over_time(Observed(compiled.levels, test.spikes, test.labels), dataset.psi)
    events = test.spikes.sum(axis=(1, 2), dtype=np.int64)
    report = compiled.report
    return {
        "chip_accuracy": report["accuracy"]["chip"],
        "reference_accuracy": report["accuracy"]["reference"],
        "spike_agreement": report["match"]["spike_agreement"],
        "prediction_agreement": report["match"]["prediction_agreement"],
        "additions": {
            axis: additions.tolist()
            for axis, additions in additions_of_recordings(network, spikes_of_source).items()
        },
        "transposed": events.tolist()
        if any(phase.axis == "location" for phase in network.phases)
        else [],
        "chip": report["operations"]["per_sample"],
        "synaptic_ops": [counts["synaptic_ops"] for counts in played.per_recording],
        "energy_pj": report["energy"]["per_sample_pj"],
        "energy_of_branches_pj": _of_branches(report["energy"]["by_population_pj"]),
        "cores": report["resources"]["cores"],
        "predictions": np.asarray(played.prediction).tolist(),
        "labels": test.labels.tolist(),
        "psi": dataset.psi,
        "right": {name: share.tolist() for name, share in accuracy_over_time.right.items()}
        if isinstance(accuracy_over_time, OverTime)
        else {},
    }


def _of_branches(populations: dict[str, dict[str, float]]) -> dict[str, float]:
    """Return the energy of each branch; a population's name, ``BRANCH_LAYER``, says which branch it belongs to."""
    pj_of_branch: dict[str, float] = {}
    for name, entry in populations.items():
        branch = name.partition("_")[0]
        pj_of_branch[branch] = pj_of_branch.get(branch, 0.0) + entry["pj"]
    return pj_of_branch
