"""Compile the fast engine's loops, as a helper process that :mod:`hw_model.engine.ahead` starts.

The loops are :func:`hw_model.engine.tiles.run_tile`, which plays a *tile* (some consecutive steps) of a recording, and
the loop over recordings around it. numba compiles a loop when it is called, so this process plays a tiny program, and
leaves the machine code in numba's cache on the disk. numba compiles a loop once for each combination of argument types.
Programs differ only in the width of the engine's numbers, 32 bits or 64, so this machine code serves every program for
which 32 bits are proven to suffice. That is usual; the loops for 64 bits are compiled when they are needed.

The functions that return tiny programs are also for :mod:`hw_model.streaming.ahead`, the helper process that compiles
the loops of streaming sessions.
"""

from dataclasses import replace

import numpy as np

from hw_model.arithmetic.loihi import FORGETS
from hw_model.description.chip import chip
from hw_model.engine.layout import LANES
from hw_model.program.builder import ProgramBuilder
from hw_model.program.chip_program import ChipProgram


def program_of_one_chunk() -> ChipProgram:
    """Return a program of one input line and one full chunk, fully connected.

    A *chunk* is the 16 compartments that the engine updates together, in vectors.
    """
    builder = ProgramBuilder(chip("loihi-sim"))
    x = builder.add_input("x", 1)
    y = builder.add_compartments("y", LANES, threshold=1)
    builder.connect(x, y, np.full((LANES, 1), 2))
    builder.read_out(y)
    return builder.build()


def transposed_dendrites() -> ChipProgram:
    """Return a program whose input goes through the transpose buffer, to neurons of two dendrites each.

    It is what a location branch of spike response neurons becomes, and needs other loops of a session than
    :func:`program_of_one_chunk`.
    """
    builder = ProgramBuilder(chip("loihi-sim"))
    x = builder.add_input("x", 1)
    # A soma that forgets its current and voltage in each step is only the sum of its dendrites. The engine has a faster
    # loop for this case (`update_pair`): a pair of chunks, the dendrites, is updated together with the soma's chunk.
    soma = builder.add_compartments("soma", LANES, threshold=1, decay_u=FORGETS, decay_v=FORGETS)
    for name in ("one", "other"):
        dendrite = builder.add_compartments(name, LANES, threshold=1, joined_to=soma)
        builder.connect(x, dendrite, np.full((LANES, 1), 2))
    builder.read_out(soma)
    program = builder.build()
    # Positions send an input through the transpose buffer: its only channel is read at step 0 of the phase.
    transposed_input = replace(program.inputs[0], positions=np.zeros(1, dtype=np.int64))
    return replace(program, inputs=(transposed_input,))


def _play_silence() -> None:
    """Play a recording without events, which compiles the loops that every recording needs.

    Events are listed by the plain functions: the loops that list them compile quickly, and another process does that.
    """
    from hw_model.engine.fast import run_phase
    from hw_model.engine.playing import Player, list_events, play

    program = program_of_one_chunk()
    phase = program.phases[0]
    events = list_events("x", np.zeros((1, 1, 1), dtype=np.uint8))
    run_phase(
        program, phase.name, play(program, phase, {"x": events}, steps=None, player=Player()), {}
    )


if __name__ == "__main__":
    _play_silence()
