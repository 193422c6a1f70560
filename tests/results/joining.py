"""A hybrid and windows, joined as `objects-best.pt` is and laid out by a strategy: the ways with ``parts`` of ``tried_settings.yaml``.

What is measured are the scores of the chip's program. The networks that are joined stay as files, so that strategies are compared
on the same ones.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from join_branches import joined
from ways import Division, Floats, Joined, Rows, Scorer, Setting

import hw_model as hw
import locsnn_compile as lc
from hw_model.values import ByteArray
from locsnn_compile.models.checkpoint import Checkpoint
from locsnn_compile.models.checkpoint_reader import read_checkpoint

HEARD = 16
"""Recordings that the compiler hears."""


def joined_on_chip(way: Joined, of: Division, rows: Rows) -> Scorer:
    """Train both networks on ``rows``, unless they are there, and return the scores of their program."""
    hybrid, windows = (part_of(name, of, rows) for name in way.parts)
    events = of.recordings.subset(rows[:HEARD])
    network = joined(hybrid, windows, "joined")
    program = lc.compile(network, strategy=way.strategy, events=events, diagnosis=False).program

    def score(spikes: ByteArray) -> Floats:
        return np.asarray(hw.simulate(program, spikes).scores, dtype=np.float64)

    return score


def part_of(name: str, of: Division, rows: Rows) -> Checkpoint:
    """Return a network that learned from ``rows``, whole folds of a division."""
    learned = "-".join(map(str, sorted({int(of.fold[row]) for row in rows})))
    path = Path(of.work) / f"{of.dataset}-{name}-{of.repeat}-of-{learned}.pt"
    if not path.exists():
        setting = of.known[name]
        assert isinstance(setting, Setting)
        config, network = setting.trained(of, rows)
        said = {"seed": config.seed, "dataset": of.dataset, "count_scale": config.count_scale}
        Checkpoint(network.description, dict(network.weights()), training=said).save(path)
        print(f"{path.stem}: trained", flush=True)
    return read_checkpoint(path)
