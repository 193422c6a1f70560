"""Read and write programs for a SpiNNaker, as the two files of :mod:`hw_model.program.sealed`.

A program that is read from files is checked as strictly as one that is made in Python: entries of ``program.yaml`` by
the annotations of :class:`SpinnakerDocument`, arrays by :class:`SpinnakerNetwork`, and the whole against the chip.
Names of entries are the names of fields, so a field that is renamed changes the file format. The arrays of an item are
named by its number in ``program.yaml``, such as ``population0/tau_m``.
"""

from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

from hw_model.arithmetic import spinnaker
from hw_model.errors import InputError
from hw_model.io.arguments import checked
from hw_model.io.files import parsing
from hw_model.io.records import AT_LEAST_ONE, NOT_NEGATIVE, POSITIVE, RecordReader, between
from hw_model.mapping.graph import AXES, MAX_LINES, MAX_STEPS, Input, Phase, Readout
from hw_model.mapping.recorded import RecordedChannels
from hw_model.program.sealed import (
    PROGRAM_NPZ,
    PROGRAM_YAML,
    SPINNAKER_PROGRAM,
    SealedPair,
    read_pair,
    save_files,
    sealed_files,
)
from hw_model.program.write import CHANNEL_ORDERS, START, TIME_UNITS
from hw_model.spinnaker.chips import SpinnakerChip, is_shipped_spinnaker, spinnaker_chip
from hw_model.spinnaker.network import (
    RECEPTORS,
    SpinnakerNetwork,
    SpinnakerPopulation,
    SpinnakerProjection,
)
from hw_model.spinnaker.program import SpinnakerProgram
from hw_model.values import Frozen, IntArray, picked

VERSION = 1
"""The version of the file format. Programs of another version are refused."""
# The fields of a program about its recordings, which are entries of the same name.
_OF_RECORDINGS = (
    "step_seconds",
    "event_threshold",
    "polarities",
    "columns",
    "channel_order",
    "class_names",
    "start",
    "time_unit",
    "recorded",
)
_SYNAPSES = ("source_index", "target_index", "weight", "delay")
"""The arrays of a projection."""


class PhaseEntry(Frozen):
    """The entry of a phase, with the fields of :class:`hw_model.mapping.graph.Phase`."""

    name: str
    axis: Annotated[str, AXES]
    steps: Annotated[int | None, between(1, MAX_STEPS)] = None
    align_events: Annotated[int | None, AT_LEAST_ONE] = None


class InputEntry(Frozen):
    """The entry of an input.

    Where an input is transposed (its positions are steps in which channels are played,
    :class:`hw_model.mapping.graph.Input`), its positions and first lines are arrays in the other file.
    """

    name: str
    size: Annotated[int, between(1, MAX_LINES)]
    phase: str
    stream: str


class PopulationEntry(Frozen):
    """The entry of a population, with the fields of :class:`hw_model.spinnaker.network.SpinnakerPopulation`.

    The parameters of its neurons are arrays in the other file.
    """

    name: str
    phase: str
    shifts: tuple[int, int]
    slots: int
    neurons_per_core: int
    weight_unit: Annotated[float, POSITIVE]
    potential_unit: Annotated[float, POSITIVE]


class ProjectionEntry(Frozen):
    """The entry of a projection: its ends. Its synapses are arrays in the other file."""

    source: str
    target: str
    receptor: Annotated[str, RECEPTORS]


class ReadoutEntry(Frozen):
    """The entry of a population of the readout, with its weight in the class scores.

    The population is read by its spikes or, if ``potentials_from`` is given, by its potentials from that step on.
    """

    population: str
    weight: float
    potentials_from: Annotated[int | None, NOT_NEGATIVE] = None


class SpinnakerDocument(Frozen):
    """The entries of ``program.yaml``. An entry whose value is None is not written.

    The seal, a checksum of the entries, is no entry: it is the last line of the file.
    """

    format: str
    version: int
    arrays_sha256: str
    name: str
    target: str
    phases: tuple[PhaseEntry, ...]
    inputs: tuple[InputEntry, ...]
    populations: tuple[PopulationEntry, ...]
    projections: tuple[ProjectionEntry, ...]
    readout: tuple[ReadoutEntry, ...]
    provenance: Mapping[str, str]
    chip: SpinnakerChip | None = None
    readout_tie_class: Annotated[int | None, NOT_NEGATIVE] = None
    step_seconds: Annotated[float | None, POSITIVE] = None
    event_threshold: Annotated[int | None, NOT_NEGATIVE] = None
    polarities: Annotated[int | None, AT_LEAST_ONE] = None
    columns: Annotated[int | None, AT_LEAST_ONE] = None
    channel_order: Annotated[str | None, CHANNEL_ORDERS] = None
    class_names: tuple[str, ...] | None = None
    start: Annotated[float | str | None, START] = None
    time_unit: Annotated[str | None, TIME_UNITS] = None
    recorded: RecordedChannels | None = None


def spinnaker_files(program: SpinnakerProgram) -> dict[str, bytes]:
    """Return both files of a program as bytes, by name; equal programs give the same bytes."""
    network = program.network
    entries: dict[str, object] = {
        "name": program.name,
        "target": program.chip.name,
        "phases": [_known(vars(phase)) for phase in network.phases],
        "inputs": [picked(item, *InputEntry.__dataclass_fields__) for item in network.inputs],
        "populations": [_population_entry(population) for population in network.populations],
        "projections": [
            picked(projection, *ProjectionEntry.__dataclass_fields__)
            for projection in network.projections
        ],
        "readout": _readout_entries(program.readout),
        "provenance": dict(program.provenance),
    }
    optional = picked(program, *_OF_RECORDINGS)
    # A chip that ships with this package is found by its name; any other is written out.
    if not is_shipped_spinnaker(program.chip):
        optional["chip"] = asdict(program.chip)
    if program.readout is not None:
        optional["readout_tie_class"] = program.readout.tie_class
    if optional["class_names"]:
        optional["class_names"] = list(optional["class_names"])
    if program.recorded is not None:
        optional["recorded"] = program.recorded.document()
    all_entries = entries | _known(optional)
    return sealed_files(SPINNAKER_PROGRAM, VERSION, all_entries, spinnaker_arrays(network))


def _known(entries: Mapping[str, object]) -> dict[str, object]:
    """Return the entries whose value is not None."""
    return {name: value for name, value in entries.items() if value is not None}


def _population_entry(population: SpinnakerPopulation) -> dict[str, object]:
    entry: dict[str, object] = picked(population, *PopulationEntry.__dataclass_fields__)
    return entry | {"shifts": list(population.shifts)}


def _readout_entries(readout: Readout | None) -> list[dict[str, object]]:
    """Return the entries of the readout, one per population; an empty list if there is none."""
    if readout is None:
        return []
    entries = []
    for name, weight in readout.terms:
        first = readout.from_step.get(name)
        entry = {"population": name, "weight": float(weight), "potentials_from": first}
        entries.append(_known(entry))
    return entries


def spinnaker_arrays(network: SpinnakerNetwork) -> dict[str, IntArray]:
    """Return the arrays of a network by their names in the file."""
    arrays: dict[str, IntArray] = {}
    for number, item in enumerate(network.inputs):
        for name in ("positions", "first_lines"):
            array = getattr(item, name)
            if array is not None:
                arrays[f"input{number}/{name}"] = array
    for number, population in enumerate(network.populations):
        for name, array in population.parameters._asdict().items():
            arrays[f"population{number}/{name}"] = array
    for number, projection in enumerate(network.projections):
        for name in _SYNAPSES:
            arrays[f"projection{number}/{name}"] = getattr(projection, name)
    return arrays


def save_spinnaker(program: SpinnakerProgram, folder: str | Path) -> None:
    """Write both files into a folder, or neither; everything else there stays."""
    save_files(Path(folder), spinnaker_files(program))


@checked
def load_spinnaker(folder: str | Path) -> SpinnakerProgram:
    """Read a program; anything missing, damaged, swapped or newer is an ``InputError``."""
    return spinnaker_program_of(read_pair(Path(folder)))


def spinnaker_program_of(pair: SealedPair) -> SpinnakerProgram:
    """Return the program that the two files hold."""
    pair.check_format(SPINNAKER_PROGRAM, VERSION)
    pair.check_arrays()
    reader = RecordReader(PROGRAM_YAML, fix="Compile again.")
    document = reader.record(SpinnakerDocument, pair.document)
    with parsing(PROGRAM_YAML, "its entries do not make a program", fix="Compile again."):
        arrays = pair.unpack()
        network = _network(document, arrays)
        program = SpinnakerProgram(
            name=document.name,
            chip=document.chip or spinnaker_chip(document.target),
            network=network,
            readout=_readout(document),
            provenance=document.provenance,
            **picked(document, *_OF_RECORDINGS),
        )
    _check_names(arrays, network)
    # The seal, a checksum of the entries, comes last: the checks before it say what is wrong, it says only that
    # something is.
    pair.check_seal()
    return program


def _network(document: SpinnakerDocument, arrays: Mapping[str, IntArray]) -> SpinnakerNetwork:
    """Return the network; an input, population or projection is numbered in the names of its arrays."""
    phases = tuple(Phase(**vars(entry)) for entry in document.phases)
    inputs = tuple(_input(number, entry, arrays) for number, entry in enumerate(document.inputs))
    for item in inputs:
        _check_input(item, phases)
    return SpinnakerNetwork(
        phases=phases,
        inputs=inputs,
        populations=tuple(
            SpinnakerPopulation(
                **vars(entry),
                parameters=_parameters(f"population{number}", arrays),
            )
            for number, entry in enumerate(document.populations)
        ),
        projections=tuple(
            _projection(f"projection{number}", entry, arrays)
            for number, entry in enumerate(document.projections)
        ),
    )


def _input(number: int, entry: InputEntry, arrays: Mapping[str, IntArray]) -> Input:
    """Return an input; it has positions only if it goes through the transpose buffer."""
    return Input(
        **vars(entry),
        positions=arrays.get(f"input{number}/positions"),
        first_lines=arrays.get(f"input{number}/first_lines"),
    )


def _projection(
    prefix: str, entry: ProjectionEntry, arrays: Mapping[str, IntArray]
) -> SpinnakerProjection:
    """Return a projection, whose arrays are named ``prefix/...``."""
    return SpinnakerProjection(
        **vars(entry),
        source_index=arrays[f"{prefix}/source_index"],
        target_index=arrays[f"{prefix}/target_index"],
        weight=arrays[f"{prefix}/weight"],
        delay=arrays[f"{prefix}/delay"],
    )


def _parameters(prefix: str, arrays: Mapping[str, IntArray]) -> spinnaker.Parameters:
    names = spinnaker.Parameters._fields
    return spinnaker.Parameters(*(arrays[f"{prefix}/{name}"] for name in names))


def _check_input(item: Input, phases: tuple[Phase, ...]) -> None:
    """Raise InputError if the visits of a transposed input do not fit.

    Each channel is visited in a step of its phase, and takes lines from its first line on. Channels that are visited in
    the same step must not share lines.
    """
    if item.positions is None:
        return
    phase = next(phase for phase in phases if phase.name == item.phase)
    steps = phase.steps or MAX_STEPS
    visit_steps, first_lines = item.visits
    fits = (
        item.positions.ndim == 1
        and visit_steps.shape == first_lines.shape
        and bool(((visit_steps >= 0) & (visit_steps < steps)).all())
        and bool(((first_lines >= 0) & (first_lines < item.size)).all())
        and not item.lines_are_shared
    )
    if not fits:
        what = "its visits do not fit its lines, or the steps of its phase"
        raise InputError(f"input {item.name!r}", what, fix="Compile again.")


def _readout(document: SpinnakerDocument) -> Readout | None:
    """Return the readout that the entries describe, or None if there are none."""
    if not document.readout:
        return None
    first_steps = tuple(entry.potentials_from for entry in document.readout)
    potentials_from: int | tuple[int | None, ...] | None = first_steps
    # A step that all populations share becomes one number, as the compiler makes it: a program that is read again then
    # equals the one that was saved.
    if len(set(first_steps)) == 1:
        potentials_from = first_steps[0]
    return Readout(
        populations=tuple(entry.population for entry in document.readout),
        weights=tuple(entry.weight for entry in document.readout),
        potentials_from=potentials_from,
        tie_class=document.readout_tie_class,
    )


def _check_names(arrays: Mapping[str, IntArray], network: SpinnakerNetwork) -> None:
    """Raise InputError if a file holds arrays that the program does not use: no report would show them."""
    unknown = sorted(set(arrays) - set(spinnaker_arrays(network)))
    if unknown:
        what = "it holds arrays without a meaning"
        raise InputError(PROGRAM_NPZ, what, measured=unknown[0], fix="Compile again.")
