"""Programs whose registers are wider than the chip's: what they would do if nothing wrapped or clipped."""

from dataclasses import replace

from hw_model.description.chip import Chip
from hw_model.program.chip_program import ChipProgram, Core

WIDEST_BITS = 40
"""The widest registers that a chip may be described with."""
HANDY_VOLTAGE_BITS = 27
"""The widest voltages that the fast engine plays in numbers of 32 bits, whose loops are compiled already."""


def with_wide_voltages(program: ChipProgram) -> ChipProgram:
    """Return the program with voltages of :data:`HANDY_VOLTAGE_BITS` bits, and other registers as they are."""
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
    """Tell whether a core limits its voltages within their register, as a network with a floor asks for."""
    last = program.chip.registers.voltage_max
    return any(core.vmin != -last or core.vmax != last for core in program.cores)


def _on_chip(program: ChipProgram, wide: Chip) -> ChipProgram:
    cores = tuple(
        _widened(core, program.chip.registers.voltage_max, wide.registers.voltage_max)
        for core in program.cores
    )
    return replace(program, chip=wide, cores=cores)


def _widened(core: Core, end: int, wide_end: int) -> Core:
    """Return a core whose voltages end with the wider register; a limit before the ``end`` stays."""
    vmin = -wide_end if core.vmin == -end else core.vmin
    vmax = wide_end if core.vmax == end else core.vmax
    return replace(core, vmin=vmin, vmax=vmax)
