"""Compile the loops of streaming sessions ahead, as a process of its own (``python -m``).

On a machine that has nothing compiled yet, a command that needs both sessions and simulations starts this process, and
another one that compiles the loops of simulations, and waits for the slower of the two. Compiled code is shared through
numba's cache on the disk. The loop over a tile of steps, which both need, is left to the other process: no step is run
here.
"""

import numpy as np

from hw_model.engine.ahead_of_tiles import program_of_one_chunk, transposed_dendrites
from hw_model.engine.compiled import called
from hw_model.streaming.session import Session
from hw_model.streaming.time_phase import weigh

if __name__ == "__main__":
    # Making a session compiles its loops. The two programs differ in which loops they need.
    Session(transposed_dendrites())
    Session(program_of_one_chunk())
    # `weigh` is compiled by its first call, so call it with the types that a session uses.
    readings = np.zeros((0, 1), dtype=np.int64)
    first_column = np.zeros(1, dtype=np.int64)
    called(weigh, readings, first_column, np.zeros((1, 1)), np.zeros((0, 1)))
