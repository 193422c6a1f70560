"""Run as a process: compiles the loops of sessions, while another one compiles those of simulations.

On a machine that has nothing compiled yet, a command that needs both waits for the longer of the two.
"""

from dataclasses import replace

import numpy as np

from hw_model.description.chip import Chip, chip
from hw_model.mapping.graph import Axis, CompartmentGraph, Phase, Readout
from hw_model.mapping.placement import place_cores
from hw_model.mapping.routing import route_axons
from hw_model.program.assemble import assemble
from hw_model.program.builder import ProgramBuilder
from hw_model.program.chip_program import ChipProgram
from hw_model.streaming.session import Session
from hw_model.values import IntArray


def smallest() -> ChipProgram:
    """Return a program of a time phase and a transposed one; loops are compiled once for all programs of 32 bits."""
    loihi = chip("loihi-sim")
    time, location = _phase(loihi, "time", None), _phase(loihi, "location", np.zeros(1, dtype=np.int64))
    graph = replace(
        time,
        phases=time.phases + location.phases,
        inputs=time.inputs + location.inputs,
        groups=time.groups + location.groups,
        synapses=time.synapses + location.synapses,
        readout=Readout(tuple(group.name for group in time.groups + location.groups), (1.0, 1.0)),
    )
    return assemble(route_axons(place_cores(graph, loihi)))


def _phase(on: Chip, axis: Axis, positions: IntArray | None) -> CompartmentGraph:
    builder = ProgramBuilder(on)
    x, y = builder.add_input(f"{axis}/x", 1), builder.add_compartments(f"{axis}/y", 1, threshold=1)
    builder.connect(x, y, np.full((1, 1), 2))
    graph = builder.graph()
    return replace(
        graph,
        phases=(Phase(axis, axis, 1),),
        inputs=tuple(replace(item, phase=axis, stream="x", positions=positions) for item in graph.inputs),
        groups=tuple(replace(group, phase=axis) for group in graph.groups),
    )


if __name__ == "__main__":
    Session(smallest()).push(np.ones((1, 1), dtype=np.uint8))
