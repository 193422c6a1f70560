"""Summarise a program for any chip as figures, so that ``locsnn diff`` can say how two builds differ.

Programs for the mesh and the open core have detailed figures (``figures/program.py``). Programs for chips
with an arithmetic of their own, such as Xylo and SpiNNaker, have the sizes and checksums of this module.
"""

from collections.abc import Mapping
from hashlib import sha256

from hw_model.program.chip_program import ChipProgram
from hw_model.targets.programs import AnyProgram, ProgramContents, kind_of
from hw_model.values import AnyArray
from locsnn_compile.report.figures.entries import Entry
from locsnn_compile.report.figures.program import ProgramFigures, program_figures


class SmallGroup(Entry):
    """The number of neurons of a population, and of synapses onto it."""

    neurons: int
    synapses: int


class OtherProgramFigures(Entry):
    """Sizes of a program for a chip with its own arithmetic; ``contents`` has a checksum of each array."""

    cores: int
    groups: Mapping[str, SmallGroup]
    contents: Mapping[str, str]

    @property
    def synapses(self) -> int:
        """Synapses of all groups."""
        return sum(group.synapses for group in self.groups.values())


def any_program_figures(program: AnyProgram) -> ProgramFigures | OtherProgramFigures:
    """Return the figures of a program, by which it is compared with another."""
    if isinstance(program, ChipProgram):
        return program_figures(program)
    contents_of = kind_of(program).contents
    # Every kind of program except ChipProgram, which is handled above, lists its arrays.
    assert contents_of is not None
    return _figures(contents_of(program))


def _figures(contents: ProgramContents) -> OtherProgramFigures:
    """Return the figures that any program has: its cores, its groups and a checksum of each array."""
    return OtherProgramFigures(
        cores=contents.cores,
        groups={
            name: SmallGroup(group.neurons, group.synapses)
            for name, group in contents.groups.items()
        },
        contents={name: _checksum(array) for name, array in contents.arrays.items()},
    )


def _checksum(array: AnyArray) -> str:
    """Return a checksum short enough to read: 12 digits are 48 bits, enough to tell versions of an array apart."""
    return sha256(array.tobytes()).hexdigest()[:12]
