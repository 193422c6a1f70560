"""Run as a process: compiles the loops of sessions, while another one compiles those of simulations.

On a machine that has nothing compiled yet, a command that needs both waits for the longer of the two. The tile, which
sessions and simulations share, is left to the other process: no step is run here.
"""

from hw_model.engine.ahead_of_tiles import program_of_one_chunk
from hw_model.streaming.session import Session

if __name__ == "__main__":
    for transposed in (False, True):
        Session(program_of_one_chunk(transposed=transposed))
