"""Small graphs of single compartments, for tests of the lowering from such graphs to networks of SpiNNaker."""

from __future__ import annotations

import numpy as np

from hw_model.mapping.graph import CompartmentGraph, Compartments, Input, Phase, Synapses

LAST = (1 << 23) - 1
"""The largest voltage of 23 bits: these compartments have no other limits."""


def cells(size: int = 1, **changes: object) -> Compartments:
    """Return leaky compartments of phase ``time``.

    Their decays, 379 and 401 in 4096ths, are those that the fit of decays gives for two time constants of 10 steps.
    """
    usual = {
        "name": "cells",
        "phase": "time",
        "size": size,
        "decay_u": 379,
        "decay_v": 401,
        "threshold": 600,
        "bias_mantissa": 0,
        "bias_exponent": 0,
        "refractory": 1,
        "vmin": -LAST,
        "vmax": LAST,
    }
    return Compartments(**{**usual, **changes})


def synapses(weights: object, **changes: object) -> Synapses:
    """Return a synapse for each weight of a matrix (targets, sources) that is not 0, ordered by source, then target."""
    target, source = np.nonzero(np.asarray(weights))
    order = np.lexsort((target, source))
    usual = {
        "source": "lines",
        "target": "cells",
        "source_index": source[order],
        "target_index": target[order],
        "mantissa": np.asarray(weights)[target, source][order],
        "delay": np.zeros(len(order), dtype=np.int64),
        "exponent": 0,
        "weight_bits": 8,
        "sign_mode": "mixed",
    }
    return Synapses(**{**usual, **changes})


def graph(*parts: Synapses, lines: int = 1, **changes: object) -> CompartmentGraph:
    """Return a graph of ``lines`` input lines and one group ``cells``, with these synapses or one of weight 100."""
    usual = {
        "name": "small",
        "phases": (Phase("time", "time", steps=None),),
        "inputs": (Input(name="lines", size=lines, phase="time", stream="touch"),),
        "groups": (cells(),),
        "synapses": parts or (synapses([[100]]),),
    }
    return CompartmentGraph(**{**usual, **changes})
