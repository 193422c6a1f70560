"""A helper process (:mod:`hw_model.engine.ahead`): it compiles the fast engine's tile, and its loop over recordings.

It does so by playing a tiny program. Loops are compiled by the types of their arguments, so the
code serves every program whose layout has 32 bits. :func:`transposed_dendrites` is a program for
the helpers of other rooms, which compile the loops of sessions.
"""

from dataclasses import replace

import numpy as np

from hw_model.arithmetic.loihi import FORGETS
from hw_model.description.chip import chip
from hw_model.engine.layout import LANES
from hw_model.program.builder import ProgramBuilder
from hw_model.program.chip_program import ChipProgram


def program_of_one_chunk() -> ChipProgram:
    """Return a program of one input and one full chunk, fully connected. All programs in 32 bits share its loops."""
    builder = ProgramBuilder(chip("loihi-sim"))
    x = builder.add_input("x", 1)
    y = builder.add_compartments("y", LANES, threshold=1)
    builder.connect(x, y, np.full((LANES, 1), 2))
    builder.read_out(y)
    return builder.build()


def transposed_dendrites() -> ChipProgram:
    """Return a program whose input goes through the transpose buffer, to neurons of two dendrites each."""
    builder = ProgramBuilder(chip("loihi-sim"))
    x = builder.add_input("x", 1)
    # A soma that keeps nothing is only the sum of its dendrites: the three chunks run as a pair.
    soma = builder.add_compartments("soma", LANES, threshold=1, decay_u=FORGETS, decay_v=FORGETS)
    for name in ("one", "other"):
        dendrite = builder.add_compartments(name, LANES, threshold=1, joined_to=soma)
        builder.connect(x, dendrite, np.full((LANES, 1), 2))
    builder.read_out(soma)
    program = builder.build()
    transposed_input = replace(program.inputs[0], positions=np.zeros(1, dtype=np.int64))
    return replace(program, inputs=(transposed_input,))


def _play_silence() -> None:
    """Play a recording without events, which compiles what every recording needs.

    Events are listed by the plain functions: the loops that list them compile quickly, and another process does it.
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
