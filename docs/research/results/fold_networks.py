"""Networks that learned from folds of the train part. They are files: a network that is there is not trained again."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from ways import Division, Floats, Rows, Scorer, Setting

import hw_model as hw
import locsnn_compile as lc
from hw_model.values import ByteArray
from locsnn_compile.models.checkpoint import Checkpoint
from locsnn_compile.models.checkpoint_reader import read_checkpoint

CALIBRATION_RECORDINGS = 16
"""Recordings for which the compiler rounds weights."""


def learned(
    name: str, division: Division, rows: Rows, suffix: str = "", **options: Any
) -> Checkpoint:
    """Return the network of a setting that learned from ``rows``, which are whole folds.

    ``options`` replace those of the setting; ``suffix`` then tells the file of this network from the setting's own.
    """
    folds = "-".join(map(str, sorted({int(division.fold[row]) for row in rows})))
    path = division.work / f"{division.dataset}-{name}{suffix}-{division.repeat}-of-{folds}.pt"
    if not path.exists():
        setting = division.way_of_name[name]
        assert isinstance(setting, Setting)
        config, network = replace(setting, options=dict(setting.options) | options).trained(
            division, rows
        )
        training_entry = {
            "seed": config.seed,
            "dataset": division.dataset,
            "count_scale": config.count_scale,
        }
        weights = network.mantissas() if network.chip else network.weights()
        Checkpoint(
            network.description, dict(weights), training=training_entry, chip=network.chip
        ).save(path)
        print(f"{path.stem}: trained", flush=True)
    return read_checkpoint(path)


def on_chip(network: Checkpoint, division: Division, rows: Rows, **options: Any) -> Scorer:
    """Return a scorer of a network's program. Its scores are the chip's integers, so only their order means something."""
    program = lc.compile(
        network,
        events=division.recordings.subset(rows[:CALIBRATION_RECORDINGS]),
        diagnosis=False,
        **options,
    ).program

    def score(spikes: ByteArray) -> Floats:
        return np.asarray(hw.simulate(program, spikes).scores, dtype=np.float64)

    return score
