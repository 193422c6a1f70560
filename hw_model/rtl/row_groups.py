"""Rows of a recording that send alike: a window of time hears all of its rows by the same synapses."""

import numpy as np

from hw_model.program.chip_program import ChipProgram

MOST_SHARED = 7
"""Binary logarithm of the most rows that share a source."""


def rows_together(program: ChipProgram, phase: str) -> int:
    """Return the largest k for which rows ``n 2^k`` to ``(n + 1) 2^k - 1`` of every channel have the same synapses."""
    lines = program.lines_of(phase)
    shared = MOST_SHARED
    inputs = [item for item in program.inputs_of(phase) if item.positions is not None]
    for item in inputs:
        if (
            item.first_lines is None
            or (np.sort(item.first_lines) != np.arange(item.channels) * item.rows).any()
        ):
            return 0
    heard: list[list[tuple[int, ...]]] = [
        [] for here in lines.values() for _ in range(here.stop - here.start)
    ]
    for core in program.cores_of(phase):
        axons = core.axons
        sender = program.senders[core.number][axons.axon_of_synapse]
        rows = np.stack(
            (sender, axons.target, axons.delay, axons.format_index, axons.mantissa), axis=1
        )
        for line, *synapse in rows[(sender >= 0) & (sender < len(heard))].tolist():
            heard[line].append((core.number, *synapse))
    for item in inputs:
        own = [sorted(each) for each in heard[lines[item.name]]]
        while any(
            row % item.rows % (1 << shared) and own[row] != own[row - 1] for row in range(item.size)
        ):
            shared -= 1
    return shared
