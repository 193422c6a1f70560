"""Answers while the touch lasts: ``docs/research/results/time-seen.csv`` and ``docs/research/results/margins.csv``.

The first table has the accuracy after shares of each recording, and what stopping saves once the class can no longer change. The
second stops at a *margin*: as soon as the score of the best class leads by enough.
"""

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
"""Shares of the steps after which the prediction is measured."""


def seen(study: Study) -> Table:
    """Return the accuracy on the chip after shares of a recording, and what stops save once the class is proven."""
    figures_of_label: dict[str, list[dict[str, Any]]] = {}
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

        figures_of_label.setdefault(shipped.label, []).append(
            study.figures(f"seen-{Path(shipped.file).stem}", measured)
        )
    rows = []
    for label, figures_of_seeds in figures_of_label.items():
        shares = [
            spread(column) if len(column) > 1 else f"{column[0]:.3f}"
            for column in zip(*(f["right"] for f in figures_of_seeds), strict=True)
        ]
        rows.append([label, *shares, *saved(figures_of_seeds[0])])
    heads = [f"after {share:.0%} of the steps" for share in SEEN[:-1]]
    return [
        "network",
        *heads,
        "at the end",
        *(f"stopped when proven: {what}" for what in SAVED),
    ], rows


SAVED = ("steps", "of", "energy, µJ", "of, µJ")


def of_stops(program: hw.ChipProgram, stops: hw.Stops, test: Recordings) -> dict[str, float]:
    """Return mean steps and picojoules of recordings until they stop and as a whole, and accuracies at the stop and the end."""
    profile, batch = program.chip.profile(program.chip.default_profile), len(stops.steps)
    pj_until_stop, pj_of_recording = (
        sum(hw.energy_pj(counts, profile).values()) / batch
        for counts in (stops.counts, stops.all_counts)
    )
    return {
        "steps": float(stops.steps.mean()),
        "all_steps": float(stops.all_steps),
        "pj": pj_until_stop,
        "all_pj": pj_of_recording,
        "stopped_right": float((stops.prediction == test.labels).mean()),
        "final_right": float((stops.final == test.labels).mean()),
        "same": float((stops.prediction == stops.final).mean()),
    }


def saved(figures: Mapping[str, float]) -> list[str]:
    """Return the cells of :data:`SAVED`: steps and energy until the stop, and of the whole recording."""
    energy = [f"{figures[key] / 1e6:.2f}" for key in ("pj", "all_pj")]
    return [f"{figures['steps']:.0f}", f"{figures['all_steps']:.0f}", *energy]


KEPT = 0.99
"""Share of the final accuracy that a margin keeps on validation recordings."""


def margin_of(scores: np.ndarray[Any, Any], labels: np.ndarray[Any, Any]) -> float:
    """Return the smallest lead at which stops keep ``KEPT`` of the accuracy at the end; scores (batch, steps, classes).

    200 quantiles of all positive leads are tried, from the smallest on. The last step always stops a recording.
    """
    best, second_best = (np.sort(scores, axis=2)[..., place] for place in (-1, -2))
    lead, right = best - second_best, scores.argmax(axis=2) == labels[:, None]
    accuracy_to_keep = KEPT * right[:, -1].mean()
    for margin in np.unique(np.quantile(lead[lead > 0], np.linspace(0, 1, 200))):
        stops_here = lead >= margin
        stops_here[:, -1] = True
        if right[np.arange(len(right)), stops_here.argmax(axis=1)].mean() >= accuracy_to_keep:
            return float(margin)
    return float("inf")


@dataclass(frozen=True)
class Held:
    """A network of seed 0 that does not learn from its validation part: its label and file, and how it is trained.

    ``fraction``: the share of the train part that is held back.
    """

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
    """Return the table of stops at a margin, which is chosen on a network's validation part and played on the test part."""
    rows = []
    for held in HELD:
        figures = study.figures(Path(held.file).stem, lambda held=held: at_margin(study, held))
        accuracies = [f"{figures[key]:.3f}" for key in ("stopped_right", "final_right", "same")]
        rows.append([held.label, str(figures["held"]), *accuracies, *saved(figures)])
    head = [
        "network",
        "validation recordings",
        "accuracy at the stop",
        "accuracy at the end",
        "same prediction",
    ]
    return [*head, *SAVED], rows


def at_margin(study: Study, held: Held) -> dict[str, Any]:
    """Train a network unless it is there, choose its margin on the validation part, and stop the test part at it."""
    recordings, test, path = (
        study.part(held.dataset, "train"),
        study.part(held.dataset, "test"),
        study.work / held.file,
    )
    if not path.exists():
        values = read_config(CONFIGS / f"{held.config}.yaml")
        overrides = {"seed": 0, "refit": False, "validation_fraction": held.fraction}
        train_network(path, config_from_mapping(values | overrides), recordings, test=None)
    learned_rows, held_rows = stratified_split(recordings.labels, held.fraction, 0)
    events = recordings.subset(learned_rows[:16])
    program = lc.compile(lc.load(path), events=events, diagnosis=False).program
    margin = margin_of(
        hw.timestep_scores(program, recordings.spikes[held_rows]), recordings.labels[held_rows]
    )
    figures = of_stops(program, hw.stop_at_margin(program, test.spikes, margin), test)
    return figures | {"margin": margin, "held": len(held_rows)}
