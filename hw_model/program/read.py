"""Read a program from disk, as :mod:`hw_model.program.write` writes it.

Nothing in the files is executed. An error names the file that is damaged, has a newer format, or belongs to another
program than the other file. Files may be hostile: whatever goes wrong while entries are read is reported as an
``InputError`` (:func:`hw_model.io.files.parsing`), and the program that they make is checked like any other.
"""

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from hw_model.description.chip import parse_chip
from hw_model.errors import InputError
from hw_model.io.arguments import checked
from hw_model.io.files import parsing
from hw_model.mapping.fan_in import SynapseFormat
from hw_model.mapping.graph import Input, Phase, Readout, compact
from hw_model.mapping.placement import Slice
from hw_model.mapping.recorded import recorded_of
from hw_model.mapping.routing import AxonTables, InputRoute
from hw_model.program.check import OF_SYNAPSES, check_program
from hw_model.program.chip_program import ChipProgram, CompartmentProfile, Core
from hw_model.program.sealed import CHIP_PROGRAM, PROGRAM_NPZ, PROGRAM_YAML, SealedPair, read_pair
from hw_model.program.write import (
    AXON_ARRAYS,
    CHANNEL_ORDERS,
    CORE_ARRAYS,
    FIRST,
    INPUT_ENTRIES,
    RECORDINGS,
    ROUTE_ARRAYS,
    TIME_UNITS,
    VERSION,
)
from hw_model.values import IntArray


# `checked` makes an argument of another type than annotated an InputError.
@checked
def load_program(folder: str | Path) -> ChipProgram:
    """Read a program; anything missing, damaged, swapped or newer is an ``InputError``."""
    return chip_program_of(read_pair(Path(folder)))


def chip_program_of(pair: SealedPair) -> ChipProgram:
    """Return the program that the two files hold."""
    pair.check_format(CHIP_PROGRAM, VERSION)
    pair.check_arrays()
    with parsing(PROGRAM_YAML, "its entries do not make a program", fix="Compile again."):
        arrays = _vectors(pair)
        # The names have to be taken first, since `_program` removes arrays from the dictionary.
        stored_names = set(arrays)
        program = _program(pair.document, arrays)
        check_program(program)
    _check_names(stored_names, program)
    # The checksum comes last: the checks before it say what is wrong, it says only that something is.
    pair.check_seal()
    return program


def _vectors(pair: SealedPair) -> dict[str, IntArray]:
    """Return the arrays by name.

    Raises ``ValueError`` if one is not a vector; :func:`parsing` makes an ``InputError`` of it.
    """
    arrays = pair.unpack()
    for name, array in arrays.items():
        if array.ndim != 1:
            raise ValueError(name)
    return arrays


def _check_names(stored_names: set[str], program: ChipProgram) -> None:
    """Raise InputError if a file holds arrays that the program does not use.

    Otherwise a file could carry data that no report shows.
    """
    known_names = {
        f"core{core.number}/{name}"
        for core in program.cores
        for name in (*CORE_ARRAYS, *AXON_ARRAYS)
    }
    for index in range(len(program.inputs)):
        for name in (*ROUTE_ARRAYS, "positions", "first_lines"):
            known_names.add(f"input{index}/{name}")
    unknown = sorted(stored_names - known_names)
    if unknown:
        measured = unknown[0] if len(unknown) == 1 else f"{unknown[0]} and {len(unknown) - 1} more"
        raise InputError(
            PROGRAM_NPZ,
            "it holds arrays without a meaning",
            measured=measured,
            fix="Compile again.",
        )


def _program(document: Mapping[str, Any], arrays: dict[str, IntArray]) -> ChipProgram:
    """Return the program; the arrays of synapses are removed from ``arrays``, see :func:`_core`."""
    inputs = []
    routes = []
    for index, item in enumerate(document["inputs"]):
        # A transposed recording comes through the transpose buffer: an event of channel c at step t becomes a spike of
        # line first_lines[c] + t at step positions[c] of the phase. Without first_lines, they are 0.
        positions = arrays[f"input{index}/positions"] if item["transposed"] else None
        first_lines = arrays.get(f"input{index}/first_lines")
        entries = {name: item[name] for name in INPUT_ENTRIES} | {"size": int(item["size"])}
        inputs.append(Input(**entries, positions=positions, first_lines=first_lines))
        route_arrays = {name: arrays[f"input{index}/{name}"] for name in ROUTE_ARRAYS}
        routes.append(InputRoute(item["name"], **route_arrays))
    return ChipProgram(
        name=str(document["name"]),
        chip=parse_chip(document["chip"], where=f"{PROGRAM_YAML}: chip"),
        phases=tuple(Phase(**phase) for phase in document["phases"]),
        inputs=tuple(inputs),
        input_routes=tuple(routes),
        cores=tuple(_core(core, arrays) for core in document["cores"]),
        readout=_readout(document),
        synapses_pruned=int(document["synapses_pruned"]),
        provenance={str(key): str(value) for key, value in document["provenance"].items()},
        # RECORDINGS: numbers on how recordings become steps and predictions, such as `step_seconds`.
        **{name: _optional_number(document, name, kind) for name, kind in RECORDINGS.items()},
        class_names=_class_names(document.get("class_names")),
        channel_order=_channel_order(document.get("channel_order")),
        start=_start(document.get("start")),
        time_unit=_time_unit(document.get("time_unit")),
        # Which channels of a larger sensor it reads.
        recorded=recorded_of(PROGRAM_YAML, document.get("recorded")),
    )


def _optional_number(document: Mapping[str, Any], name: str, kind: type[int] | type[float]) -> Any:
    """Return an entry that may be missing: a number of this kind, 0 or more, and ``step_seconds`` more than 0."""
    value = document.get(name)
    if value is None:
        return None
    # `type`, not isinstance: True is an instance of int. A whole number will do where a float is expected.
    is_number = type(value) in (kind, int)
    if not is_number or not 0 <= value < math.inf:
        raise ValueError(name)
    if name == "step_seconds" and value == 0:
        raise ValueError(name)
    return value


def _channel_order(order: Any) -> str | None:
    """Return how channels are numbered; the entry is missing in programs of earlier versions."""
    if order not in (None, *CHANNEL_ORDERS):
        raise ValueError("channel_order")
    return None if order is None else str(order)


def _start(start: Any) -> float | str | None:
    """Return where recordings of events start: seconds, or ``first`` for the first event; the entry may be missing."""
    if start is None:
        return None
    if start == FIRST:
        return FIRST
    if type(start) not in (int, float) or not math.isfinite(start):
        raise ValueError("start")
    return float(start)


def _time_unit(unit: Any) -> str | None:
    """Return the unit of the times of events; the entry may be missing."""
    if unit not in (None, *TIME_UNITS):
        raise ValueError("time_unit")
    return None if unit is None else str(unit)


def _class_names(names: Any) -> tuple[str, ...] | None:
    """Return the names of the classes, a list of texts; the entry may be missing."""
    if names is None:
        return None
    if not (isinstance(names, list) and all(isinstance(name, str) for name in names)):
        raise ValueError("class_names")
    return tuple(names)


def _readout(document: Mapping[str, Any]) -> Readout | None:
    """Return the readout, if the program has one.

    The entry ``readout_potentials_from`` is the step from which potentials count: one for all populations, or one for
    each population that is read by its potentials. It is missing if only spikes count.
    """
    weights = document["readout"]
    if weights is None:
        return None
    potentials_from = document.get("readout_potentials_from")
    first_step: int | tuple[int | None, ...] | None = None
    if isinstance(potentials_from, dict):
        steps = (potentials_from.get(name) for name in weights)
        # A population that the mapping does not name is read by its spikes: None.
        first_step = tuple(None if step is None else int(step) for step in steps)
    elif potentials_from is not None:
        first_step = int(potentials_from)
    return Readout(
        populations=tuple(weights),
        weights=tuple(map(float, weights.values())),
        potentials_from=first_step,
        tie_class=_optional_number(document, "readout_tie_class", int),
    )


def _core(core: dict[str, Any], arrays: dict[str, IntArray]) -> Core:
    """Return a core; the arrays of its synapses are removed from ``arrays``.

    Synapses are most of a program: each array is removed when its compact copy has been made, so that the original is
    freed at once.
    """
    prefix = f"core{int(core['number'])}/"
    # `slot` is the place of the core on the board, counted through all chips.
    fields: dict[str, Any] = {name: int(core[name]) for name in ("number", "slot", "vmin", "vmax")}
    fields |= {name: arrays[prefix + name] for name in CORE_ARRAYS}
    synapses = {name: compact(arrays.pop(prefix + name)) for name in OF_SYNAPSES}
    return Core(
        **fields,
        phase=core["phase"],
        slices=tuple(Slice(**piece) for piece in core["slices"]),
        profiles=tuple(CompartmentProfile(**profile) for profile in core["compartment_profiles"]),
        thresholds=tuple(map(int, core["threshold_mantissas"])),
        axons=AxonTables(
            formats=tuple(SynapseFormat(**form) for form in core["synapse_formats"]),
            synapse_words=int(core["synapse_words"]),
            **{name: arrays[prefix + name] for name in AXON_ARRAYS if name not in OF_SYNAPSES},
            **synapses,
        ),
    )
