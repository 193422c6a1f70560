"""Boards that the open core can be placed on: FPGA, clock, serial line and pins, read from YAML.

A description is checked before any tool runs, so that a mistake in a file is one message that names
its key. The files of boards that ship lie in ``hw_model/boards``.
"""

import re
from collections.abc import Iterator, Mapping
from dataclasses import field
from importlib.resources import files
from pathlib import Path
from typing import Annotated, Any

from hw_model.description.boards import BOARDS
from hw_model.description.pll import ecp5_pll, ice40_pll
from hw_model.description.read import parse, read_description
from hw_model.errors import InputError, check_known
from hw_model.io.records import Must, between
from hw_model.values import Frozen

PACKAGES: dict[str, dict[str, tuple[str, ...]]] = {
    "ecp5": {
        "12k": ("TQFP144", "CABGA256", "CSFBGA285", "CABGA381"),
        "25k": ("TQFP144", "CABGA256", "CSFBGA285", "CABGA381"),
        "45k": ("TQFP144", "CABGA256", "CSFBGA285", "CABGA381", "CABGA554"),
        "85k": ("CSFBGA285", "CABGA381", "CABGA554", "CABGA756"),
    },
    "ice40": {"up5k": ("sg48", "uwg30")},
}
"""Packages of FPGAs, by family and size, in the words of nextpnr."""
TARGETS = {
    "ecp5": {"12k": "ecp5-25f", "25k": "ecp5-25f", "45k": "ecp5-25f", "85k": "ecp5-85f"},
    "ice40": {"up5k": "ice40up5k"},
}
"""The target whose core an FPGA gets, by family and size, unless a program was compiled for another
one.

A 45k, for which there is no core of its own, gets the core of the 25k.
"""
USUAL_BAUD = 1_000_000
"""Bits per second of the serial line, unless a board gives another rate."""
CYCLES_PER_BIT = 8
"""The fewest cycles of the core's clock per bit of the serial line: ``BIT`` of uart_rx.sv is at
least this."""
_NAME = re.compile(r"[a-z0-9][a-z0-9-]{0,39}")
# A description goes into comments of generated files, so it must not hold the end of a line.
_DESCRIPTION = re.compile(r"[A-Za-z0-9 ,.()/+-]{1,100}")
_SITE = re.compile(r"[A-Z]{0,2}[0-9]{1,3}")
# The port of the board's clock is called clk and its frequency, so no other pin may have such a
# name.
_HELD_NAME = re.compile(r"[a-z](?!lk[0-9])[a-z0-9_]{0,39}")
_SIGNALS = {
    "clk",
    "locked",
    "shown",
    "same",
    "board",
    "pll",
    "rx",
    "tx",
    "leds",
    "button",
    "button_n",
}
"""Names in the top module of a board (``boards/top.sv.in``), which pins of a user must not have."""
_BAUD_ERROR = 0.02
"""The share by which the board's rate may be off: half of the 4 % that uart_rx.sv tolerates, as the
host may be off too."""


class Pin(Frozen):
    """A pin of the FPGA, its electrical settings, and the level that means on (``active``).

    A file may give just the name of the pin, in place of a mapping.
    """

    pin: str
    active: Annotated[str, ("high", "low")] = "high"
    pull: Annotated[str, ("none", "up", "down")] = "none"
    drive_ma: Annotated[int | None, (4, 8, 12, 16)] = None
    standard: Annotated[str, ("LVCMOS33", "LVCMOS25", "LVCMOS18", "LVCMOS15", "LVCMOS12")] = (
        "LVCMOS33"
    )

    @staticmethod
    def from_plain(plain: Any) -> Any:
        """Return the mapping that the name of a pin alone stands for.

        YAML reads the pins of some packages as numbers, which become names here.
        """
        if isinstance(plain, str | int) and not isinstance(plain, bool):
            return {"pin": str(plain)}
        if isinstance(plain, dict) and type(plain.get("pin")) is int:
            return {**plain, "pin": str(plain["pin"])}
        return plain


class Device(Frozen):
    """The FPGA, in the words of nextpnr. Only an ECP5 has a speed grade; it is 6 if none is given."""

    family: Annotated[str, tuple(PACKAGES)]
    size: str
    package: str
    speed: Annotated[int | None, between(6, 8)] = None


class Clock(Frozen):
    """The clock of the board, and the frequency of the core if a PLL makes another one."""

    pin: Pin
    mhz: Annotated[float, between(1, 400)]
    core_mhz: Annotated[float | None, between(1, 400)] = None

    @property
    def core(self) -> float:
        """The frequency of the core in MHz."""
        return self.mhz if self.core_mhz is None else self.core_mhz


class Serial(Frozen):
    """The pins of the serial line, where the FPGA receives on ``rx``, and its bits per second."""

    rx: Pin
    tx: Pin
    baud: Annotated[int, between(300, 12_000_000)] = USUAL_BAUD


class Leds(Frozen):
    """The lights of a board, which are on or change as follows; a board may lack any of them.

    - ``loaded``: a program is loaded
    - ``running``: a recording runs
    - ``answered``: toggles with every answer
    - ``failed``: there was an error since the reset
    """

    loaded: Pin | None = None
    running: Pin | None = None
    answered: Pin | None = None
    failed: Pin | None = None


class Board(Frozen):
    """A board for the open core, as ``hw_model/boards/*.yaml`` describes it.

    - ``reset``: the pin of a button that resets the core; None if there is none
    - ``held_high``: pins that the top module drives high all the time, by a name of the user's
      choice, such as the enable of another chip on the board
    """

    name: Annotated[str, Must(_NAME.fullmatch, "of a-z, 0-9 and '-', at most 40 characters")]
    device: Device
    clock: Clock
    serial: Serial
    leds: Leds = Leds()
    reset: Pin | None = None
    held_high: Mapping[str, Pin] = field(default_factory=dict)
    description: Annotated[
        str,
        Must(_DESCRIPTION.fullmatch, "of letters, digits and ' ,.()/+-', at most 100 characters"),
    ] = "a board"

    @property
    def target(self) -> str:
        """The target whose core the FPGA gets, unless a program was compiled for another."""
        return TARGETS[self.device.family][self.device.size]

    @property
    def targets(self) -> tuple[str, ...]:
        """The names of all targets whose cores are for the FPGA's family."""
        return tuple(TARGETS[self.device.family].values())

    @property
    def lights(self) -> Mapping[str, Pin]:
        """The pins of the lights that the board has, by what they show."""
        return {name: pin for name, pin in vars(self.leds).items() if pin is not None}

    def pins(self) -> Iterator[tuple[str, Pin]]:
        """Yield every pin of the board with its key in the description."""
        yield "clock.pin", self.clock.pin
        yield "serial.rx", self.serial.rx
        yield "serial.tx", self.serial.tx
        for name, pin in self.lights.items():
            yield f"leds.{name}", pin
        if self.reset is not None:
            yield "reset", self.reset
        for name, pin in self.held_high.items():
            yield f"held_high.{name}", pin


def board(name_or_path: str) -> Board:
    """Return a board, given the name of a description that ships or the path of a YAML file.

    Raise an ``InputError`` if the file cannot be read, or describes what its FPGA cannot do.
    """
    if name_or_path in BOARDS:
        text = (files("hw_model") / "boards" / f"{name_or_path}.yaml").read_text("utf-8")
        return parse_board(text, name_or_path)
    path = Path(name_or_path)
    described = parse_board(read_description(path, "board", "the example of the manual"), path.name)
    if described.name in BOARDS:
        # Commands would take the name for the board that ships.
        what = f"a board of the name {described.name!r} ships"
        raise InputError(f"{path.name}: name", what, fix="Give it another name.")
    return described


def parse_board(text: str, where: str) -> Board:
    """Return the board that a YAML text describes; ``where`` names it in errors."""
    described = parse(Board, text, where, like="a board that ships")
    _check_device(described.device, where)
    _check_clock(described, where)
    _check_pins(described, where)
    _check_baud(described, where)
    return described


def _check_device(device: Device, where: str) -> None:
    """Refuse sizes and packages that the family does not have, and a speed grade of an iCE40."""
    sizes = PACKAGES[device.family]
    what = f"the core cannot go to {device.family} of the size {device.size!r}"
    check_known(f"{where}: device.size", what, device.size, sizes)
    packages = sizes[device.size]
    what = f"{device.size} has no package {device.package!r}"
    check_known(f"{where}: device.package", what, device.package, packages)
    if device.family == "ice40" and device.speed is not None:
        what = "an iCE40 has no speed grade"
        raise InputError(f"{where}: device.speed", what, fix="Leave it out.")


def _check_clock(described: Board, where: str) -> None:
    """Refuse a frequency that the PLL cannot make."""
    clock = described.clock
    if clock.core == clock.mhz:
        return
    # Only the error matters here: board_sources.py computes the dividers again.
    find_dividers = ecp5_pll if described.device.family == "ecp5" else ice40_pll
    find_dividers(clock.mhz, clock.core, f"{where}: clock.core_mhz")


def _check_pins(described: Board, where: str) -> None:
    """Refuse names that are no pin or used twice, and settings that the family does not have.

    Whether the package has a pin is left to nextpnr, which knows all packages.
    """
    for name in described.held_high:
        if not _HELD_NAME.fullmatch(str(name)) or name in _SIGNALS:
            fix = "Give a name of a-z, 0-9 and '_', which no other signal has."
            raise InputError(f"{where}: held_high", f"{name!r} is no name for a pin", fix=fix)
    keys_by_site: dict[str, str] = {}
    for key, pin in described.pins():
        place = f"{where}: {key}"
        if not _SITE.fullmatch(pin.pin):
            fix = "Give a site of the package, such as G2 or 35."
            raise InputError(place, f"{pin.pin!r} is not a pin", fix=fix)
        if pin.pin in keys_by_site:
            what = f"pin {pin.pin} is that of {keys_by_site[pin.pin]} already"
            raise InputError(place, what, fix="Give each signal a pin of its own.")
        keys_by_site[pin.pin] = key
        if pin.active == "low" and key != "reset" and not key.startswith("leds."):
            what = "only a light or the reset can be active low"
            raise InputError(place, what, fix="Leave 'active' out.")
        if described.device.family == "ice40":
            _check_ice40_pin(pin, place)


def _check_ice40_pin(pin: Pin, place: str) -> None:
    """Refuse settings that a pin of an iCE40 does not have."""
    settings = {
        "drive_ma": pin.drive_ma is not None,
        "pull: down": pin.pull == "down",
        "standard": pin.standard != "LVCMOS33",
    }
    for name, is_set in settings.items():
        if is_set:
            raise InputError(place, f"a pin of an iCE40 has no {name!r}", fix="Leave it out.")


def _check_baud(described: Board, where: str) -> None:
    """Refuse a rate that is too fast for the core's clock, or that it cannot make closely."""
    place = f"{where}: serial.baud"
    baud = described.serial.baud
    core_hz = described.clock.core * 1e6
    highest = int(core_hz / CYCLES_PER_BIT)
    if baud > highest:
        what = f"it is too fast for a core of {described.clock.core:g} MHz"
        measured = f"{baud} against {highest} bits per second"
        raise InputError(place, what, measured=measured, fix="Lower it.")
    cycles_per_bit = int(core_hz / baud + 0.5)  # rounded, as top_uart.sv does
    actual = core_hz / cycles_per_bit
    if abs(actual / baud - 1) > _BAUD_ERROR:
        what = f"a core of {described.clock.core:g} MHz cannot keep it"
        measured = f"{actual:.0f} against {baud} bits per second, more than 2 % apart"
        raise InputError(place, what, measured=measured, fix=f"Give {actual:.0f} or a lower rate.")
