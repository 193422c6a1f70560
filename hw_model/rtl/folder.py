"""``--emit rtl``: the core with a program, as a folder that needs nothing else.

It holds the SystemVerilog, the program in words of the load port, a recording and the answers to
expect, and the files of the boards. ``boards/README.md`` becomes its page.
"""

from collections.abc import Mapping
from importlib.resources import files

import numpy as np

from hw_model.description.board import board as read_board
from hw_model.description.boards import BOARDS
from hw_model.description.open_core import Sizes
from hw_model.engine.playing import Spikes, read_streams
from hw_model.program.chip_program import ChipProgram
from hw_model.rtl.board_sources import board_sources
from hw_model.rtl.cosimulation import ANSWER_COUNTS, words_of
from hw_model.rtl.cycles import core_cycles
from hw_model.rtl.device import on_core
from hw_model.rtl.images import SIMULATED, CoreProgram, parameters, sizes_for
from hw_model.rtl.memory_needs import arrays_of
from hw_model.rtl.memory_plan import as_csv, plan
from hw_model.rtl.memory_words import hex_words
from hw_model.rtl.simulators import sources
from hw_model.simulation import SimulationResult, simulate
from hw_model.values import ByteArray, IntArray


def rtl_files(program: ChipProgram, spikes: Spikes) -> dict[str, bytes]:
    """Return the files of the folder by name; ``spikes`` is the one recording that its bench plays."""
    recording = np.concatenate(
        [stream[0] for stream in read_streams(program, spikes)[0].values()], axis=1
    )
    device = program.chip
    board = next((name for name, target in BOARDS.items() if target == device.name), "")
    core = (
        on_core(program, len(recording), device)
        if device.open_core
        else CoreProgram(program, len(recording))
    )
    sizes = device.open_core or sizes_for(core.needs, SIMULATED)
    played = simulate(program, spikes, probe=("spikes", "u", "v", "potential"))
    cycles = core_cycles(core, recording, played.spikes)
    winner = 0 if played.scores is None else int(played.prediction)
    updates = _updates(core, recording, played)
    answer = [0, winner, cycles, *(played.counts[name] for name in ANSWER_COUNTS)]
    rtl = board_files(sizes, board) | {
        "load": hex_words(core.load_words(sizes)),
        "words": "".join(f"{word:x}\n" for word in words_of(core, recording)).encode(),
        "expected_answers": (" ".join(map(str, answer)) + "\n").encode(),
        "expected_updates": "".join(
            f"{' '.join(map(str, row))}\n" for row in updates.tolist()
        ).encode(),
    }
    if device.macros:
        planned = plan(arrays_of(core, sizes, played.counts), device.macros)
        rtl["memories.csv"] = as_csv(piece for memory in planned for piece in memory.pieces())
    return {f"rtl/{name}": content for name, content in rtl.items()}


def board_files(sizes: Sizes, board: str, own: Mapping[str, str] | None = None) -> dict[str, bytes]:
    """Return the files of a bitstream: sources, Makefile, constraints and parameters.

    ``board`` is the name of a board that ships, empty for none, or that of the user's own board,
    whose files are ``own``.
    """
    files_of_boards: dict[str, str] = {}
    for name, target in BOARDS.items():
        files_of_boards |= board_sources(read_board(name), target)
    files_of_boards |= own or {}
    values = parameters(sizes)
    # The same parameters for make, which passes them to simulators, and for the top module of a
    # board.
    for_make = " ".join(f"{name}={value}" for name, value in values.items())
    for_top = ", ".join(f".{name}({value})" for name, value in values.items())
    contents = {name: text.encode() for name, text in sources().items()}
    shipped = (files("hw_model") / "rtl" / "boards").iterdir()
    for entry in sorted(shipped, key=lambda entry: entry.name):
        is_code = entry.name.startswith("__")
        is_template = entry.name.endswith(".in")
        if not (is_code or is_template):
            contents[entry.name] = entry.read_bytes()
    contents |= {name: text.encode() for name, text in files_of_boards.items()}
    return contents | {
        "config.mk": f"BOARD ?= {board}\nPARAMETERS := {for_make}\n".encode(),
        "top.sv": f'`include "{board}.top.sv"\n'.encode(),
        "parameters.vh": f"`define PARAMETERS {for_top}\n".encode(),
    }


def _updates(core: CoreProgram, recording: ByteArray, played: SimulationResult) -> IntArray:
    """Return what the bench is expected to write of every update.

    The array is (updates, 5), with the columns compartment, u, v, potential, spike.
    """
    rows = []
    for phase in core.phases:
        numbers = core.numbers[phase.name]
        steps = phase.span(recording)
        # (step, column, number of the line), then in the order of the core.
        table = np.zeros((len(steps), len(numbers), 5), dtype=np.int64)
        table[..., 0] = numbers
        for name, columns in core.program.columns_of(phase.name).items():
            registers = (played.u[name], played.v[name], played.potential[name])
            table[:, columns, 1:4] = np.stack(registers, axis=-1)[steps]
            if name in played.spikes:
                table[:, columns, 4] = played.spikes[name][steps]
        # The core updates compartments in the order of their numbers, in every step.
        rows.append(table[:, np.argsort(numbers)].reshape(-1, 5))
    return np.concatenate(rows)
