"""Networks that learned from folds of the train part, as files: what is there is not trained again."""

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

HEARD = 16
"""Recordings that the compiler hears."""


def learned(name: str, of: Division, rows: Rows, suffix: str = "", **options: Any) -> Checkpoint:
    """Return a setting's network that learned from ``rows``, whole folds; ``options`` over its own make another, ``suffix``."""
    folds = "-".join(map(str, sorted({int(of.fold[row]) for row in rows})))
    path = of.work / f"{of.dataset}-{name}{suffix}-{of.repeat}-of-{folds}.pt"
    if not path.exists():
        setting = of.known[name]
        assert isinstance(setting, Setting)
        config, network = replace(setting, options=dict(setting.options) | options).trained(
            of, rows
        )
        said = {"seed": config.seed, "dataset": of.dataset, "count_scale": config.count_scale}
        weights = network.mantissas() if network.chip else network.weights()
        Checkpoint(network.description, dict(weights), training=said, chip=network.chip).save(path)
        print(f"{path.stem}: trained", flush=True)
    return read_checkpoint(path)


def on_chip(network: Checkpoint, of: Division, rows: Rows, **options: Any) -> Scorer:
    """Return the scores of a network's program, in its integers: they tell classes apart, no more."""
    program = lc.compile(
        network, events=of.recordings.subset(rows[:HEARD]), diagnosis=False, **options
    ).program

    def score(spikes: ByteArray) -> Floats:
        return np.asarray(hw.simulate(program, spikes).scores, dtype=np.float64)

    return score
