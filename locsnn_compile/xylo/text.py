"""A program for a Xylo as stable text, for people to read and for golden tests to compare.

Large arrays are shown by their range and a digest, so that the text changes if any value does.
"""

from hw_model.program.text import array_text, ended, program_heading
from hw_model.xylo.network import XyloPopulation
from hw_model.xylo.program import XyloProgram


def program_text(program: XyloProgram) -> str:
    """Return the text of a program: its inputs, its neurons by name, then its synapses."""
    network = program.network
    lines = program_heading(program.name, program.chip.name, program.provenance)
    lines.append(f"  inputs: {program.inputs}")
    # On the chip, the hidden populations of the network are one, so their parameters are shown once for all.
    for name, place in program.places.items():
        lines.append(f"  hidden {name}: neurons {place.start}..{place.stop - 1}")
    lines.append(f"    {_population_text(network.hidden)}")
    lines.append(f"  outputs {program.outputs}: {network.outputs.size}")
    lines.append(f"    {_population_text(network.outputs)}")
    synapses = (
        ("inputs to hidden", network.weights_in, network.shift_in),
        ("among hidden", network.weights_hidden, network.shift_hidden),
        ("hidden to outputs", network.weights_out, network.shift_out),
    )
    for ends, weights, shift in synapses:
        lines.append(f"  synapses {ends}: shift {shift}, weights {array_text(weights)}")
    return ended(lines)


def _population_text(population: XyloPopulation) -> str:
    """Return the parameters of a population by the names that they have on the chip."""
    parameters = {
        "dash_syn": population.dash_syn,
        "dash_mem": population.dash_mem,
        "threshold": population.threshold,
    }
    # Biases of a chip can be off.
    if population.bias is not None:
        parameters["bias"] = population.bias
    return ", ".join(f"{name} {array_text(values)}" for name, values in parameters.items())
