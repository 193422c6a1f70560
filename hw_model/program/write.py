"""Write a program: a readable ``program.yaml``, and its arrays in ``program.npz``, tied together by a checksum."""

from __future__ import annotations

from dataclasses import asdict, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hw_model.mapping.routing import AxonTables
from hw_model.program.sealed import CHIP_PROGRAM, save_files, sealed_files
from hw_model.values import IntArray, picked

if TYPE_CHECKING:
    from hw_model.mapping.graph import Readout
    from hw_model.program.chip_program import ChipProgram, Core

VERSION = 1
_NUMBERS: dict[str, type[int] | type[float]] = {
    "step_seconds": float,
    "event_threshold": int,
    "psi": float,
}
RECORDINGS = _NUMBERS | {"polarities": int, "columns": int}
"""What is known about how recordings become steps and predictions; unknown values are left out."""
CHANNEL_ORDERS = ("yxp", "pyx")
"""How channels may be numbered, by their axes from the slowest to the fastest: rows, columns and polarities."""
TIME_UNITS = ("ns", "us", "ms", "s")
"""Units of the times of events."""
FIRST = "first"
"""The start of recordings at their first events."""
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
    """Return the entries of ``program.yaml`` but for its format and checksums."""
    readout = program.readout
    return {
        "name": program.name,
        "target": program.chip.name,
        "provenance": dict(program.provenance),
        "synapses_pruned": program.synapses_pruned,
        **{
            name: value for name, value in picked(program, *RECORDINGS).items() if value is not None
        },
        **({"channel_order": program.channel_order} if program.channel_order else {}),
        **({} if program.start is None else {"start": program.start}),
        **({"time_unit": program.time_unit} if program.time_unit else {}),
        **({"recorded": program.recorded.document()} if program.recorded else {}),
        **({"class_names": list(program.class_names)} if program.class_names else {}),
        "phases": [_given(asdict(phase)) for phase in program.phases],
        "inputs": [
            {**picked(i, *INPUT_ENTRIES), "transposed": i.positions is not None}
            for i in program.inputs
        ],
        "readout": None if readout is None else dict(readout.terms),
        **(
            {}
            if readout is None or readout.tie_class is None
            else {"readout_tie_class": readout.tie_class}
        ),
        **(
            {"readout_potentials_from": _potentials_from(readout)}
            if readout and readout.from_step
            else {}
        ),
        "cores": [_core(core) for core in program.cores],
        "chip": program.chip.document,
    }


def _core(core: Core) -> dict[str, Any]:
    axons = core.axons
    return {
        **picked(core, "number", "slot", "phase", "compartments"),
        **picked(axons, "input_axons", "output_axons"),
        "synapses": len(axons.target),
        **picked(axons, "synapse_words"),
        **picked(core, "vmin", "vmax"),
        "slices": [asdict(piece) for piece in core.slices],
        "compartment_profiles": [asdict(profile) for profile in core.profiles],
        "threshold_mantissas": list(core.thresholds),
        "synapse_formats": [asdict(form) for form in axons.formats],
    }


def _given(phase: dict[str, Any]) -> dict[str, Any]:
    """Return a phase without its start, if it has none."""
    return {
        key: value for key, value in phase.items() if key != "align_events" or value is not None
    }


def _potentials_from(readout: Readout) -> int | dict[str, int]:
    """Return the first step whose potentials count: one for all populations, or by population if some give spikes."""
    given = readout.potentials_from
    return given if isinstance(given, int) else readout.from_step


def program_arrays(program: ChipProgram) -> dict[str, IntArray]:
    """Return the arrays of ``program.npz``: ``input<i>/<name>`` and ``core<number>/<name>``."""
    arrays: dict[str, IntArray] = {}
    for index, item in enumerate(program.inputs):
        visits = picked(item, "positions", "first_lines")
        arrays |= {
            f"input{index}/{name}": array for name, array in visits.items() if array is not None
        }
    for index, route in enumerate(program.input_routes):
        arrays.update(
            {f"input{index}/{name}": array for name, array in picked(route, *ROUTE_ARRAYS).items()}
        )
    for core in program.cores:
        held = picked(core, *CORE_ARRAYS) | picked(core.axons, *AXON_ARRAYS)
        arrays.update({f"core{core.number}/{name}": array for name, array in held.items()})
    return arrays


assert {f.name for f in fields(AxonTables)} == {*AXON_ARRAYS, "formats", "synapse_words"}
