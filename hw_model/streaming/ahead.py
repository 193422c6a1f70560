"""Run as a process: compiles the loops of sessions, while another one compiles those of simulations.

On a machine that has nothing compiled yet, a command that needs both waits for the longer of the two. The tile, which
sessions and simulations share, is left to the other process: no step is run here.
"""

from dataclasses import replace

import numpy as np

from hw_model.description.chip import chip
from hw_model.program.builder import ProgramBuilder
from hw_model.streaming.session import Session

if __name__ == "__main__":
    # A program of one synapse, as it comes and transposed: all of 32 bits share its loops.
    builder = ProgramBuilder(chip("loihi-sim"))
    x, y = builder.add_input("x", 1), builder.add_compartments("y", 1, threshold=1)
    builder.connect(x, y, np.full((1, 1), 2))
    builder.read_out(y)
    program = builder.build()
    for positions in (None, np.zeros(1, dtype=np.int64)):
        Session(replace(program, inputs=(replace(program.inputs[0], positions=positions),)))
