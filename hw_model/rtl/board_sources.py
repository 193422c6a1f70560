"""Write the files that put the open core on a board, from the board's description.

These are the top module, which connects pins, clock and reset to ``top_uart.sv``; the constraints,
which give every port its pin (an LPF file for an ECP5, a PCF file for an iCE40); and the variables
of make. The templates lie in ``boards/``.
"""

from collections.abc import Callable
from fractions import Fraction
from importlib.resources import files
from string import Template

from hw_model.description.board import USUAL_BAUD, Board, Pin
from hw_model.description.pll import ecp5_pll, ice40_pll
from hw_model.values import Frozen

MEMORY_BLOCKS = {"ecp5-85f": 16384}
"""Bits of a block RAM, for cores whose memories are cut into slices of one block each: memory.sv
says why."""
_LIGHTS = ("loaded", "running", "answered", "failed")
"""What the four lights of ``top_uart.sv`` show, from bit 0 on."""
_PLL_PADS = {"sg48": "35"}
"""By package of an iCE40, the pin that is wired to the PLL; a clock on any other pin takes another
cell."""


class Port(Frozen):
    """A port of the top module, or a bit of one, and its pin."""

    signal: str
    pin: Pin


class ClockSource(Frozen):
    """The clock of the core: its exact frequency, and the SystemVerilog that makes it."""

    mhz: Fraction
    text: str


def board_sources(board: Board, target: str) -> dict[str, str]:
    """Return the files of a board by name: top module, constraints, and variables of make.

    ``target`` names the chip whose core the board gets.
    """
    constraints = f"{board.name}.{'lpf' if board.device.family == 'ecp5' else 'pcf'}"
    return {
        f"{board.name}.top.sv": _top(board),
        constraints: _CONSTRAINTS[board.device.family](board),
        f"{board.name}.board.mk": _rules(board, target, constraints),
    }


def _template(name: str) -> Template:
    return Template((files("hw_model") / "rtl" / "boards" / f"{name}.in").read_text("utf-8"))


def clock_port(board: Board) -> str:
    """Return the name of the clock's port, which holds the frequency in MHz, such as ``clk25``."""
    return f"clk{board.clock.mhz:g}".replace(".", "_")


def _reset_port(pin: Pin) -> str:
    return "button_n" if pin.active == "low" else "button"


def _light_ports(board: Board) -> list[Port]:
    """Return the ports of the LEDs: bits of a vector or, for a single LED, a port of one bit."""
    pins = list(board.lights.values())
    if len(pins) == 1:
        return [Port("leds", pins[0])]
    return [Port(f"leds[{number}]", pin) for number, pin in enumerate(pins)]


def _ports(board: Board) -> list[Port]:
    """Return all ports of the top module, in the order in which the constraints list them."""
    ports = [
        Port(clock_port(board), board.clock.pin),
        Port("rx", board.serial.rx),
        Port("tx", board.serial.tx),
    ]
    if board.reset is not None:
        ports.append(Port(_reset_port(board.reset), board.reset))
    ports += _light_ports(board)
    ports += [Port(name, pin) for name, pin in board.held_high.items()]
    return ports


def _top(board: Board) -> str:
    """Return the top module."""
    source = clock_source(board)
    baud = board.serial.baud
    reset = "!locked"
    if board.reset is not None:
        level = "!" if board.reset.active == "low" else ""
        reset = f"{level}{_reset_port(board.reset)} || !locked"
    return _template("top.sv").substitute(
        description=board.description,
        baud=baud,
        # The usual rate is the default of top_uart.sv. Naming it would rename the module in the
        # netlist, and what a placement reaches depends on names.
        rate="" if baud == USUAL_BAUD else f".BAUD({baud}), ",
        pll=source.text,
        reset=reset,
        ports=",\n    ".join(_declarations(board)),
        held="".join(f"    assign \\{name}  = 1;\n" for name in board.held_high),
        clock=f"{board.clock.mhz:g} MHz in, {float(source.mhz):g} MHz for the core",
        hertz=round(source.mhz * 1_000_000),
        lights="\n".join(_light_assignments(board)),
    )


def _declarations(board: Board) -> list[str]:
    """Return the declarations of the ports of the top module."""
    inputs = [clock_port(board), "rx"]
    if board.reset is not None:
        inputs.append(_reset_port(board.reset))
    declarations = [f"input  logic {name}" for name in inputs]
    declarations.append("output logic tx")
    lights = len(board.lights)
    if lights == 1:
        declarations.append("output logic leds")
    elif lights:
        declarations.append(f"output logic [{lights - 1}:0] leds")
    # Escaped names, as the user's name of a pin may be a keyword of SystemVerilog.
    declarations += [f"output logic \\{name} " for name in board.held_high]
    return declarations


def _level(signal: str, pin: Pin) -> str:
    """Return the expression of a signal, inverted for a pin that is active low."""
    return f"!{signal}" if pin.active == "low" else signal


def _light_assignments(board: Board) -> list[str]:
    """Return a line per LED that the board has, which assigns it one of the four lights."""
    lines = []
    for port, light in zip(_light_ports(board), board.lights, strict=True):
        level = _level(f"shown[{_LIGHTS.index(light)}]", port.pin)
        lines.append(f"    assign {port.signal} = {level};")
    return lines


def clock_source(board: Board) -> ClockSource:
    """Return the clock of the core: that of the board, or from the PLL of the family."""
    name = clock_port(board)
    clock = board.clock
    if clock.core == clock.mhz:
        text = _template("pll_none.sv").substitute(input=name)
        # By its decimals: 12.1 is not exactly a binary fraction.
        return ClockSource(Fraction(repr(clock.mhz)), text.rstrip())
    if board.device.family == "ecp5":
        return _ecp5_clock(board)
    return _ice40_clock(board)


def _ecp5_clock(board: Board) -> ClockSource:
    pll = ecp5_pll(board.clock.mhz, board.clock.core, board.name)
    text = _template("pll_ecp5.sv").substitute(
        input=clock_port(board),
        reference=pll.reference,
        feedback=pll.feedback,
        feedback_phase=_phase(pll.feedback),
        output=pll.output,
        output_phase=_phase(pll.output),
    )
    return ClockSource(pll.output_mhz, text.rstrip())


def _phase(divider: int) -> int:
    """Return the coarse phase of an ECP5's PLL output whose first edge is mid-period."""
    return max(divider // 2 - 1, 0)


def _ice40_clock(board: Board) -> ClockSource:
    pll = ice40_pll(board.clock.mhz, board.clock.core, board.name)
    on_pad = _PLL_PADS.get(board.device.package) == board.clock.pin.pin
    text = _template("pll_ice40.sv").substitute(
        cell="SB_PLL40_PAD" if on_pad else "SB_PLL40_CORE",
        port="PACKAGEPIN" if on_pad else "REFERENCECLK",
        input=clock_port(board),
        divr=pll.divr,
        divf=pll.divf,
        divq=pll.divq,
        filter=pll.filter_range,
    )
    return ClockSource(pll.output_mhz, text.rstrip())


def _rules(board: Board, target: str, constraints: str) -> str:
    """Return the variables of make: the device, its part, and the names of the other files."""
    block = MEMORY_BLOCKS.get(target)
    return _template("board.mk").substitute(
        description=board.description,
        device=target,
        part=_part(board),
        defines=f"-DMEMORY_BLOCK={block}" if block else "",
        name=board.name,
        constraints=constraints,
        family=board.device.family,
    )


def _part(board: Board) -> str:
    """Return the options of nextpnr that name the device."""
    device = board.device
    part = f"--{device.size} --package {device.package}"
    if device.family == "ecp5":
        return f"{part} --speed {device.speed or 6}"
    return f"{part} --freq {board.clock.core:g}"


def _lpf(board: Board) -> str:
    """Return the constraints of an ECP5, in the format LPF."""
    lines = [
        f"# Pins of {board.description}.",
        f'FREQUENCY PORT "{clock_port(board)}" {board.clock.mhz:g} MHZ;',
    ]
    for port in _ports(board):
        settings = f"IO_TYPE={port.pin.standard}"
        if port.pin.pull != "none":
            settings += f" PULLMODE={port.pin.pull.upper()}"
        if port.pin.drive_ma is not None:
            settings += f" DRIVE={port.pin.drive_ma}"
        lines.append(f'LOCATE COMP "{port.signal}" SITE "{port.pin.pin}";')
        lines.append(f'IOBUF PORT "{port.signal}" {settings};')
    return "\n".join(lines) + "\n"


def _pcf(board: Board) -> str:
    """Return the constraints of an iCE40, in the format PCF."""
    lines = [f"# Pins of {board.description}."]
    for port in _ports(board):
        pull = "-pullup yes " if port.pin.pull == "up" else ""
        lines.append(f"set_io {pull}{port.signal} {port.pin.pin}")
    return "\n".join(lines) + "\n"


_CONSTRAINTS: dict[str, Callable[[Board], str]] = {"ecp5": _lpf, "ice40": _pcf}
