"""Run as a process: compiles the tile and the loop over recordings, while another one compiles the rest."""

from dataclasses import replace

import numpy as np

from hw_model.arithmetic.loihi import FORGETS
from hw_model.description.chip import chip
from hw_model.engine.layout import LANES
from hw_model.program.builder import ProgramBuilder
from hw_model.program.chip_program import ChipProgram


def program_of_one_chunk() -> ChipProgram:
    """Return a program of one input and one full chunk, connected in full: all of 32 bits share its loops."""
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
    # What keeps nothing adds up its dendrites: they are run together, as a pair.
    soma = builder.add_compartments("soma", LANES, threshold=1, decay_u=FORGETS, decay_v=FORGETS)
    for name in ("one", "other"):
        dendrite = builder.add_compartments(name, LANES, threshold=1, joined_to=soma)
        builder.connect(x, dendrite, np.full((LANES, 1), 2))
    builder.read_out(soma)
    program = builder.build()
    played = replace(program.inputs[0], positions=np.zeros(1, dtype=np.int64))
    return replace(program, inputs=(played,))


def _play_nothing() -> None:
    """Play a recording without events; its list, which is soon compiled, is left to the other process."""
    from hw_model.engine.fast import run_phase
    from hw_model.engine.playing import Player, list_events, play

    program = program_of_one_chunk()
    phase = program.phases[0]
    events = list_events("x", np.zeros((1, 1, 1), dtype=np.uint8))
    run_phase(program, phase.name, play(program, phase, {"x": events}, None, Player()), {})


if __name__ == "__main__":
    _play_nothing()
