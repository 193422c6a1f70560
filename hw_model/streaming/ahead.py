"""Run as a process: compiles the loops of sessions, while another one compiles those of simulations.

On a machine that has nothing compiled yet, a command that needs both waits for the longer of the two.
"""

from dataclasses import replace

import numpy as np

from hw_model.description.chip import chip
from hw_model.mapping.placement import place_cores
from hw_model.mapping.routing import route_axons
from hw_model.program.assemble import assemble
from hw_model.program.builder import ProgramBuilder
from hw_model.program.chip_program import ChipProgram
from hw_model.streaming.session import Session
from hw_model.values import IntArray


def smallest(positions: IntArray | None) -> ChipProgram:
    """Return a program of one synapse, transposed where there are positions; all of 32 bits share its loops."""
    loihi = chip("loihi-sim")
    builder = ProgramBuilder(loihi)
    x, y = builder.add_input("x", 1), builder.add_compartments("y", 1, threshold=1)
    builder.connect(x, y, np.full((1, 1), 2))
    builder.read_out(y)
    graph = builder.graph()
    graph = replace(graph, inputs=(replace(graph.inputs[0], positions=positions),))
    return assemble(route_axons(place_cores(graph, loihi)))


if __name__ == "__main__":
    for positions in (None, np.zeros(1, dtype=np.int64)):
        Session(smallest(positions)).push(np.ones((1, 1), dtype=np.uint8))
