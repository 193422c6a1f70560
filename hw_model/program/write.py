"""Write a program: a readable ``program.yaml``, and its arrays in ``program.npz``, tied together by a checksum.

The names of entries and arrays stand here, once for writing and reading (:mod:`hw_model.program.read`). They are the
names of fields, so a field that is renamed changes the file format.
"""

from __future__ import annotations

from dataclasses import asdict, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hw_model.io.records import Must
from hw_model.mapping.routing import AxonTables
from hw_model.program.sealed import CHIP_PROGRAM, save_files, sealed_files
from hw_model.values import IntArray, picked

if TYPE_CHECKING:
    from hw_model.mapping.graph import Input, Phase, Readout
    from hw_model.program.chip_program import ChipProgram, Core

VERSION = 1
"""The version of the file format. Programs of another version are refused."""
_NUMBERS: dict[str, type[int] | type[float]] = {
    "step_seconds": float,
    "event_threshold": int,
    "psi": float,
}
RECORDINGS = _NUMBERS | {"polarities": int, "columns": int}
"""Optional numbers of a program, with their types: how recordings become steps and predictions. An unknown number has
no entry."""
CHANNEL_ORDERS = ("yxp", "pyx")
"""How channels may be numbered, by their axes from the slowest to the fastest: rows, columns and polarities."""
TIME_UNITS = ("ns", "us", "ms", "s")
"""Units of the times of events."""
FIRST = "first"
"""The value of ``start`` for recordings that start at their first events."""
START = Must(
    lambda start: start == FIRST or not isinstance(start, str), f"of seconds, or {FIRST!r}"
)
"""The rule for the option that sets the start of recordings: a number of seconds, or ``first``."""
# Arrays of ``program.npz``, and entries of ``program.yaml``: fields of Core, AxonTables, InputRoute and Input.
CORE_ARRAYS = ("profile", "threshold", "bias_mantissa", "bias_exponent", "parent")
AXON_ARRAYS = (
    "list_start",
    "target",
    "mantissa",
    "delay",
    "format_index",
    "out_compartment",
    "out_core",
    "out_axon",
)
ROUTE_ARRAYS = ("line", "core", "axon")
INPUT_ENTRIES = ("name", "size", "phase", "stream")


def program_files(program: ChipProgram) -> dict[str, bytes]:
    """Return the two files as bytes, by name; the same program gives the same bytes."""
    return sealed_files(CHIP_PROGRAM, VERSION, program_document(program), program_arrays(program))


def save_program(program: ChipProgram, folder: str | Path) -> None:
    """Write both files, or neither; everything else in the folder stays."""
    save_files(Path(folder), program_files(program))


def program_document(program: ChipProgram) -> dict[str, Any]:
    """Return the entries of ``program.yaml``, except its format and checksums."""
    return {
        "name": program.name,
        "target": program.chip.name,
        "provenance": dict(program.provenance),
        "synapses_pruned": program.synapses_pruned,
        **_recording_entries(program),
        "phases": [_phase_entries(phase) for phase in program.phases],
        "inputs": [_input_entries(line_input) for line_input in program.inputs],
        **_readout_entries(program.readout),
        "cores": [_core_entries(core) for core in program.cores],
        "chip": program.chip.document,
    }


def _recording_entries(program: ChipProgram) -> dict[str, Any]:
    """Return the entries about recordings; an unknown value has no entry."""
    entries = {
        name: value for name, value in picked(program, *RECORDINGS).items() if value is not None
    }
    if program.channel_order:
        entries["channel_order"] = program.channel_order
    if program.start is not None:
        entries["start"] = program.start
    if program.time_unit:
        entries["time_unit"] = program.time_unit
    if program.recorded:
        entries["recorded"] = program.recorded.document()
    if program.class_names:
        entries["class_names"] = list(program.class_names)
    return entries


def _phase_entries(phase: Phase) -> dict[str, Any]:
    """Return the entries of a phase, without ``align_events`` if the phase starts with the recording.

    Files from before that setting have no such entry, and equal programs give equal files.
    """
    entries = asdict(phase)
    if phase.align_events is None:
        del entries["align_events"]
    return entries


def _input_entries(line_input: Input) -> dict[str, Any]:
    """Return the entries of an input. ``transposed`` says whether ``program.npz`` has positions for it."""
    is_transposed = line_input.positions is not None
    return {**picked(line_input, *INPUT_ENTRIES), "transposed": is_transposed}


def _readout_entries(readout: Readout | None) -> dict[str, Any]:
    """Return the entries of the readout; a program without one has ``readout: null``."""
    if readout is None:
        return {"readout": None}
    entries: dict[str, Any] = {"readout": dict(readout.terms)}
    if readout.tie_class is not None:
        entries["readout_tie_class"] = readout.tie_class
    if readout.from_step:
        entries["readout_potentials_from"] = _potentials_from(readout)
    return entries


def _potentials_from(readout: Readout) -> int | dict[str, int]:
    """Return the first step whose potentials count: one for all populations, or one for each that gives potentials."""
    if isinstance(readout.potentials_from, int):
        return readout.potentials_from
    return readout.from_step


def _core_entries(core: Core) -> dict[str, Any]:
    """Return the entries of a core; its arrays are in the other file."""
    axons = core.axons
    return {
        **picked(core, "number", "slot", "phase", "compartments"),
        **picked(axons, "input_axons", "output_axons"),
        "synapses": len(axons.target),
        **picked(axons, "synapse_words"),
        **picked(core, "vmin", "vmax"),
        "slices": [asdict(part) for part in core.slices],
        "compartment_profiles": [asdict(profile) for profile in core.profiles],
        "threshold_mantissas": list(core.thresholds),
        "synapse_formats": [asdict(synapse_format) for synapse_format in axons.formats],
    }


def program_arrays(program: ChipProgram) -> dict[str, IntArray]:
    """Return the arrays of ``program.npz``: ``input<i>/<name>`` and ``core<number>/<name>``."""
    arrays: dict[str, IntArray] = {}
    for index, line_input in enumerate(program.inputs):
        for name, array in picked(line_input, "positions", "first_lines").items():
            if array is not None:
                arrays[f"input{index}/{name}"] = array
    for index, route in enumerate(program.input_routes):
        for name, array in picked(route, *ROUTE_ARRAYS).items():
            arrays[f"input{index}/{name}"] = array
    for core in program.cores:
        core_arrays = picked(core, *CORE_ARRAYS) | picked(core.axons, *AXON_ARRAYS)
        for name, array in core_arrays.items():
            arrays[f"core{core.number}/{name}"] = array
    return arrays


# Fails if somebody adds an array to AxonTables and forgets to write it.
assert {f.name for f in fields(AxonTables)} == {*AXON_ARRAYS, "formats", "synapse_words"}
