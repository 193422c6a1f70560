"""The bitstream of a board: made once for its device, step by step, and kept for all programs."""

import hashlib
import json
import logging
import re
import sys
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from hw_model.description.board import Board
from hw_model.description.chip import chip
from hw_model.errors import InputError, TargetError
from hw_model.io.build_folder import write_build
from hw_model.io.partial import locked
from hw_model.program.chip_program import ChipProgram
from hw_model.rtl.board_sources import board_sources
from hw_model.rtl.device import on_core
from hw_model.rtl.folder import board_files
from hw_model.rtl.simulators import kept, said
from hw_model.values import Frozen

CELLS: dict[str, tuple[str, ...]] = {
    "luts": ("TRELLIS_COMB", "ICESTORM_LC"),
    "flip_flops": ("TRELLIS_FF", "SB_DFF"),
    "block_rams": ("DP16KD", "ICESTORM_RAM"),
    "multipliers": ("MULT18X18D", "ICESTORM_DSP"),
}
"""What the tools of both families call them, by the beginning of the name."""
_NO_SUCH_PIN = re.compile(
    r"constrained to pin '(?P<ecp5>\w+)', which does not exist for package"
    r"|package does not have a pin named '(?P<ice40>\w+)'"
)
"""What nextpnr says of a site that the package of a board lacks, for both families."""
_log = logging.getLogger("locsnn")


class Placement(Frozen):
    """The core of a device on a board, as the fastest of several placements has it, and its bitstream.

    - ``used``, ``available``: cells by kind, as in :data:`CELLS`
    - ``clocks_mhz``: the clock that each placement reaches, by seed from 1 on
    - ``seed``: of the placement that the bitstream is of
    - ``tools``: version of each tool
    - ``file_name``: of the bitstream
    """

    device: str
    board: str
    used: Mapping[str, int]
    available: Mapping[str, int]
    clocks_mhz: tuple[float, ...]
    seed: int
    tools: Mapping[str, str]
    file_name: str
    bitstream: bytes

    @property
    def fmax_mhz(self) -> float:
        """The clock that the bitstream reaches."""
        return self.clocks_mhz[self.seed - 1]


class NoRoomError(TargetError):
    """A device without room for the core; ``measured`` says what it has too little of."""


class _Build(Frozen):
    """A folder that only this process changes, the board that is made there, and its number of placements."""

    folder: Path
    described: Board
    placements: int

    @property
    def board(self) -> str:
        """The name of the board, with which names of files begin."""
        return self.described.name

    @property
    def where(self) -> str:
        """How messages name it."""
        return f"board {self.board!r}"

    def make(self, *targets: str) -> str:
        """Run make, and return what it says."""
        variables = (f"BOARD={self.board}", f"SEEDS={self.placements}")
        return said(["make", "-s", *targets, *variables], self.folder, self.where)

    def is_made(self, target: str) -> bool:
        """Return whether a target is there: what it is made of never changes in this folder."""
        return (self.folder / target).exists()

    def placement(self, seed: int) -> str:
        """Return the name of the report on a placement."""
        return f"{self.board}-{seed}.json"

    @property
    def fastest(self) -> str:
        """The name of the file that holds the seed of the fastest placement."""
        return f"{self.board}.fastest"

    def bitstreams(self) -> list[Path]:
        """Return the bitstream, if it was made: its ending depends on the family."""
        return list(self.folder.glob(f"{self.board}.bi[tn]"))


def fit(program: ChipProgram, board: Board, seeds: int, target: str = "") -> Placement:
    """Return the fastest of ``seeds`` placements of the core on a board, with its bitstream.

    ``target`` names the core, by default the usual one of the board's device. What does not fit it is refused before
    anything is made. All programs share the bitstream of a device, which is kept in the user's cache folder and placed
    by one process at a time. The log names each step that takes seconds, with what remains. A missing tool is an
    ``InputError``, a device without room for the core a :class:`NoRoomError`.
    """
    device = chip(target or board.target)
    assert device.open_core is not None
    on_core(program, max(phase.steps or 1 for phase in program.phases), device)
    files = board_files(device.open_core, board.name, board_sources(board, device.name))
    folder = kept(f"fit-{hashlib.sha256(repr(sorted(files.items())).encode()).hexdigest()[:16]}")
    lock = kept(f"{folder.name}.lock")
    _say_if_busy(lock)
    with locked(lock, wait=True):
        write_build(folder, {} if (folder / "Makefile").exists() else files)
        return _placed(_Build(folder, board, seeds), device.name)


def _say_if_busy(lock: Path) -> None:
    if not lock.exists() or sys.platform == "win32":
        return
    with locked(lock) as is_free:
        if not is_free:
            _log.info("waiting for another process, which places the same core")


def _placed(build: _Build, device: str) -> Placement:
    """Make what is missing in the folder, and return what is there then."""
    versions = _versions(build)
    _synthesise(build)
    _place(build)
    _pack(build)
    seed = int((build.folder / build.fastest).read_text())
    (bitstream,) = build.bitstreams()
    return Placement(
        device=device,
        board=build.board,
        used=_used(build, seed),
        available=_available(build, seed),
        clocks_mhz=tuple(_clock_mhz(build, each) for each in range(1, build.placements + 1)),
        seed=seed,
        tools=versions,
        file_name=bitstream.name,
        bitstream=bitstream.read_bytes(),
    )


def _versions(build: _Build) -> dict[str, str]:
    """Return the version of each tool. The first start of a tool that pip installed unpacks it."""
    tools = build.make("tools").split()
    versions = {}
    for number, tool in enumerate(tools, 1):
        _log.info(
            "starting %s, tool %d of %d: its first start unpacks it, a minute or two",
            tool,
            number,
            len(tools),
        )
        versions[tool] = said([tool, "--version"], build.folder, build.where).splitlines()[-1]
    return versions


def _synthesise(build: _Build) -> None:
    if not build.is_made(f"{build.board}.json"):
        _log.info("synthesis, before placement 1 of %d", build.placements)
        build.make(f"{build.board}.json")


def _place(build: _Build) -> None:
    """Make every placement that is not there, one by one, so that the log can tell what remains."""
    missing = [
        seed for seed in range(1, build.placements + 1) if not build.is_made(build.placement(seed))
    ]
    begun = time.perf_counter()
    for number, seed in enumerate(missing):
        left = ""
        if number:
            seconds = (time.perf_counter() - begun) / number * (len(missing) - number)
            left = f", about {seconds:.0f} s remain"
        _log.info("placement and timing %d of %d%s", seed, build.placements, left)
        try:
            build.make(build.placement(seed))
        except InputError as error:
            no_such_pin = _NO_SUCH_PIN.search(error.measured)
            if no_such_pin is not None:
                site = no_such_pin["ecp5"] or no_such_pin["ice40"]
                raise _no_pin(build, site) from error
            raise _no_room(build, seed, error) from error


def _pack(build: _Build) -> None:
    """Make the bitstream of the fastest placement."""
    packed_before = build.bitstreams() and (build.folder / build.fastest).read_text()
    build.make(build.fastest)
    fastest = (build.folder / build.fastest).read_text()
    if fastest != packed_before:
        _log.info("packing the bitstream of placement %s, the last step", fastest.strip())
    build.make("fit")


def _report(build: _Build, seed: int) -> Any:
    """Return what nextpnr reports on a placement."""
    return json.loads((build.folder / build.placement(seed)).read_text())


def _clock_mhz(build: _Build, seed: int) -> float:
    """Return the slowest of the clocks of a placement."""
    return float(min(clock["achieved"] for clock in _report(build, seed)["fmax"].values()))


def _used(build: _Build, seed: int) -> dict[str, int]:
    """Return the cells that a placement takes, by kind; yosys counts those that nextpnr does not."""
    cells = json.loads((build.folder / f"{build.board}.cells").read_text())
    used = dict(cells["design"]["num_cells_by_type"])
    used |= {name: entry["used"] for name, entry in _report(build, seed)["utilization"].items()}
    return _by_kind(used)


def _available(build: _Build, seed: int) -> dict[str, int]:
    """Return the cells that the device has, by kind."""
    utilization = _report(build, seed)["utilization"]
    return _by_kind({name: entry.get("available", 0) for name, entry in utilization.items()})


def _by_kind(cells: Mapping[str, int]) -> dict[str, int]:
    """Return the sums of cells, from the names of the tools to the kinds of both families."""
    return {
        kind: sum(number for name, number in cells.items() if name.startswith(beginnings))
        for kind, beginnings in CELLS.items()
    }


def _no_pin(build: _Build, site: str) -> InputError:
    """Return the error of a site that the package of a board lacks."""
    keys = [key for key, pin in build.described.pins() if pin.pin == site]
    where = ", ".join([build.where, *keys])
    what = f"package {build.described.device.package} has no pin {site}"
    return InputError(where, what, fix="Give a pin that the package has.")


def _no_room(build: _Build, seed: int, error: InputError) -> NoRoomError:
    """Return the error of a core that a device has no room for, from that of a placement."""
    measured = _too_much(build.folder / f"{build.board}-{seed}.log") or error.measured
    what = "the core cannot be placed"
    return NoRoomError(build.where, what, measured=measured, fix="Choose a larger device.")


def _too_much(log: Path) -> str:
    """Return what a placement takes more of than there is, as its log says: ``39 of 30 block RAMs``."""
    text = log.read_text("utf-8") if log.exists() else ""
    kinds = {
        name: kind.replace("_rams", " RAMs") for kind, names in CELLS.items() for name in names
    }
    lacking = []
    for name, used, available in re.findall(r"(\w+): +(\d+)/ *(\d+) ", text):
        if int(used) > int(available):
            lacking.append(f"{int(used):,} of {int(available):,} {kinds.get(name, name)}")
    return ", ".join(lacking)
