"""Answers while the touch lasts: ``docs/research/results/time-seen.csv`` and ``docs/research/results/margins.csv``."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from measure_run import CONFIGS, train_network
from result_rows import SEEDS
from study import SHIPPED, Shipped, Study
from tables import Table, spread

import hw_model as hw
import locsnn_compile as lc
from locsnn_compile.data.read import stratified_split
from locsnn_compile.data.recordings import Recordings
from locsnn_compile.training.config import config_from_mapping, read_config

EARLY = tuple(
    Shipped(
        "objects",
        f"Objects, Window-SNN, up to {share} cut in training",
        f"objects-window-{name}-{seed}.pt",
    )
    for name, share in (("early", "half"), ("quarter", "three quarters"))
    for seed in SEEDS
)
"""Networks of ``--work`` that learned to answer early."""

SEEN = (0.25, 0.5, 0.75, 1.0)


def seen(study: Study) -> Table:
    """The accuracy on the chip after shares of a recording, and where it is proven that nothing can change."""
    found: dict[str, list[dict[str, Any]]] = {}
    for shipped in (*SHIPPED, *(early for early in EARLY if (study.work / early.file).exists())):

        def measured(shipped: Shipped = shipped) -> dict[str, Any]:
            program, test = study.program(shipped), study.part(shipped.dataset, "test")
            scores = hw.timestep_scores(program, test.spikes)
            right = [
                float(
                    (
                        scores[:, int(share * scores.shape[1]) - 1].argmax(axis=1) == test.labels
                    ).mean()
                )
                for share in SEEN
            ]
            return {"right": right} | of_stops(
                program, hw.stop_when_proven(program, test.spikes), test
            )

        found.setdefault(shipped.label, []).append(
            study.figures(f"seen-{Path(shipped.file).stem}", measured)
        )
    rows = []
    for label, each in found.items():
        shares = [
            spread(column) if len(column) > 1 else f"{column[0]:.3f}"
            for column in zip(*(f["right"] for f in each), strict=True)
        ]
        rows.append([label, *shares, *saved(each[0])])
    heads = [f"after {share:.0%} of the steps" for share in SEEN[:-1]]
    return [
        "network",
        *heads,
        "at the end",
        *(f"stopped when proven: {what}" for what in SAVED),
    ], rows


SAVED = ("steps", "of", "energy, µJ", "of, µJ")


def of_stops(program: hw.ChipProgram, stops: hw.Stops, test: Recordings) -> dict[str, float]:
    """Return means of a recording until it stops, and of a whole one."""
    profile, batch = program.chip.profile(program.chip.default_profile), len(stops.steps)
    spent, whole = (
        sum(hw.energy_pj(counts, profile).values()) / batch
        for counts in (stops.counts, stops.all_counts)
    )
    return {
        "steps": float(stops.steps.mean()),
        "all_steps": float(stops.all_steps),
        "pj": spent,
        "all_pj": whole,
        "stopped_right": float((stops.prediction == test.labels).mean()),
        "final_right": float((stops.final == test.labels).mean()),
        "same": float((stops.prediction == stops.final).mean()),
    }


def saved(found: Mapping[str, float]) -> list[str]:
    energy = [f"{found[key] / 1e6:.2f}" for key in ("pj", "all_pj")]
    return [f"{found['steps']:.0f}", f"{found['all_steps']:.0f}", *energy]


KEPT = 0.99
"""Share of the final accuracy that a margin keeps on validation recordings."""


def margin_of(scores: np.ndarray[Any, Any], labels: np.ndarray[Any, Any]) -> float:
    """Return the smallest lead at which stops keep ``KEPT`` of the accuracy at the end; scores (batch, steps, classes)."""
    first, second = (np.sort(scores, axis=2)[..., place] for place in (-1, -2))
    lead, right = first - second, scores.argmax(axis=2) == labels[:, None]
    wanted = KEPT * right[:, -1].mean()
    for margin in np.unique(np.quantile(lead[lead > 0], np.linspace(0, 1, 200))):
        enough = lead >= margin
        enough[:, -1] = True
        if right[np.arange(len(right)), enough.argmax(axis=1)].mean() >= wanted:
            return float(margin)
    return float("inf")


@dataclass(frozen=True)
class Held:
    """A network of seed 0 that does not learn from its validation part: what it is called, and how it is trained."""

    dataset: str
    label: str
    file: str
    config: str
    fraction: float


HELD = (
    Held(
        "containers",
        "Containers, Window-SNN, levels",
        "held-containers-window-snn.pt",
        "containers-window-snn-levels",
        0.1667,
    ),
    Held(
        "objects", "Objects, Window-SNN", "held-objects-window-snn.pt", "objects-window-snn", 0.125
    ),
    Held(
        "objects",
        "Objects, Window-SNN, ends cut",
        "held-objects-window-early.pt",
        "objects-window-snn-early",
        0.125,
    ),
)


def margins(study: Study) -> Table:
    """Answers by margin: found on the validation part of networks that did not learn from it, played on the test part."""
    rows = []
    for held in HELD:
        found = study.figures(Path(held.file).stem, lambda held=held: at_margin(study, held))
        accuracies = [f"{found[key]:.3f}" for key in ("stopped_right", "final_right", "same")]
        rows.append([held.label, str(found["held"]), *accuracies, *saved(found)])
    head = [
        "network",
        "validation recordings",
        "accuracy at the stop",
        "accuracy at the end",
        "same prediction",
    ]
    return [*head, *SAVED], rows


def at_margin(study: Study, held: Held) -> dict[str, Any]:
    """Train a network unless it is there, find its margin, and stop the test part by it."""
    recordings, test, path = (
        study.part(held.dataset, "train"),
        study.part(held.dataset, "test"),
        study.work / held.file,
    )
    if not path.exists():
        values = read_config(CONFIGS / f"{held.config}.yaml")
        own = {"seed": 0, "refit": False, "validation_fraction": held.fraction}
        train_network(path, config_from_mapping(values | own), recordings, None)
    learned, kept_back = stratified_split(recordings.labels, held.fraction, 0)
    events = recordings.subset(learned[:16])
    program = lc.compile(lc.load(path), events=events, diagnosis=False).program
    margin = margin_of(
        hw.timestep_scores(program, recordings.spikes[kept_back]), recordings.labels[kept_back]
    )
    found = of_stops(program, hw.stop_at_margin(program, test.spikes, margin), test)
    return found | {"margin": margin, "held": len(kept_back)}
