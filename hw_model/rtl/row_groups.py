"""Find rows of a recording that can share a source of spikes, because they have the same synapses.

Usually each row (step) of a visited channel is a source of its own. A window of time hears all of
its rows by the same synapses, so they can be one source with one list, which saves memory.
locsnn_core.sv has the parameter ``GROUPS`` for it.
"""

import numpy as np

from hw_model.program.chip_program import ChipProgram

MOST_SHARED = 7
"""Binary logarithm of the most rows that share a source: ``shared`` of transpose.sv has three bits."""
Synapse = tuple[int, ...]
"""Core, target, delay, format and mantissa, as a program has them."""


def rows_together(program: ChipProgram, phase: str) -> int:
    """Return the largest k for which the rows of every group of 2^k have the same synapses.

    The groups are rows ``n 2^k`` to ``(n + 1) 2^k - 1``; k is 0 if rows cannot share.
    """
    transposed = [item for item in program.inputs_of(phase) if item.positions is not None]
    for item in transposed:
        # Rows can only be counted where each channel has lines of its own, one for each row.
        own_lines = np.arange(item.channels) * item.rows
        if item.first_lines is None or (np.sort(item.first_lines) != own_lines).any():
            return 0
    synapses = _synapses_of_lines(program, phase)
    lines = program.lines_of(phase)
    shared = MOST_SHARED
    for item in transposed:
        # A line is a row of a channel; the lines of a channel follow each other.
        of_input = synapses[lines[item.name]]
        lines_that_differ = [
            line for line in range(1, item.size) if of_input[line] != of_input[line - 1]
        ]
        rows_that_differ = [line % item.rows for line in lines_that_differ]
        # A row that differs from the row before must be the first of its group. Each channel begins
        # with a new group, at row 0.
        while any(row % (1 << shared) for row in rows_that_differ):
            shared -= 1
    return shared


def _synapses_of_lines(program: ChipProgram, phase: str) -> list[list[Synapse]]:
    """Return the synapses of every input line of a phase, sorted, so that they compare."""
    lines = program.lines_of(phase).values()
    count = sum(of_input.stop - of_input.start for of_input in lines)
    synapses: list[list[Synapse]] = [[] for _ in range(count)]
    for core in program.cores_of(phase):
        axons = core.axons
        sender = program.senders[core.number][axons.axon_of_synapse]
        is_line = (sender >= 0) & (sender < len(synapses))
        rows = np.stack(
            (sender, axons.target, axons.delay, axons.format_index, axons.mantissa), axis=1
        )
        for line, *synapse in rows[is_line].tolist():
            synapses[line].append((core.number, *synapse))
    return [sorted(of_line) for of_line in synapses]
