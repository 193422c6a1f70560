"""Run as a process: compiles the loops of sessions, while another one compiles those of simulations.

On a machine that has nothing compiled yet, a command that needs both waits for the longer of the two. The tile, which
sessions and simulations share, is left to the other process: no step is run here.
"""

import numpy as np

from hw_model.engine.ahead_of_tiles import program_of_one_chunk, transposed_dendrites
from hw_model.engine.compiled import called
from hw_model.streaming.session import Session
from hw_model.streaming.time_phase import weigh

if __name__ == "__main__":
    Session(transposed_dendrites())
    Session(program_of_one_chunk())
    counts = np.zeros((0, 1), dtype=np.int64)
    called(weigh, counts, np.zeros(1, dtype=np.int64), np.zeros((1, 1)), np.zeros((0, 1)))
