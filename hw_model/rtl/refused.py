"""Refuse programs that the open core cannot run, by name, before anything is built."""

from hw_model.errors import TargetError
from hw_model.mapping.graph import Phase
from hw_model.program.chip_program import ChipProgram

REGISTERS = {"charge_bits": 21, "current_bits": 23, "voltage_bits": 23}
"""The widths of registers that are fixed in the logic of the core, in bits, the sign not counted.
"""
MOST_POPULATIONS = 64
"""The most populations that are read out: ``GROUPS`` of readout.sv."""
MOST_CHANNELS = 1 << 16
"""The most channels: a word of the stream has 16 bits for them, ``in_channel`` of locsnn_core.sv.
"""
MOST_PHASES = 64
"""One more than the most phases. ``phase`` of locsnn_core.sv has six bits, and one value is left
for a first phase that has nothing to do."""


def refuse_unless(fits: bool, program: ChipProgram, what: str, measured: object) -> None:
    """Raise a ``TargetError`` that the core has no ``what``, unless the program fits.

    ``measured``: what the program has, or needs.
    """
    if not fits:
        where = f"program {program.name!r}"
        what = f"the open core has no {what}"
        raise TargetError(where, what, measured=f"{measured}", fix="Simulate it instead.")


def refuse_unplayable(program: ChipProgram) -> None:
    """Raise a ``TargetError`` for the first thing that a program needs and the core does not have."""
    for name, bits in REGISTERS.items():
        bits_of_chip = getattr(program.chip.registers, name)
        refuse_unless(bits_of_chip == bits, program, f"{name} other than {bits}", bits_of_chip)
    channels = sum(program.streams.values())
    refuse_unless(
        channels <= MOST_CHANNELS, program, f"more than {MOST_CHANNELS} channels", channels
    )
    read_out = program.readout.populations if program.readout else ()
    refuse_unless(
        len(read_out) <= MOST_POPULATIONS,
        program,
        f"readout of more than {MOST_POPULATIONS} groups",
        len(read_out),
    )
    for core in program.cores:
        # The core stores the binary logarithms of these two.
        for power in (1 - core.vmin, core.vmax + 1):
            is_power_of_two = power & (power - 1) == 0
            refuse_unless(is_power_of_two, program, "voltage limit that is not 2^k from 1", power)
    refuse_unless(
        len(program.phases) < MOST_PHASES, program, f"{MOST_PHASES} phases", len(program.phases)
    )
    starts = sorted(
        {phase.align_events for phase in program.phases if phase.align_events is not None}
    )
    refuse_unless(
        len(starts) < 2, program, "phases that start at different numbers of events", starts
    )
    for phase in program.phases:
        _refuse_phase(program, phase)


def _refuse_phase(program: ChipProgram, phase: Phase) -> None:
    """Raise a ``TargetError`` for the first thing that a phase needs and the core does not have."""
    inputs = program.inputs_of(phase.name)
    from_step = program.readout.from_step if program.readout else {}
    populations = program.columns_of(phase.name)
    begins = sorted({from_step[name] for name in populations if name in from_step})
    refuse_unless(
        len(begins) < 2, program, "readout of potentials from several steps of a phase", begins
    )
    rows = sorted({item.rows for item in inputs if item.positions is not None})
    refuse_unless(len(rows) < 2, program, "phase of transposed inputs of different lengths", rows)
    if phase.align_events is not None:
        names = sorted({item.stream for item in inputs})
        refuse_unless(
            len(names) == len(program.streams),
            program,
            "start by some of several streams",
            ", ".join(names),
        )
        late = bool(begins) and phase.axis == "time"
        refuse_unless(
            not late, program, "readout of potentials of a phase that starts late", repr(phase.name)
        )
