"""Place the open core on a board, and make the bitstream: what ``locsnn rtl fit`` does.

A bitstream holds the core of a device but no program, which is loaded over the serial line. So it
is made once for a board, by make in a folder of the user's cache, and serves all programs. Yosys
synthesises the core; nextpnr places it several times, each time from another seed, as the clock
that a placement reaches depends on chance; the fastest is packed.
"""

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
from hw_model.rtl.simulators import cache_path, run_tool
from hw_model.values import Frozen

CELLS: dict[str, tuple[str, ...]] = {
    "luts": ("TRELLIS_COMB", "ICESTORM_LC"),
    "flip_flops": ("TRELLIS_FF", "SB_DFF"),
    "block_rams": ("DP16KD", "ICESTORM_RAM"),
    "multipliers": ("MULT18X18D", "ICESTORM_DSP"),
}
"""The cells that a report counts, by kind: how their names begin in the tools of each FPGA family
(ECP5, iCE40)."""
_NO_SUCH_PIN = re.compile(
    r"constrained to pin '(?P<ecp5>\w+)', which does not exist for package"
    r"|package does not have a pin named '(?P<ice40>\w+)'"
)
"""What nextpnr prints if the package of a board lacks a pin, for both families."""
_log = logging.getLogger("locsnn")


class Placement(Frozen):
    """The core of a device on a board, as the fastest of several placements has it, and its bitstream.

    - ``used``, ``available``: cells by kind, as in :data:`CELLS`
    - ``clocks_mhz``: the clock that each placement reaches, by seed from 1 on
    - ``seed``: the seed of the fastest placement, from which the bitstream is packed
    - ``tools``: the version of each tool
    - ``file_name``: the name of the bitstream's file
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
    """Raised if a device has no room for the core; ``measured`` says which cells it has too few of."""


class _Build(Frozen):
    """The folder in which the bitstream of a board is made, the board, and its placements.

    Only this process changes the folder, as it holds the lock. The files that make starts from
    never change.
    """

    folder: Path
    described: Board
    placements: int

    @property
    def board(self) -> str:
        """The name of the board, with which the names of its files begin."""
        return self.described.name

    @property
    def where(self) -> str:
        """The place that messages name."""
        return f"board {self.board!r}"

    def make(self, *targets: str) -> str:
        """Run make for some targets, and return its output."""
        variables = (f"BOARD={self.board}", f"SEEDS={self.placements}")
        return run_tool(["make", "-s", *targets, *variables], self.folder, self.where)

    def is_made(self, target: str) -> bool:
        """Return whether a target exists; files that it depends on never change in this folder."""
        return (self.folder / target).exists()

    def placement(self, seed: int) -> str:
        """Return the name of the report on a placement."""
        return f"{self.board}-{seed}.json"

    @property
    def fastest(self) -> str:
        """The name of the file that holds the seed of the fastest placement."""
        return f"{self.board}.fastest"

    def bitstreams(self) -> list[Path]:
        """Return the bitstream, if it was made: it ends in .bit on an ECP5 and in .bin on an iCE40."""
        return list(self.folder.glob(f"{self.board}.bi[tn]"))


def fit(program: ChipProgram, board: Board, seeds: int, target: str = "") -> Placement:
    """Return the fastest of ``seeds`` placements of the core on a board, with its bitstream.

    ``target`` names the core, by default the usual core of the board's device. A program that does
    not fit it is refused before anything is made. All programs share the bitstream of a device,
    which is kept in the user's cache folder and placed by one process at a time. The log names each
    step that takes seconds, with the time that remains. A missing tool is an ``InputError``, a
    device without room for the core a :class:`NoRoomError`.
    """
    device = chip(target or board.target)
    assert device.open_core is not None  # it is the target of a board
    # Recordings as long as the longest phase; a phase of no fixed length (None) counts as one step.
    rows = max(phase.steps or 1 for phase in program.phases)
    on_core(program, rows, device)
    files = board_files(device.open_core, board.name, board_sources(board, device.name))
    # The name of the folder depends on the content of all files, so another version of the core has
    # a folder of its own.
    content = repr(sorted(files.items())).encode()
    folder = cache_path(f"fit-{hashlib.sha256(content).hexdigest()[:16]}")
    lock = cache_path(f"{folder.name}.lock")
    _log_if_locked(lock)
    with locked(lock, wait=True):
        # Files that exist are not written again: with a new date, make would take all it has made
        # for out of date.
        write_build(folder, {} if (folder / "Makefile").exists() else files)
        return _make_placement(_Build(folder, board, seeds), device.name)


def _log_if_locked(lock: Path) -> None:
    """Log that another process holds the lock, so that the user knows what is waited for."""
    if not lock.exists() or sys.platform == "win32":
        return
    with locked(lock) as is_free:
        if not is_free:
            _log.info("waiting for another process, which places the same core")


def _make_placement(build: _Build, device: str) -> Placement:
    """Make what the folder lacks, and return the fastest placement with its bitstream."""
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
        clocks_mhz=tuple(_clock_mhz(build, number) for number in range(1, build.placements + 1)),
        seed=seed,
        tools=versions,
        file_name=bitstream.name,
        bitstream=bitstream.read_bytes(),
    )


def _versions(build: _Build) -> dict[str, str]:
    """Return the version of each tool.

    The first start of a tool that pip installed unpacks it, which takes minutes, so every tool is
    named in the log first.
    """
    tools = build.make("tools").split()
    versions = {}
    for number, tool in enumerate(tools, 1):
        _log.info(
            "starting %s, tool %d of %d: its first start unpacks it, a minute or two",
            tool,
            number,
            len(tools),
        )
        output = run_tool([tool, "--version"], build.folder, build.where)
        # A tool that unpacks itself says so first.
        versions[tool] = output.splitlines()[-1]
    return versions


def _synthesise(build: _Build) -> None:
    """Make the netlist, which all placements start from."""
    if not build.is_made(f"{build.board}.json"):
        _log.info("synthesis, before placement 1 of %d", build.placements)
        build.make(f"{build.board}.json")


def _place(build: _Build) -> None:
    """Make missing placements, one by one, so that the log can say how much time remains."""
    seeds = range(1, build.placements + 1)
    missing = [seed for seed in seeds if not build.is_made(build.placement(seed))]
    start_s = time.perf_counter()
    for placed, seed in enumerate(missing):
        remaining = ""
        if placed:
            seconds_per_placement = (time.perf_counter() - start_s) / placed
            seconds = seconds_per_placement * (len(missing) - placed)
            remaining = f", about {seconds:.0f} s remain"
        _log.info("placement and timing %d of %d%s", seed, build.placements, remaining)
        try:
            build.make(build.placement(seed))
        except InputError as error:
            pin = pin_that_the_package_lacks(error.measured)
            if pin is not None:
                raise _no_pin(build, pin) from error
            # Any other failure of a placement is reported as a lack of room.
            raise _no_room(build, seed, error) from error


def pin_that_the_package_lacks(printed: str) -> str | None:
    """Return the pin that nextpnr names in its error, or None if it failed for another reason."""
    no_such_pin = _NO_SUCH_PIN.search(printed)
    if no_such_pin is None:
        return None
    return no_such_pin["ecp5"] or no_such_pin["ice40"]


def _pack(build: _Build) -> None:
    """Make the bitstream of the fastest placement.

    With more or fewer placements than before another one may be the fastest. Only then is a
    bitstream packed again, and the log says so.
    """
    packed_before = build.bitstreams() and (build.folder / build.fastest).read_text()
    build.make(build.fastest)
    fastest = (build.folder / build.fastest).read_text()
    if fastest != packed_before:
        _log.info("packing the bitstream of placement %s, the last step", fastest.strip())
    build.make("fit")


def _report(build: _Build, seed: int) -> Any:
    """Return the report of nextpnr on a placement: the parsed JSON."""
    return json.loads((build.folder / build.placement(seed)).read_text())


def _clock_mhz(build: _Build, seed: int) -> float:
    """Return the clock that a placement reaches, in MHz: the slowest of its clock domains."""
    return float(min(clock["achieved"] for clock in _report(build, seed)["fmax"].values()))


def _used(build: _Build, seed: int) -> dict[str, int]:
    """Return the cells that a placement takes, by kind; yosys counts what nextpnr does not."""
    cells = json.loads((build.folder / f"{build.board}.cells").read_text())
    used = dict(cells["design"]["num_cells_by_type"])
    used |= {name: entry["used"] for name, entry in _report(build, seed)["utilization"].items()}
    return _by_kind(used)


def _available(build: _Build, seed: int) -> dict[str, int]:
    """Return the cells that the device has, by kind."""
    utilization = _report(build, seed)["utilization"]
    return _by_kind({name: entry.get("available", 0) for name, entry in utilization.items()})


def _by_kind(cells: Mapping[str, int]) -> dict[str, int]:
    """Return the number of cells of each kind, given their numbers by the names that the tools use."""
    by_kind = {}
    for kind, beginnings in CELLS.items():
        by_kind[kind] = sum(count for name, count in cells.items() if name.startswith(beginnings))
    return by_kind


def _no_pin(build: _Build, missing_pin: str) -> InputError:
    """Return the error of a package that lacks a pin, naming the key of the description."""
    keys = [key for key, pin in build.described.pins() if pin.pin == missing_pin]
    where = ", ".join([build.where, *keys])
    what = f"package {build.described.device.package} has no pin {missing_pin}"
    return InputError(where, what, fix="Give a pin that the package has.")


def _no_room(build: _Build, seed: int, error: InputError) -> NoRoomError:
    """Return the error of a device that has no room for the core, given that of a placement."""
    measured = _too_much(build.folder / f"{build.board}-{seed}.log") or error.measured
    what = "the core cannot be placed"
    return NoRoomError(build.where, what, measured=measured, fix="Choose a larger device.")


def _too_much(log: Path) -> str:
    """Return what a device has too few of, by a placement's log: ``39 of 30 block RAMs``."""
    text = log.read_text("utf-8") if log.exists() else ""
    kinds = {
        name: kind.replace("_rams", " RAMs") for kind, names in CELLS.items() for name in names
    }
    lacking = []
    # Lines of the log such as "DP16KD:    60/   56   107%".
    for name, used, available in re.findall(r"(\w+): +(\d+)/ *(\d+) ", text):
        if int(used) > int(available):
            lacking.append(f"{int(used):,} of {int(available):,} {kinds.get(name, name)}")
    return ", ".join(lacking)
