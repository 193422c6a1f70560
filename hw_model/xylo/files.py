"""Read and write programs for a Xylo, as the two files of :mod:`hw_model.program.sealed`.

A program that is read from files is checked as strictly as one that is made in Python: entries of ``program.yaml`` by
the annotations of :class:`XyloDocument`, arrays by :class:`XyloNetwork`, and the whole against the chip. Names of
entries are the names of fields, so a field that is renamed changes the file format.
"""

from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

from hw_model.errors import InputError
from hw_model.io.arguments import checked
from hw_model.io.files import parsing
from hw_model.io.records import AT_LEAST_ONE, NOT_NEGATIVE, POSITIVE, RecordReader, between
from hw_model.mapping.graph import MAX_STEPS, Readout
from hw_model.mapping.recorded import RecordedChannels
from hw_model.program.sealed import (
    PROGRAM_NPZ,
    PROGRAM_YAML,
    XYLO_PROGRAM,
    SealedPair,
    read_pair,
    save_files,
    sealed_files,
)
from hw_model.program.write import CHANNEL_ORDERS, START, TIME_UNITS
from hw_model.values import Frozen, IntArray, picked
from hw_model.xylo.chips import XyloChip, is_shipped_xylo, xylo_chip
from hw_model.xylo.network import XyloNetwork, XyloPopulation
from hw_model.xylo.program import NamedPart, XyloProgram

VERSION = 1
"""The version of the file format. Programs of another version are refused."""
SHIFT_MAX = 15
"""The largest shift of weights, in a field of 4 bits."""
Shift = Annotated[int, between(0, SHIFT_MAX)]
# The fields of a program about its recordings, which are entries of the same name.
_ABOUT_RECORDINGS = (
    "steps",
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
_SHIFTS = ("shift_in", "shift_hidden", "shift_out")
_WEIGHTS = ("weights_in", "weights_hidden", "weights_out")
_PARAMETERS = ("dash_syn", "dash_mem", "threshold")


class XyloDocument(Frozen):
    """The entries of ``program.yaml``. An entry whose value is None is not written."""

    format: str
    version: int
    arrays_sha256: str
    name: str
    target: str
    hidden: tuple[NamedPart, ...]
    outputs: str
    readout_weight: float
    shift_in: Shift
    shift_hidden: Shift
    shift_out: Shift
    provenance: Mapping[str, str]
    chip: XyloChip | None = None
    readout_tie_class: Annotated[int | None, NOT_NEGATIVE] = None
    aliases: tuple[tuple[int, ...], ...] | None = None
    steps: Annotated[int | None, between(1, MAX_STEPS)] = None
    step_seconds: Annotated[float | None, POSITIVE] = None
    event_threshold: Annotated[int | None, NOT_NEGATIVE] = None
    polarities: Annotated[int | None, AT_LEAST_ONE] = None
    columns: Annotated[int | None, AT_LEAST_ONE] = None
    channel_order: Annotated[str | None, CHANNEL_ORDERS] = None
    class_names: tuple[str, ...] | None = None
    start: Annotated[float | str | None, START] = None
    time_unit: Annotated[str | None, TIME_UNITS] = None
    recorded: RecordedChannels | None = None


def xylo_files(program: XyloProgram) -> dict[str, bytes]:
    """Return both files of a program as bytes, by name; equal programs give the same bytes."""
    network = program.network
    entries = {
        "name": program.name,
        "target": program.chip.name,
        "hidden": [asdict(part) for part in program.hidden],
        "outputs": program.outputs,
        "readout_weight": float(program.readout.weights[0]),
        **picked(network, *_SHIFTS),
        "provenance": dict(program.provenance),
    }
    optional = {
        "readout_tie_class": program.readout.tie_class,
        "aliases": network.aliases,
        "chip": None if is_shipped_xylo(program.chip) else asdict(program.chip),
        **picked(program, *_ABOUT_RECORDINGS),
    }
    for name, value in optional.items():
        if value is not None:
            entries[name] = _plain(value)
    return sealed_files(XYLO_PROGRAM, VERSION, entries, xylo_arrays(network))


def _plain(value: object) -> object:
    """Return a value as YAML holds it: tuples become lists, and records mappings."""
    if isinstance(value, RecordedChannels):
        return value.document()
    if isinstance(value, tuple):
        return [_plain(part) for part in value]
    return value


def xylo_arrays(network: XyloNetwork) -> dict[str, IntArray]:
    """Return the arrays of a network by their names in the file."""
    arrays: dict[str, IntArray] = picked(network, *_WEIGHTS)
    for called, population in (("hidden", network.hidden), ("outputs", network.outputs)):
        for name in _PARAMETERS:
            arrays[f"{called}/{name}"] = getattr(population, name)
        if population.bias is not None:
            arrays[f"{called}/bias"] = population.bias
    return arrays


def save_xylo(program: XyloProgram, folder: str | Path) -> None:
    """Write both files into a folder, or neither; everything else there stays."""
    save_files(Path(folder), xylo_files(program))


@checked
def load_xylo(folder: str | Path) -> XyloProgram:
    """Read a program; anything missing, damaged, swapped or newer is an ``InputError``."""
    return xylo_program_of(read_pair(Path(folder)))


def xylo_program_of(pair: SealedPair) -> XyloProgram:
    """Return the program that the two files hold."""
    pair.check_format(XYLO_PROGRAM, VERSION)
    pair.check_arrays()
    reader = RecordReader(PROGRAM_YAML, fix="Compile again.")
    document = reader.record(XyloDocument, pair.document)
    with parsing(PROGRAM_YAML, "its entries do not make a program", fix="Compile again."):
        arrays = pair.unpack()
        program = _program(document, arrays)
    _check_names(arrays, program)
    # The checksum comes last: the checks before it say what is wrong, it says only that something is.
    pair.check_seal()
    return program


def _program(document: XyloDocument, arrays: Mapping[str, IntArray]) -> XyloProgram:
    """Return the program that the entries and arrays describe."""
    network = XyloNetwork(
        hidden=_population("hidden", arrays),
        outputs=_population("outputs", arrays),
        weights_in=arrays["weights_in"],
        weights_hidden=arrays["weights_hidden"],
        weights_out=arrays["weights_out"],
        shift_in=document.shift_in,
        shift_hidden=document.shift_hidden,
        shift_out=document.shift_out,
        aliases=document.aliases,
    )
    readout = Readout(
        (document.outputs,), (document.readout_weight,), tie_class=document.readout_tie_class
    )
    return XyloProgram(
        name=document.name,
        chip=document.chip or xylo_chip(document.target),
        network=network,
        hidden=document.hidden,
        readout=readout,
        provenance=document.provenance,
        **picked(document, *_ABOUT_RECORDINGS),
    )


def _population(called: str, arrays: Mapping[str, IntArray]) -> XyloPopulation:
    parameters = {name: arrays[f"{called}/{name}"] for name in _PARAMETERS}
    return XyloPopulation(**parameters, bias=arrays.get(f"{called}/bias"))


def _check_names(arrays: Mapping[str, IntArray], program: XyloProgram) -> None:
    """Raise InputError if a file holds arrays that the program does not use: no report would show them."""
    unknown = sorted(set(arrays) - set(xylo_arrays(program.network)))
    if unknown:
        what = "it holds arrays without a meaning"
        raise InputError(PROGRAM_NPZ, what, measured=unknown[0], fix="Compile again.")
