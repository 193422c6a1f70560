"""Play recordings to a board that runs the open core, and compare its answers with the simulator's.

This is what ``locsnn rtl stream`` does.
"""

from contextlib import closing
from dataclasses import replace
from typing import Any

import numpy as np

from hw_model.engine.playing import Spikes, read_streams
from hw_model.errors import InputError
from hw_model.program.chip_program import ChipProgram
from hw_model.rtl.board import Board, spike_numbers
from hw_model.rtl.cosimulation import ANSWER_COUNTS
from hw_model.rtl.device import on_core
from hw_model.rtl.images import SIMULATED, CoreProgram
from hw_model.rtl.ports import open_port
from hw_model.simulation import simulate


def stream(
    program: ChipProgram, spikes: Spikes, port: str, baud: int, report: bool
) -> dict[str, Any]:
    """Play recordings (batch, steps, channels) on a board; return answers and what differs.

    The entries of the result are lists with an item per recording, and their totals. ``report``:
    compare every spike, not only classes and counts. Raise an ``InputError`` if the board does not
    answer.
    """
    recordings = np.concatenate(list(read_streams(program, spikes)[0].values()), axis=2)
    rows = recordings.shape[1]
    if program.chip.open_core and port.startswith("sim:"):
        # A simulated board could be as large as needed: refuse what the device does not hold.
        on_core(program, rows, program.chip)
    # The sizes of a simulated board. Boards have neither steps nor shared places, as only a chip
    # does.
    plain = replace(program.chip.open_core or SIMULATED, step=0, places=0)
    sizes = CoreProgram(program, rows, steps=None, sizes=plain).simulated(SIMULATED)
    with closing(open_port(port, baud, sizes)) as line:
        try:
            board = Board(line)
            core = CoreProgram(program, rows, steps=None, sizes=board.sizes)
            board.load(core)
            board.report(wanted=report)
            answers = [board.play(core, recording) for recording in recordings]
        except OSError as error:
            raise InputError(
                f"port {port!r}", "the line broke", measured=str(error), fix="Plug it in again."
            ) from None
    expected = simulate(program, spikes, probe=("spikes",))
    # Names of the figures that differ, per recording.
    different: list[list[str]] = []
    for i, answer in enumerate(answers):
        # Without a readout there is no class to compare.
        winner = answer.winner if expected.scores is None else expected.prediction[i]
        is_equal = {"error": answer.error == 0, "class": answer.winner == winner}
        for name, count in zip(ANSWER_COUNTS, answer.counts, strict=True):
            is_equal[name] = count == expected.per_recording[i][name]
        if report:
            spikes_of_recording = {name: array[i] for name, array in expected.spikes.items()}
            expected_spikes = spike_numbers(core, recordings[i], spikes_of_recording)
            is_equal["times of spikes"] = list(answer.spikes) == expected_spikes
        different.append([name for name, equal in is_equal.items() if not equal])
    return {
        "recordings": len(answers),
        "classes": [answer.winner for answer in answers],
        "expected": None if expected.scores is None else expected.prediction.tolist(),
        "errors": [answer.error for answer in answers],
        "lost_spikes": [answer.lost for answer in answers],
        "cycles": [answer.cycles for answer in answers],
        "different": different,
        "mismatches": sum(map(bool, different)),
    }
