"""Programs of all kinds of chips, in one table: how each kind is read from files and played.

Chips with another arithmetic have another kind of program: a ``ChipProgram`` for meshes and open
cores, a ``XyloProgram``, a ``SpinnakerProgram``. Commands that take any program look up its row
here.

To add a kind, write its program, its files and its engine in a package of its own, and add its row
here.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Generic, Literal, NamedTuple, TypeVar

import numpy as np

from hw_model.io.arguments import checked
from hw_model.program.chip_program import ChipProgram
from hw_model.program.read import chip_program_of
from hw_model.program.sealed import (
    CHIP_PROGRAM,
    SPINNAKER_PROGRAM,
    XYLO_PROGRAM,
    SealedPair,
    read_pair,
)
from hw_model.spinnaker.files import spinnaker_arrays, spinnaker_program_of
from hw_model.spinnaker.program import SpinnakerProgram
from hw_model.values import AnyArray, ByteArray, FloatArray, Frozen
from hw_model.xylo.files import xylo_arrays, xylo_program_of
from hw_model.xylo.program import XyloProgram

AnyProgram = ChipProgram | XyloProgram | SpinnakerProgram
Engine = Literal["fast", "reference"]
ProgramT = TypeVar("ProgramT", ChipProgram, XyloProgram, SpinnakerProgram)


class PlayedProgram(Frozen, eq=False):
    """The results of playing recordings, the same for all kinds of programs.

    - ``spikes`` (batch, steps, n), by population: 1 where a neuron spiked in a step, once or more
      often
    - ``scores`` (batch, classes): the scores of the classes; None without a readout
    """

    spikes: Mapping[str, ByteArray]
    scores: FloatArray | None


class GroupSize(NamedTuple):
    """The number of neurons of a population, and of synapses onto it."""

    neurons: int
    synapses: int


class ProgramContents(Frozen, eq=False):
    """What a program holds: its number of ``cores``, the size of each population, and its arrays by name."""

    cores: int
    groups: Mapping[str, GroupSize]
    arrays: Mapping[str, AnyArray]


@dataclass(frozen=True)
class ProgramKind(Generic[ProgramT]):
    """A kind of programs: the same class, files and engine.

    - ``format``: the name of the kind in its files
    - ``program``: the class of its programs
    - ``read``: makes a program from its two files, ``program.yaml`` and ``program.npz``, as
      :func:`~hw_model.program.sealed.read_pair` returns them; raises an ``InputError`` for anything
      missing, damaged or newer
    - ``play``: plays recordings (batch, steps, channels), each from rest, in one of two engines,
      which give the same results
    - ``contents``: returns what a program holds, by which reports compare it with another; None for
      ``ChipProgram``, which they compare core by core
    """

    format: str
    program: type[ProgramT]
    read: Callable[[SealedPair], ProgramT]
    play: Callable[[ProgramT, ByteArray, Engine], PlayedProgram]
    contents: Callable[[ProgramT], ProgramContents] | None = None


# The functions below import their engine when they are called, because engines are slow to import and reading a
# program needs none.


def _play_chip(program: ChipProgram, recordings: ByteArray, engine: Engine) -> PlayedProgram:
    from hw_model.simulation import simulate

    result = simulate(program, recordings, engine=engine)
    return PlayedProgram(result.spikes, result.scores)


def _play_xylo(program: XyloProgram, recordings: ByteArray, engine: Engine) -> PlayedProgram:
    from hw_model.xylo.playing import play_program

    played = play_program(program, recordings, engine)
    # A neuron of a Xylo can spike several times per step; ``PlayedProgram`` only says whether it did.
    spikes = {name: np.minimum(counts, 1) for name, counts in played.spikes.items()}
    return PlayedProgram(spikes, played.scores)


def _play_spinnaker(
    program: SpinnakerProgram, recordings: ByteArray, engine: Engine
) -> PlayedProgram:
    from hw_model.spinnaker.playing import play_program

    played = play_program(program, recordings, engine)
    return PlayedProgram(played.spikes, played.scores)


def _xylo_contents(program: XyloProgram) -> ProgramContents:
    network = program.network
    onto_hidden = np.count_nonzero(network.weights_in) + np.count_nonzero(network.weights_hidden)
    onto_outputs = np.count_nonzero(network.weights_out)
    groups = {
        "hidden": GroupSize(network.hidden.size, int(onto_hidden)),
        "outputs": GroupSize(network.outputs.size, int(onto_outputs)),
    }
    return ProgramContents(1, groups, xylo_arrays(network))


def _spinnaker_contents(program: SpinnakerProgram) -> ProgramContents:
    network = program.network
    synapses = {population.name: 0 for population in network.populations}
    for projection in network.projections:
        synapses[projection.target] += len(projection.weight)
    groups = {
        population.name: GroupSize(population.size, synapses[population.name])
        for population in network.populations
    }
    # Phases are played one after the other on the same cores, so the largest phase says how many are needed.
    cores = max(network.cores_of(phase.name) for phase in network.phases)
    return ProgramContents(cores, groups, spinnaker_arrays(network))


CHIP = ProgramKind(CHIP_PROGRAM, ChipProgram, chip_program_of, _play_chip)
PROGRAM_KINDS: tuple[ProgramKind[Any], ...] = (
    CHIP,
    ProgramKind(XYLO_PROGRAM, XyloProgram, xylo_program_of, _play_xylo, _xylo_contents),
    ProgramKind(
        SPINNAKER_PROGRAM,
        SpinnakerProgram,
        spinnaker_program_of,
        _play_spinnaker,
        _spinnaker_contents,
    ),
)


@checked
def load_any_program(folder: str | Path) -> AnyProgram:
    """Read a program of any kind; raise an ``InputError`` for anything missing, damaged or newer."""
    pair = read_pair(Path(folder))
    # Files of no known kind go to the reader of CHIP, which refuses them with the right error.
    kind = next((row for row in PROGRAM_KINDS if row.format == pair.kind), CHIP)
    program: AnyProgram = kind.read(pair)
    return program


def kind_of(program: AnyProgram) -> ProgramKind[Any]:
    """Return the row of the table that a program belongs to."""
    return next(kind for kind in PROGRAM_KINDS if isinstance(program, kind.program))
