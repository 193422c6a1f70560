"""Every level of the chip side as stable text, for people to read and for golden tests to compare.

``levels.txt`` says how a level reads. Small arrays are written out. Large ones are shown by their range and a digest,
so any change of a value shows.
"""

import hashlib
from typing import Any

import numpy as np

from hw_model.mapping.graph import CompartmentGraph, Compartments, Readout
from hw_model.mapping.placement import PlacedGraph
from hw_model.mapping.routing import RoutedGraph
from hw_model.program.chip_program import ChipProgram
from hw_model.texts.pieces import Pieces
from hw_model.values import AnyArray

WRITTEN_OUT = 16
"""Largest number of values of an array that is written out."""


def array_text(array: AnyArray) -> str:
    """Return the one value of a constant array, the values of a small array, or else range and digest."""
    values = np.asarray(array)
    if values.size == 0:
        return "none"
    if (values == values.flat[0]).all():
        return f"{values.flat[0]}"
    if values.size <= WRITTEN_OUT:
        return " ".join(map(str, values.ravel().tolist()))
    content = np.ascontiguousarray(values, np.int64 if values.dtype.kind == "i" else None).tobytes()
    return f"{values.min()}..{values.max()} #{hashlib.sha256(content).hexdigest()[:12]}"


def compartments_text(graph: CompartmentGraph) -> str:
    """Return the text of a CompartmentGraph."""
    read = _readout(graph.readout) if graph.readout else ""
    return _LEVELS.piece(
        "compartments", graph, groups=[_group(group) for group in graph.groups], read=read
    )


def placed_text(placed: PlacedGraph) -> str:
    """Return the text of a PlacedGraph: the slices of every core."""
    return _LEVELS.piece(
        "placed", placed, by_core=sorted(placed.slices, key=lambda s: s.core), cores=placed.cores
    )


def routed_text(routed: RoutedGraph) -> str:
    """Return the text of a RoutedGraph: axons and synapse lists of every core."""
    return _LEVELS.piece("routed", routed)


def program_text(program: ChipProgram) -> str:
    """Return the text of a ChipProgram: tables of every core."""
    return _LEVELS.piece(
        "program", program, said=[f"{key}: {value}" for key, value in program.provenance.items()]
    )


def _group(group: Compartments) -> dict[str, Any]:
    """Return a group with None for what is not said of it."""
    return vars(group) | {
        "threshold": None if group.joined_to else group.threshold,
        "bias": group if group.bias_mantissa.any() else None,
        "refractory": group.refractory if (group.refractory != 1).any() else None,
    }


def _readout(readout: Readout) -> str:
    what = {
        name: f"largest potential, from step {step} on," for name, step in readout.from_step.items()
    }
    terms = " + ".join(
        f"{weight:g} * {what.get(name, 'spikes')} of {name}" for name, weight in readout.terms
    )
    return terms if readout.tie_class is None else f"{terms}; ties predict {readout.tie_class}"


_LEVELS = Pieces(
    __package__,
    "levels.txt",
    str,
    array=array_text,
    distinct=lambda array: array_text(np.unique(array)),
    row=lambda values: " ".join(map(str, values)),
    length=lambda array: str(len(array)),
    index=lambda bits: f"{bits} index bits" if bits else "dense",
)
