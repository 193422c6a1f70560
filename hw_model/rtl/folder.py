"""``--emit rtl``: the core with a program as a folder that needs nothing else, and what its Makefile makes of it."""

import hashlib
import json
import re
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np

from hw_model.description.chip import chip
from hw_model.description.open_core import Sizes
from hw_model.engine.playing import Spikes, read_streams
from hw_model.errors import InputError, TargetError
from hw_model.io.build_folder import write_build
from hw_model.io.partial import locked
from hw_model.program.chip_program import ChipProgram
from hw_model.rtl.boards import BOARDS
from hw_model.rtl.cosimulation import ANSWER, words_of
from hw_model.rtl.cycles import core_cycles
from hw_model.rtl.device import on_core
from hw_model.rtl.images import SIMULATED, CoreProgram, parameters, sizes_for
from hw_model.rtl.memory_needs import arrays_of
from hw_model.rtl.memory_plan import as_csv, plan
from hw_model.rtl.memory_words import hex_words
from hw_model.rtl.simulators import kept, said, sources
from hw_model.simulation import SimulationResult, simulate
from hw_model.values import ByteArray, IntArray

CELLS = {
    "luts": ("TRELLIS_COMB", "ICESTORM_LC"),
    "flip_flops": ("TRELLIS_FF", "SB_DFF"),
    "block_rams": ("DP16KD", "ICESTORM_RAM"),
    "multipliers": ("MULT18X18D", "ICESTORM_DSP"),
}
"""What the tools of both families call them, by the beginning of the name."""


def rtl_files(program: ChipProgram, spikes: Spikes) -> dict[str, bytes]:
    """Return the files by name, in the folder ``rtl``; ``spikes``: the one recording that its bench plays."""
    recording = np.concatenate(
        [one[0] for one in read_streams(program, spikes)[0].values()], axis=1
    )
    device, board = (
        program.chip,
        next((b for b, name in BOARDS.items() if name == program.chip.name), ""),
    )
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
    answer = [0, winner, cycles, *(played.counts[name] for name in ANSWER[3:])]
    made = board_files(sizes, board) | {
        "load": hex_words(core.load_words(sizes)),
        "words": "".join(f"{word:x}\n" for word in words_of(core, recording)).encode(),
        "expected_answers": (" ".join(map(str, answer)) + "\n").encode(),
        "expected_updates": "".join(
            f"{' '.join(map(str, row))}\n" for row in updates.tolist()
        ).encode(),
    }
    if device.macros:
        planned = plan(arrays_of(core, sizes, played.counts), device.macros)
        made["memories.csv"] = as_csv(piece for one in planned for piece in one.pieces())
    return {f"rtl/{name}": content for name, content in made.items()}


def board_files(sizes: Sizes, board: str) -> dict[str, bytes]:
    """Return sources, Makefile, constraints and parameters: all that a bitstream is made of."""
    given = parameters(sizes)
    config = f"BOARD ?= {board}\nPARAMETERS := {' '.join(f'{name}={value}' for name, value in given.items())}\n"
    defined = (
        f"`define PARAMETERS {', '.join(f'.{name}({value})' for name, value in given.items())}\n"
    )
    kept = [
        entry
        for entry in (files("hw_model") / "rtl" / "boards").iterdir()
        if not entry.name.startswith("__")
    ]
    return {
        **{name: text.encode() for name, text in sources().items()},
        **{entry.name: entry.read_bytes() for entry in sorted(kept, key=lambda entry: entry.name)},
        "config.mk": config.encode(),
        "top.sv": f'`include "top_{board.split("-")[0]}.sv"\n'.encode(),
        "parameters.vh": defined.encode(),
    }


def fit(program: ChipProgram, board: str, seeds: int) -> tuple[dict[str, Any], bytes]:
    """Return what a board's bitstream takes, with the slowest clock of ``seeds`` placements, and the bitstream.

    What does not fit the open core is refused before anything is made. All programs share the bitstream of a device,
    which is kept in the user's cache folder and placed by one process at a time. A missing tool is an ``InputError``, a
    device without room for the core a ``TargetError``.
    """
    device = chip(BOARDS[board])
    assert device.open_core is not None
    on_core(program, max(phase.steps or 1 for phase in program.phases), device)
    made = board_files(device.open_core, board)
    folder = kept(f"fit-{hashlib.sha256(repr(sorted(made.items())).encode()).hexdigest()[:16]}")
    with locked(kept(f"{folder.name}.lock"), wait=True):
        write_build(folder, {} if (folder / "Makefile").exists() else made)
        return _placed(folder, board, device.name, seeds)


def _placed(folder: Path, board: str, device: str, seeds: int) -> tuple[dict[str, Any], bytes]:
    """Return what ``make fit`` finds in a folder that only this process changes, and the bitstream."""
    where = f"board {board!r}"
    tools = said(["make", "-s", "tools", f"BOARD={board}"], folder, where).split()
    versions = {tool: said([tool, "--version"], folder, where).splitlines()[-1] for tool in tools}
    try:
        said(["make", "fit", f"BOARD={board}", f"SEEDS={seeds}"], folder, where)
    except InputError as error:
        if not (folder / f"{board}.json").exists():
            raise
        fix = "Choose a larger device."
        measured = _too_much(folder / f"{board}-1.log") or error.measured
        raise TargetError(where, "the core cannot be placed", measured=measured, fix=fix) from error
    placed = [
        json.loads((folder / f"{board}-{seed}.json").read_text()) for seed in range(1, seeds + 1)
    ]
    cells = json.loads((folder / f"{board}.cells").read_text())["design"]["num_cells_by_type"]
    (bitstream,) = folder.glob(f"{board}.bi[tn]")
    used = cells | {name: found["used"] for name, found in placed[0]["utilization"].items()}
    found = {
        "device": device,
        "fits": True,
        **{
            kind: sum(many for name, many in used.items() if name.startswith(its))
            for kind, its in CELLS.items()
        },
        "fmax_mhz": min(clock["achieved"] for one in placed for clock in one["fmax"].values()),
        "bitstream": bitstream.name,
        "tools": versions,
    }
    return found, bitstream.read_bytes()


def _too_much(log: Path) -> str:
    """Return what a placement takes more of than there is, as its log says: ``39 of 30 block RAMs``."""
    found = re.findall(r"(\w+): +(\d+)/ *(\d+) ", log.read_text("utf-8")) if log.exists() else []
    kinds = {
        name: kind.replace("_rams", " RAMs") for kind, names in CELLS.items() for name in names
    }
    over = ((kinds.get(name, name), int(used), int(held)) for name, used, held in found)
    return ", ".join(f"{used:,} of {held:,} {kind}" for kind, used, held in over if used > held)


def _updates(core: CoreProgram, recording: ByteArray, played: SimulationResult) -> IntArray:
    """Return what the core writes of every update, (updates, 5): compartment, u, v, potential, spike."""
    rows = []
    for phase in core.phases:
        numbers, span = core.numbers[phase.name], phase.span(recording)
        table = np.zeros((len(span), len(numbers), 5), dtype=np.int64)
        table[..., 0] = numbers
        for name, here in core.program.columns_of(phase.name).items() if len(numbers) else ():
            kinds = (played.u[name], played.v[name], played.potential[name])
            table[:, here, 1:4] = np.stack(kinds, axis=-1)[span]
            table[:, here, 4] = played.spikes[name][span] if name in played.spikes else 0
        rows.append(table[:, np.argsort(numbers)].reshape(-1, 5))
    return np.concatenate(rows)
