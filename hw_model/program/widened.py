"""Give a program wider registers than its chip has, to play what it would do if nothing wrapped or clipped.

To compare such a run with an ordinary one shows how much the register widths matter.
"""

from dataclasses import replace

from hw_model.description.chip import Chip
from hw_model.program.chip_program import ChipProgram, Core

WIDEST_BITS = 40
"""The widest registers that a chip file may describe."""
HANDY_VOLTAGE_BITS = 27
"""The widest voltages that the fast engine plays with 32-bit integers. Wider ones would take its 64-bit loops, which
may have to be compiled first."""


def with_wide_voltages(program: ChipProgram) -> ChipProgram:
    """Return the program with voltages of at least :data:`HANDY_VOLTAGE_BITS` bits, other registers unchanged."""
    registers = program.chip.registers
    voltage_bits = max(registers.voltage_bits, HANDY_VOLTAGE_BITS)
    wide = replace(program.chip, registers=replace(registers, voltage_bits=voltage_bits))
    return _on_chip(program, wide)


def with_wide_registers(program: ChipProgram) -> ChipProgram:
    """Return the program with all registers of :data:`WIDEST_BITS` bits."""
    registers = replace(
        program.chip.registers,
        charge_bits=WIDEST_BITS,
        current_bits=WIDEST_BITS,
        voltage_bits=WIDEST_BITS,
    )
    return _on_chip(program, replace(program.chip, registers=registers))


def has_voltage_limits(program: ChipProgram) -> bool:
    """Return whether a core limits its voltages more narrowly than their register does.

    A network whose neurons have a lowest voltage needs that.
    """
    last = program.chip.registers.voltage_max
    return any(core.vmin != -last or core.vmax != last for core in program.cores)


def _on_chip(program: ChipProgram, wide: Chip) -> ChipProgram:
    """Return the program for a chip with wider registers."""
    cores = tuple(
        _widened(core, program.chip.registers.voltage_max, wide.registers.voltage_max)
        for core in program.cores
    )
    return replace(program, chip=wide, cores=cores)


def _widened(core: Core, end: int, wide_end: int) -> Core:
    """Return a core with voltage limits at the ends of the wider register.

    A limit that was not at the ``end`` of the chip's register is part of the network, and stays.
    """
    vmin = -wide_end if core.vmin == -end else core.vmin
    vmax = wide_end if core.vmax == end else core.vmax
    return replace(core, vmin=vmin, vmax=vmax)
