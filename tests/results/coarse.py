"""Windows whose weights have few bits on the chip: the ways with ``bits`` of ``tried_settings.yaml``.

The weights are rounded after training, or trained on the chip's integers from the start (``locsnn train --target``), with their
range ``room`` times the usual one. What is measured are the scores of the program.
"""

from __future__ import annotations

from dataclasses import replace
from tempfile import TemporaryDirectory

import numpy as np
from ways import Coarse, Division, Floats, Rows, Scorer, Setting

import hw_model as hw
import locsnn_compile as lc
from hw_model.values import ByteArray
from locsnn_compile.models.checkpoint import Checkpoint

HEARD = 16
"""Recordings that the compiler hears."""


def coarse(way: Coarse, of: Division, rows: Rows) -> Scorer:
    """Train on ``rows``, and return the scores of the chip's program, in its integers: they tell classes apart, no more."""
    setting = of.known[way.setting]
    assert isinstance(setting, Setting)
    on_chip = {"target": "loihi-sim", "weight_bits": way.bits, "weight_room": way.room} if way.in_training else {}
    _, network = replace(setting, options=dict(setting.options) | on_chip).trained(of, rows)
    with TemporaryDirectory() as folder:
        path = f"{folder}/windows.pt"
        weights = network.mantissas() if network.chip else network.weights()
        Checkpoint(network.description, dict(weights), training={}, chip=network.chip).save(path)
        events = of.recordings.subset(rows[:HEARD])
        program = lc.compile(lc.load(path), weight_bits=way.bits, events=events, diagnosis=False).program

    def score(spikes: ByteArray) -> Floats:
        return np.asarray(hw.simulate(program, spikes).scores, dtype=np.float64)

    return score
