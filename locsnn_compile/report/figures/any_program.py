"""The contents of a program of any arithmetic as figures, by which two builds are compared."""

from collections.abc import Mapping
from hashlib import sha256

import numpy as np

from hw_model.spinnaker.files import spinnaker_arrays
from hw_model.spinnaker.program import SpinnakerProgram
from hw_model.targets.saved import AnyProgram
from hw_model.values import AnyArray
from hw_model.xylo.files import xylo_arrays
from hw_model.xylo.program import XyloProgram
from locsnn_compile.report.figures.entries import Entry
from locsnn_compile.report.figures.program import ProgramFigures, program_figures


class SmallGroup(Entry):
    """Neurons of a population, and the synapses onto it."""

    neurons: int
    synapses: int


class OtherProgramFigures(Entry):
    """Sizes of a program of another arithmetic; ``contents`` has a checksum of each of its arrays."""

    cores: int
    groups: Mapping[str, SmallGroup]
    contents: Mapping[str, str]

    @property
    def synapses(self) -> int:
        """Synapses of all groups."""
        return sum(group.synapses for group in self.groups.values())


def any_program_figures(program: AnyProgram) -> ProgramFigures | OtherProgramFigures:
    """Return the figures of a program."""
    if isinstance(program, SpinnakerProgram):
        return _of_spinnaker(program)
    if isinstance(program, XyloProgram):
        return _of_xylo(program)
    return program_figures(program)


def _of_spinnaker(program: SpinnakerProgram) -> OtherProgramFigures:
    network = program.network
    synapses = {population.name: 0 for population in network.populations}
    for projection in network.projections:
        synapses[projection.target] += len(projection.weight)
    return OtherProgramFigures(
        cores=max(network.cores_of(phase.name) for phase in network.phases),
        groups={
            population.name: SmallGroup(population.size, synapses[population.name])
            for population in network.populations
        },
        contents=_contents(spinnaker_arrays(network)),
    )


def _of_xylo(program: XyloProgram) -> OtherProgramFigures:
    network = program.network
    onto_hidden = np.count_nonzero(network.weights_in) + np.count_nonzero(network.weights_hidden)
    onto_outputs = np.count_nonzero(network.weights_out)
    return OtherProgramFigures(
        cores=1,
        groups={
            "hidden": SmallGroup(network.hidden.size, int(onto_hidden)),
            "outputs": SmallGroup(network.outputs.size, int(onto_outputs)),
        },
        contents=_contents(xylo_arrays(network)),
    )


def _contents(arrays: Mapping[str, AnyArray]) -> dict[str, str]:
    return {name: sha256(array.tobytes()).hexdigest()[:12] for name, array in arrays.items()}
