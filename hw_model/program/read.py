"""Read a program from disk, as :mod:`hw_model.program.write` writes it.

Nothing in the files is executed. A damaged, swapped or newer file is refused by name.
"""

import hashlib
import io
import math
from pathlib import Path
from typing import Any

import numpy as np

from hw_model.description.chip import parse_chip
from hw_model.errors import InputError, check_same
from hw_model.io.files import parsing, read_bytes
from hw_model.io.folders import finish_writing
from hw_model.io.given import checked
from hw_model.io.npy import load_npy
from hw_model.io.yaml_text import FAST_LOADER, SEAL, load_yaml
from hw_model.io.zip_directory import BoundedZip
from hw_model.mapping.fan_in import SynapseFormat
from hw_model.mapping.graph import Input, Phase, Readout, held
from hw_model.mapping.placement import Slice
from hw_model.mapping.routing import AxonTables, InputRoute
from hw_model.program.check import OF_SYNAPSES, check_program
from hw_model.program.chip_program import ChipProgram, CompartmentProfile, Core
from hw_model.program.write import (
    AXON_ARRAYS,
    CHANNEL_ORDERS,
    CORE_ARRAYS,
    FIRST,
    FORMAT,
    INPUT_ENTRIES,
    RECORDINGS,
    ROUTE_ARRAYS,
    TIME_UNITS,
    VERSION,
)
from hw_model.values import IntArray, sealed

MAX_FILE_BYTES = 2 << 30
MAX_ARRAY_BYTES, MAX_PACKING = 3 << 29, 64
"""Largest size of all arrays together, unpacked: in bytes, or, if that is more, as a multiple of the file's size."""
MAX_YAML_NODES = 2_000_000
"""Largest number of values, keys and containers in ``program.yaml``, which has about a hundred per core."""


@checked
def load_program(folder: str | Path) -> ChipProgram:
    """Read a program; anything missing, damaged, swapped or newer is an ``InputError``."""
    path, fix = Path(folder), "Give the folder that the compiler wrote."
    finish_writing(path)
    yaml_bytes, npz_bytes = (
        read_bytes(
            path / name, f"program {str(path)!r}, {name}", MAX_FILE_BYTES, "Compile again.", fix
        )
        for name in ("program.yaml", "program.npz")
    )
    asked = "program.yaml", "the file is not YAML: it is damaged", "Compile again."
    document = load_yaml(yaml_bytes, *asked, loader=FAST_LOADER, most_nodes=MAX_YAML_NODES)
    if not isinstance(document, dict) or document.get("format") != FORMAT:
        raise InputError("program.yaml", "this is not a program", fix=fix)
    version, fix = (
        repr(document.get("version")),
        "Compile it again, or use the release that wrote it.",
    )
    check_same(
        version, repr(VERSION), "program.yaml", "the program has another format version", fix=fix
    )
    if hashlib.sha256(npz_bytes).hexdigest() != document.get("arrays_sha256"):
        what = "the checksum differs: it is damaged, or of another program"
        raise InputError("program.npz", what, fix="Compile again.")
    with parsing("program.yaml", "its entries do not make a program", fix="Compile again."):
        arrays = _unpack(npz_bytes)
        stored = set(arrays)
        program = _program(document, arrays)
        check_program(program)
    _check_names(stored, program)
    above, seal, said = yaml_bytes.replace(b"\r\n", b"\n").rpartition(SEAL.encode())
    if seal and hashlib.sha256(above).hexdigest().encode() != said.strip():
        fix = "Compile again or, to play it as edited, remove its last line."
        raise InputError(
            "program.yaml", "its checksum differs: it was edited, or is damaged", fix=fix
        )
    return program


def _unpack(content: bytes) -> dict[str, IntArray]:
    """Return the int64 vectors of the archive by name, read-only; any exception where there is something else."""
    arrays: dict[str, IntArray] = {}
    with BoundedZip(io.BytesIO(content), "program.npz", "Compile again.") as archive:
        if archive.unpacked_bytes > max(MAX_ARRAY_BYTES, MAX_PACKING * len(content)):
            raise InputError("program.npz", "its arrays are absurdly large", fix="Compile again.")
        for name in archive.namelist():
            array = load_npy(archive.content(name), f"program.npz, {name!r}")
            if array.dtype != np.int64 or array.ndim != 1:
                raise ValueError(name)
            arrays[name.removesuffix(".npy")] = sealed(array)
    return arrays


def _check_names(stored: set[str], program: ChipProgram) -> None:
    """Refuse arrays that belong to nothing in a program: nobody would see what they hold."""
    known = {
        f"core{core.number}/{name}"
        for core in program.cores
        for name in (*CORE_ARRAYS, *AXON_ARRAYS)
    }
    for index in range(len(program.inputs)):
        for name in (*ROUTE_ARRAYS, "positions", "first_lines"):
            known.add(f"input{index}/{name}")
    unknown = sorted(stored - known)
    if unknown:
        measured = unknown[0] if len(unknown) == 1 else f"{unknown[0]} and {len(unknown) - 1} more"
        raise InputError(
            "program.npz",
            "it holds arrays without a meaning",
            measured=measured,
            fix="Compile again.",
        )


def _program(document: dict[str, Any], arrays: dict[str, IntArray]) -> ChipProgram:
    inputs, routes = [], []
    for index, item in enumerate(document["inputs"]):
        positions = arrays[f"input{index}/positions"] if item["transposed"] else None
        said = {name: item[name] for name in INPUT_ENTRIES} | {"size": int(item["size"])}
        inputs.append(
            Input(**said, positions=positions, first_lines=arrays.get(f"input{index}/first_lines"))
        )
        routes.append(
            InputRoute(item["name"], *(arrays[f"input{index}/{name}"] for name in ROUTE_ARRAYS))
        )
    readout = document["readout"]
    return ChipProgram(
        name=str(document["name"]),
        chip=parse_chip(document["chip"], where="program.yaml: chip"),
        phases=tuple(Phase(**phase) for phase in document["phases"]),
        inputs=tuple(inputs),
        input_routes=tuple(routes),
        cores=tuple(_core(core, arrays) for core in document["cores"]),
        readout=None
        if readout is None
        else _readout(
            readout,
            document.get("readout_potentials_from"),
            _known(document, "readout_tie_class", int),
        ),
        synapses_pruned=int(document["synapses_pruned"]),
        provenance={str(key): str(value) for key, value in document["provenance"].items()},
        **{name: _known(document, name, kind) for name, kind in RECORDINGS.items()},
        class_names=_names(document.get("class_names")),
        channel_order=_channel_order(document.get("channel_order")),
        start=_start(document.get("start")),
        time_unit=_time_unit(document.get("time_unit")),
    )


def _known(document: dict[str, Any], name: str, kind: type[int] | type[float]) -> Any:
    """Return an entry that may be missing: a number of this kind from 0 up; seconds must be above 0."""
    value = document.get(name)
    if value is None:
        return None
    if (
        type(value) not in (kind, int)
        or not 0 <= value < math.inf
        or (name == "step_seconds" and value == 0)
    ):
        raise ValueError(name)
    return value


def _channel_order(order: Any) -> str | None:
    """Return how channels are numbered; programs of earlier versions do not say so."""
    if order not in (None, *CHANNEL_ORDERS):
        raise ValueError("channel_order")
    return None if order is None else str(order)


def _start(start: Any) -> float | str | None:
    """Return where recordings of events start, which may be missing: seconds, or ``first``."""
    if start is None:
        return None
    if start == FIRST:
        return FIRST
    if type(start) not in (int, float) or not math.isfinite(start):
        raise ValueError("start")
    return float(start)


def _time_unit(unit: Any) -> str | None:
    """Return the unit of times of events, which may be missing."""
    if unit not in (None, *TIME_UNITS):
        raise ValueError("time_unit")
    return None if unit is None else str(unit)


def _names(names: Any) -> tuple[str, ...] | None:
    """Return names of classes, which may be missing: a list of texts."""
    if names is None:
        return None
    if not (isinstance(names, list) and all(isinstance(name, str) for name in names)):
        raise ValueError("class_names")
    return tuple(names)


def _readout(weights: dict[str, float], first: Any, tie_class: int | None) -> Readout:
    """Return a readout; ``first`` is a step for all populations, or a step for each one that gives potentials."""
    if isinstance(first, dict):
        first = tuple(None if (step := first.get(name)) is None else int(step) for name in weights)
    elif first is not None:
        first = int(first)
    return Readout(tuple(weights), tuple(map(float, weights.values())), first, tie_class)


def _core(core: dict[str, Any], arrays: dict[str, IntArray]) -> Core:
    prefix = f"core{int(core['number'])}/"
    held_as: dict[str, Any] = {name: int(core[name]) for name in ("number", "slot", "vmin", "vmax")}
    held_as |= {name: arrays[prefix + name] for name in CORE_ARRAYS}
    return Core(
        **held_as,
        phase=core["phase"],
        slices=tuple(Slice(**piece) for piece in core["slices"]),
        profiles=tuple(CompartmentProfile(**profile) for profile in core["compartment_profiles"]),
        thresholds=tuple(map(int, core["threshold_mantissas"])),
        axons=AxonTables(
            formats=tuple(SynapseFormat(**form) for form in core["synapse_formats"]),
            synapse_words=int(core["synapse_words"]),
            **{name: arrays[prefix + name] for name in AXON_ARRAYS if name not in OF_SYNAPSES},
            **{name: held(arrays.pop(prefix + name)) for name in OF_SYNAPSES},
        ),
    )
