"""Recordings streamed to a board that runs the open core, and its answers compared with the simulator's."""

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
    """Load a program, play recordings (batch, steps, channels), and return answers and what differs, per recording.

    ``report``: compare every spike, not only classes and counts. A board that does not answer is an ``InputError``.
    """
    recordings = np.concatenate(list(read_streams(program, spikes)[0].values()), axis=2)
    if program.chip.open_core and port.startswith("sim:"):
        on_core(program, recordings.shape[1], program.chip)
    plain = replace(program.chip.open_core or SIMULATED, step=0, places=0)
    sizes = CoreProgram(program, recordings.shape[1], None, plain).simulated(SIMULATED)
    with closing(open_port(port, baud, sizes)) as line:
        try:
            board = Board(line)
            core = CoreProgram(program, recordings.shape[1], None, board.sizes)
            board.load(core)
            board.report(report)
            answers = [board.play(core, recording) for recording in recordings]
        except OSError as error:
            raise InputError(
                f"port {port!r}", "the line broke", measured=str(error), fix="Plug it in again."
            ) from None
    expected = simulate(program, spikes, probe=("spikes",))
    # Names of the figures that differ, per recording.
    different: list[list[str]] = []
    for i, answer in enumerate(answers):
        winner = answer.winner if expected.scores is None else expected.prediction[i]
        is_equal = {"error": answer.error == 0, "class": answer.winner == winner}
        for name, count in zip(ANSWER_COUNTS, answer.counts, strict=True):
            is_equal[name] = count == expected.per_recording[i][name]
        if report:
            spikes_of_recording = {name: array[i] for name, array in expected.spikes.items()}
            times = spike_numbers(core, recordings[i], spikes_of_recording)
            is_equal["times of spikes"] = list(answer.spikes) == times
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
