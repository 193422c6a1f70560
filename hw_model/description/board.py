"""A board description: device, clock, serial line and pins, read from YAML."""

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
"""Packages by family and size, as nextpnr calls them."""
TARGETS = {
    "ecp5": {"12k": "ecp5-25f", "25k": "ecp5-25f", "45k": "ecp5-25f", "85k": "ecp5-85f"},
    "ice40": {"up5k": "ice40up5k"},
}
"""The core that each device is given where a program has none."""
USUAL_BAUD = 1_000_000
CYCLES_PER_BIT = 8
"""The fewest cycles of the core's clock that the serial line needs per bit: ``BIT`` of uart_rx.sv."""
_NAME = re.compile(r"[a-z0-9][a-z0-9-]{0,39}")
# It goes into comments of files that tools read, where the end of a line would end the comment.
_DESCRIPTION = re.compile(r"[A-Za-z0-9 ,.()/+-]{1,100}")
_SITE = re.compile(r"[A-Z]{0,2}[0-9]{1,3}")
# The clock of the core is called clk and its frequency: no pin may be.
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
"""Names in the top of a board, beside that of the clock: ``clk`` and a number."""
_BAUD_ERROR = 0.02
"""Share by which the board's bits may be off: half of the 4 % that uart_rx.sv takes, for the host may be off too."""


class Pin(Frozen):
    """A pin of the device, its electrical settings, and the level at which its signal is on."""

    pin: str
    active: Annotated[str, ("high", "low")] = "high"
    pull: Annotated[str, ("none", "up", "down")] = "none"
    drive_ma: Annotated[int | None, (4, 8, 12, 16)] = None
    standard: Annotated[str, ("LVCMOS33", "LVCMOS25", "LVCMOS18", "LVCMOS15", "LVCMOS12")] = (
        "LVCMOS33"
    )

    @staticmethod
    def from_plain(plain: Any) -> Any:
        """Return the mapping that a site alone stands for; sites of some packages are numbers."""
        if isinstance(plain, str | int) and not isinstance(plain, bool):
            return {"pin": str(plain)}
        if isinstance(plain, dict) and type(plain.get("pin")) is int:
            return {**plain, "pin": str(plain["pin"])}
        return plain


class Device(Frozen):
    """The device in words of nextpnr; only an ECP5 has a speed grade, 6 if none is given."""

    family: Annotated[str, tuple(PACKAGES)]
    size: str
    package: str
    speed: Annotated[int | None, between(6, 8)] = None


class Clock(Frozen):
    """The clock of the board, and that of the core, which a PLL makes if it is another."""

    pin: Pin
    mhz: Annotated[float, between(1, 400)]
    core_mhz: Annotated[float | None, between(1, 400)] = None

    @property
    def core(self) -> float:
        """Frequency of the core in MHz."""
        return self.mhz if self.core_mhz is None else self.core_mhz


class Serial(Frozen):
    """Pins of the serial line, as the device sees it, and its bits per second."""

    rx: Pin
    tx: Pin
    baud: Annotated[int, between(300, 12_000_000)] = USUAL_BAUD


class Leds(Frozen):
    """Lights: a program is there; a recording runs; turns with every answer; an error since reset."""

    loaded: Pin | None = None
    running: Pin | None = None
    answered: Pin | None = None
    failed: Pin | None = None


class Board(Frozen):
    """A board for the open core, as ``hw_model/boards/*.yaml`` describes it."""

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
        """Name of the target whose core the device takes, unless a program was compiled for another."""
        return TARGETS[self.device.family][self.device.size]

    @property
    def targets(self) -> tuple[str, ...]:
        """Names of the targets whose core its family takes."""
        return tuple(TARGETS[self.device.family].values())

    @property
    def lights(self) -> Mapping[str, Pin]:
        """The LEDs that there are, by what they show."""
        return {name: pin for name, pin in vars(self.leds).items() if pin is not None}

    def pins(self) -> Iterator[tuple[str, Pin]]:
        """Yield every pin with its key."""
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

    What cannot be read or is not possible on the device is an ``InputError``.
    """
    if name_or_path in BOARDS:
        text = (files("hw_model") / "boards" / f"{name_or_path}.yaml").read_text("utf-8")
        return parse_board(text, name_or_path)
    path = Path(name_or_path)
    described = parse_board(read_description(path, "board", "the example of the manual"), path.name)
    if described.name in BOARDS:
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
    dividers = ecp5_pll if described.device.family == "ecp5" else ice40_pll
    dividers(clock.mhz, clock.core, f"{where}: clock.core_mhz")


def _check_pins(described: Board, where: str) -> None:
    """Refuse sites that are none or used twice, and settings that the family does not have."""
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
    settings = {
        "drive_ma": pin.drive_ma is not None,
        "pull: down": pin.pull == "down",
        "standard": pin.standard != "LVCMOS33",
    }
    for name, is_set in settings.items():
        if is_set:
            raise InputError(place, f"a pin of an iCE40 has no {name!r}", fix="Leave it out.")


def _check_baud(described: Board, where: str) -> None:
    """Refuse a line that is too fast for the clock, or whose bits are not whole cycles by far."""
    place = f"{where}: serial.baud"
    baud = described.serial.baud
    core_hz = described.clock.core * 1e6
    highest = int(core_hz / CYCLES_PER_BIT)
    if baud > highest:
        what = f"it is too fast for a core of {described.clock.core:g} MHz"
        measured = f"{baud} against {highest} bits per second"
        raise InputError(place, what, measured=measured, fix="Lower it.")
    cycles_per_bit = int(core_hz / baud + 0.5)
    actual = core_hz / cycles_per_bit
    if abs(actual / baud - 1) > _BAUD_ERROR:
        what = f"a core of {described.clock.core:g} MHz cannot keep it"
        measured = f"{actual:.0f} against {baud} bits per second, more than 2 % apart"
        raise InputError(place, what, measured=measured, fix=f"Give {actual:.0f} or a lower rate.")
