"""A network that both sides can be given: as a program of ours, and as a job file for the driver of a peer."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

import hw_model as hw

PROBES = ("spikes", "u", "v")


@dataclass(frozen=True, eq=False)
class Population:
    """Compartments: every parameter is an array (size,), except for the voltage limits, which are one value for all."""

    name: str
    size: int
    decay_u: NDArray[np.int64]
    decay_v: NDArray[np.int64]
    threshold: NDArray[np.int64]
    bias: NDArray[np.int64]
    refractory: NDArray[np.int64]
    vmin: int
    vmax: int


@dataclass(frozen=True, eq=False)
class Projection:
    """Synapses of one format: weight mantissas and delays are (n_target, n_source), and a zero is no synapse."""

    source: str
    target: str
    weights: NDArray[np.int64]
    delay: NDArray[np.int64]
    exponent: int
    weight_bits: int
    sign_mode: str


@dataclass(frozen=True, eq=False)
class Network:
    """The input population is called ``x``; its spikes are (steps, n), and row t acts at step t + 1."""

    name: str
    spikes: NDArray[np.uint8]
    populations: tuple[Population, ...]
    projections: tuple[Projection, ...]

    def job(self) -> dict[str, Any]:
        """Return the network as drivers read it: dictionaries and numbers; arrays are still to be written as lists."""
        return asdict(self)

    def program(self) -> hw.ChipProgram:
        """Return the network as a program for our engine."""
        builder = hw.ProgramBuilder(hw.chip("loihi-sim"))
        nodes = {"x": builder.add_input("x", self.spikes.shape[1])}
        for population in self.populations:
            nodes[population.name] = builder.add_compartments(**vars(population))
        for projection in self.projections:
            arguments = dict(vars(projection))
            builder.connect(
                nodes[arguments.pop("source")], nodes[arguments.pop("target")], **arguments
            )
        return builder.build()

    def simulate(self) -> hw.SimulationResult:
        """Play the network in our engine, with spikes, u and v of every step."""
        return hw.simulate(self.program(), self.spikes, probe=PROBES)


def arrays_by_key(network: Network, result: hw.SimulationResult) -> Mapping[str, NDArray[np.int64]]:
    """Return the arrays of a result under the keys that drivers write: network, population and probe."""
    return {
        f"{network.name}/{population.name}/{probe}": getattr(result, probe)[population.name]
        for population in network.populations
        for probe in PROBES
    }
