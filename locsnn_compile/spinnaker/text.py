"""A program for SpiNNaker as stable text, for people to read and for golden tests to compare.

Large arrays are shown by their range and a digest, so that the text changes if any value does. The words in the lines
are explained at :class:`hw_model.spinnaker.network.SpinnakerPopulation`.
"""

from hw_model.program.text import array_text, ended, program_heading
from hw_model.spinnaker.network import SpinnakerPopulation
from hw_model.spinnaker.program import SpinnakerProgram


def program_text(program: SpinnakerProgram) -> str:
    """Return the text of a program: phases, inputs, populations, projections."""
    network = program.network
    lines = program_heading(program.name, program.chip.name, program.provenance)
    for phase in network.phases:
        steps = "open" if phase.steps is None else phase.steps
        lines.append(f"  phase {phase.name}: axis {phase.axis}, steps {steps}")
        for item in network.inputs_of(phase.name):
            lines.append(f"    input {item.name}: {item.size} lines of {item.stream}")
        for population in network.populations_of(phase.name):
            lines += _population_lines(population)
        for projection in network.projections_of(phase.name):
            lines.append(f"    {projection.called}:")
            lines.append(f"      weight {array_text(projection.weight)}")
            lines.append(f"      delay {array_text(projection.delay)}")
    return ended(lines)


def _population_lines(population: SpinnakerPopulation) -> list[str]:
    """Return the lines of a population: its size and cores, its units, and a line per parameter."""
    core_use = f"{population.neurons_per_core} a core, {population.slots} slots"
    parameters = population.parameters._asdict()
    return [
        f"    population {population.name}: {population.size} neurons, {core_use}",
        f"      shifts {population.shifts}, weight {population.weight_unit:g} nA, "
        f"potential {population.potential_unit:g} mV",
        *(f"      {name} {array_text(values)}" for name, values in parameters.items()),
    ]
