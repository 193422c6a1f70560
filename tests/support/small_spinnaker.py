"""Small networks of SpiNNaker, by default one neuron behind one input line, for results that tests work out by hand."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from hw_model.arithmetic.spinnaker import ONE, Parameters
from hw_model.mapping.graph import Input, Phase
from hw_model.spinnaker.network import (
    SpinnakerNetwork,
    SpinnakerPopulation,
    SpinnakerProjection,
)


def parameters(size: int = 1, **changes: float) -> Parameters:
    """Return the stored parameters of equal neurons, given in the units of PyNN: ms, nF, mV and nA."""
    usual = {
        "tau_m": 10.0,
        "c_m": 1.0,
        "tau_syn": 5.0,
        "v_rest": 0.0,
        "v_reset": 0.0,
        "v_thresh": 15.0,
        "v_init": 0.0,
        "i_offset": 0.0,
        "tau_refrac": 0.0,
    }
    stored = {name: round(value * ONE) for name, value in {**usual, **changes}.items()}
    arrays = {name: np.full(size, value, dtype=np.int64) for name, value in stored.items()}
    arrays["tau_syn"] = np.full((size, 2), stored["tau_syn"], dtype=np.int64)
    return Parameters(**arrays)


def population(name: str = "cells", size: int = 1, **changes: object) -> SpinnakerPopulation:
    """Return neurons on one core, whose delays have eight slots."""
    usual = {
        "name": name,
        "phase": "run",
        "parameters": parameters(size),
        "shifts": (0, 0),
        "slots": 8,
        "neurons_per_core": 128,
    }
    return SpinnakerPopulation(**{**usual, **changes})


class Synapse(NamedTuple):
    """A synapse from a source, by its index, to a neuron; ``weight`` is the stored integer, ``delay`` is in steps."""

    source: int
    target: int
    weight: int
    delay: int


def projection(*synapses: Synapse, **changes: object) -> SpinnakerProjection:
    """Return a projection of excitatory synapses from the input line to the cells, unless other ends are given."""
    source, target, weight, delay = np.array(synapses, dtype=np.int64).reshape(-1, 4).T
    usual = {
        "source": "lines",
        "target": "cells",
        "receptor": "excitatory",
        "source_index": source,
        "target_index": target,
        "weight": weight,
        "delay": delay,
    }
    return SpinnakerProjection(**{**usual, **changes})


def network(**changes: object) -> SpinnakerNetwork:
    """Return one neuron behind one line."""
    usual = {
        "phases": (Phase("run", "time", steps=None),),
        "inputs": (Input("lines", size=1, phase="run", stream="touches"),),
        "populations": (population(),),
        "projections": (projection(Synapse(source=0, target=0, weight=1000, delay=1)),),
    }
    return SpinnakerNetwork(**{**usual, **changes})
