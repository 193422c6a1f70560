"""What a program delivers, followed from every line and compartment to its synapses."""

from __future__ import annotations


def delivered(program):
    """Follow every line and compartment to its synapses: sorted (source, target, effective weight, delay)."""
    name_of = {}
    for core in program.cores:
        for piece in core.slices:
            for i in range(piece.size):
                name_of[core.number, piece.offset + i] = (piece.group, piece.start + i)
    found = []

    def follow(source, core, axon):
        axons = program.cores[core].axons
        for k in range(axons.list_start[axon], axons.list_start[axon + 1]):
            form = axons.formats[axons.format_index[k]]
            weight = (int(axons.mantissa[k]), form.exponent, form.weight_bits, form.sign_mode)
            found.append((source, name_of[core, int(axons.target[k])], weight, int(axons.delay[k])))

    for route in program.input_routes:
        for line, core, axon in zip(route.line, route.core, route.axon, strict=True):
            follow((route.input, int(line)), int(core), int(axon))
    for core in program.cores:
        axons = core.axons
        for sender, to_core, to_axon in zip(
            axons.out_compartment, axons.out_core, axons.out_axon, strict=True
        ):
            follow(name_of[core.number, int(sender)], int(to_core), int(to_axon))
    return sorted((s, t, w[:2], d) for s, t, w, d in found)
