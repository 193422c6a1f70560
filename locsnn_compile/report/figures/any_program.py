"""The contents of a program of any arithmetic as figures, by which two builds are compared."""

from collections.abc import Mapping
from hashlib import sha256

from hw_model.program.chip_program import ChipProgram
from hw_model.targets.programs import AnyProgram, ProgramContents, kind_of
from hw_model.values import AnyArray
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
    if isinstance(program, ChipProgram):
        return program_figures(program)
    contents_of = kind_of(program).contents
    assert contents_of is not None  # only chip programs are told core by core
    return _figures(contents_of(program))


def _figures(contents: ProgramContents) -> OtherProgramFigures:
    return OtherProgramFigures(
        cores=contents.cores,
        groups={
            name: SmallGroup(group.neurons, group.synapses)
            for name, group in contents.groups.items()
        },
        contents={name: _checksum(array) for name, array in contents.arrays.items()},
    )


def _checksum(array: AnyArray) -> str:
    return sha256(array.tobytes()).hexdigest()[:12]
