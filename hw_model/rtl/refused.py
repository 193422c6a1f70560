"""What the open core cannot run, told by name before anything is built."""

from hw_model.errors import TargetError
from hw_model.mapping.graph import Phase
from hw_model.program.chip_program import ChipProgram

REGISTERS = {"charge_bits": 21, "current_bits": 23, "voltage_bits": 23}
"""Widths that are fixed in its logic, the sign not counted."""
MOST_POPULATIONS, MOST_CHANNELS = 16, 1 << 16


def refuse_unless(fits: bool, program: ChipProgram, what: str, found: object) -> None:
    """Raise a ``TargetError`` that names what the core does not have, and what a program asks for."""
    if not fits:
        raise TargetError(
            f"program {program.name!r}", f"the open core has no {what}", measured=f"{found}", fix="Simulate it instead."
        )


def phases_of(program: ChipProgram) -> tuple[Phase | None, Phase | None]:
    """Return the phase that hears recordings as they come and the one behind the transpose buffer; refuse the rest."""
    for name, bits in REGISTERS.items():
        found = getattr(program.chip.registers, name)
        refuse_unless(found == bits, program, f"{name} other than {bits}", found)
    channels = sum(program.streams.values())
    refuse_unless(channels <= MOST_CHANNELS, program, f"more than {MOST_CHANNELS} channels", channels)
    read = program.readout.populations if program.readout else ()
    refuse_unless(len(read) <= MOST_POPULATIONS, program, f"readout of more than {MOST_POPULATIONS} groups", len(read))
    refuse_unless(len(set(read)) == len(read), program, "readout of a group twice", ", ".join(read))
    first = sorted(set(program.readout.from_step.values())) if program.readout else []
    refuse_unless(len(first) < 2, program, "readout of potentials from several steps", first)
    for core in program.cores:
        for power in (1 - core.vmin, core.vmax + 1):
            refuse_unless(power & (power - 1) == 0, program, "voltage limit that is not 2^k from 1", power)
    phases: dict[bool, list[Phase]] = {False: [], True: []}
    for phase in program.phases:
        kinds = {item.positions is not None for item in program.inputs_of(phase.name)}
        aligned = phase.align_events
        refuse_unless(aligned is None, program, "phase that starts at the first touch", f"align_events {aligned}")
        refuse_unless(len(kinds) < 2, program, "phase of direct and transposed inputs", repr(phase.name))
        phases[kinds == {True}].append(phase)
    for kind, several in (("direct", phases[False]), ("transposed", phases[True])):
        names = ", ".join(repr(phase.name) for phase in several)
        refuse_unless(len(several) < 2, program, f"second {kind} phase", names)
    return next(iter(phases[False]), None), next(iter(phases[True]), None)


def kept_rows(program: ChipProgram, turned: Phase | None, heard: int | None) -> int:
    """Return the rows of a recording that the transpose buffer keeps: equally many of every input, all heard."""
    rows = {item.rows for item in program.inputs_of(turned.name)} if turned else {0}
    refuse_unless(len(rows) == 1, program, "transpose buffer of inputs of different lengths", sorted(rows))
    (kept,) = rows
    fits = heard is None or kept <= heard
    refuse_unless(fits, program, "step of a recording after the direct phase", f"{kept} against {heard}")
    return kept
