"""List the connections of a program, by following its routes and axons from sources to synapses.

Tests compare programs that store the same connections in different ways.
"""

from __future__ import annotations


def delivered(program):
    """Return sorted rows of (source, target, (mantissa, exponent), delay), one for each synapse.

    Sources and targets are (population or input, index). Formats that hold the same weight in other bits count as equal.
    """
    compartment_of = {}
    for core in program.cores:
        for piece in core.slices:  # neighbouring compartments of one population
            for i in range(piece.size):
                compartment_of[core.number, piece.offset + i] = (piece.group, piece.start + i)
    connections = []

    def follow(source, core, axon):
        """Add the synapses that a spike of ``source`` reaches through one axon of a core."""
        axons = program.cores[core].axons
        for k in range(axons.list_start[axon], axons.list_start[axon + 1]):
            synapse_format = axons.formats[axons.format_index[k]]
            target = compartment_of[core, int(axons.target[k])]
            weight = (int(axons.mantissa[k]), synapse_format.exponent)
            connections.append((source, target, weight, int(axons.delay[k])))

    for route in program.input_routes:
        for line, core, axon in zip(route.line, route.core, route.axon, strict=True):
            follow((route.input, int(line)), int(core), int(axon))
    for core in program.cores:
        axons = core.axons
        for sender, to_core, to_axon in zip(
            axons.out_compartment, axons.out_core, axons.out_axon, strict=True
        ):
            follow(compartment_of[core.number, int(sender)], int(to_core), int(to_axon))
    return sorted(connections)
